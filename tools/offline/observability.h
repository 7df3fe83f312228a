// How well the data determine what a bundle adjustment found: lens, port, scale and the bend of the
// map; standard deviations at the solution, with everything else marginalised out.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tools/offline/bundle.h"

namespace rsfm {

enum class ParameterKind : std::uint8_t {
  kFocal,
  kPrincipalPoint,
  kDistortion,
  kNormal,
  kDistance,
  kCenter,
  kIndex,
  kMount,  // body_from_camera
  kClock,  // navigation's, against the images'
};

struct ParameterEstimate {
  ParameterKind kind = ParameterKind::kFocal;
  std::string name;    // "fx", "port.distance_m", with "camera 1: " before it where several
  double start = 0.0;  // where the refinement began
  double value = 0.0;
  double sigma = 0.0;        // one standard deviation, prior included; 0 where it cannot be told
  double prior_sigma = 0.0;  // the prior's
  double scale_correlation = 0.0;  // with the scale, were that free
  std::string verdict;  // "well determined", "determined", "weakly determined", "not determined"
};

// How the images' places bend over their extent (bend.h), and how well that is known.
struct BendEstimate {
  double sagitta_m = 0.0, sigma_m = 0.0, radius_m = 0.0;
  bool along_line = false;
};

// What the residuals say of a parameter that was held: the step it would take, were it free, all
// else following. Where the camera is right, steps lie within a few sigmas of 0.
struct ParameterDoubt {
  ParameterKind kind = ParameterKind::kFocal;
  std::string name;
  double value = 0.0, step = 0.0, sigma = 0.0;
};

struct ObservabilityReport {
  double noise_px = 0.0;     // of one image coordinate, from the residuals
  double scale_sigma = 0.0;  // of the scale, a ratio, were it not held: what the data know of it
  std::vector<ParameterEstimate> parameters;  // the refined ones
  std::optional<BendEstimate> bend;           // of a survey: cameras that look one way
  std::vector<ParameterDoubt> held;  // focal length, port normal and centre where they were held
  // How far their steps lie from 0 together, in sigmas: chi over the root of their number.
  // Parameters that go together may each be uncertain where their difference is not.
  double held_sigmas = 0.0;
};

// At a problem solved with `options`, which FitNoise may have made of what was `asked`; `start` has
// the cameras as they were. An empty list where nothing is refined. kDegenerate when the poses
// themselves are not determined.
Expected<ObservabilityReport> AnalyseObservability(const BundleOptions& options,
                                                   const BundleOptions& asked,
                                                   const std::vector<CameraConfig>& start,
                                                   const BundleProblem& solved);

// sigma against the prior's: below a tenth "well determined", below a half "determined", below nine
// tenths "weakly determined", else "not determined": the prior decides.
std::string Verdict(double sigma, double prior_sigma);

}  // namespace rsfm
