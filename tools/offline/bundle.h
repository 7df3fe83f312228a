// Global refractive bundle adjustment at the desk: poses, points and, where asked for, the lens and
// the port, by the true image error with analytic derivatives (reprojection_residual.h) and
// navigation priors (pose_prior.h), solved by a solver of our own (docs/refinement.md).
//
// Scale: behind a port it is visible in principle but so weakly that it drifts (distance times
// scale is almost a gauge). So whatever navigation does not hold is held here: position, attitude
// and scale each on its own, the scale by the distance between two far images.
#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include "rsfm/base/error.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/estimation/pose_prior.h"
#include "rsfm/estimation/robust_loss.h"
#include "rsfm/refraction/camera_config.h"

namespace rsfm {

struct BundleObservation {
  int image = 0;
  int point = 0;
  Vec2 pixel = Vec2::Zero();
};

struct BundleImage {
  Rigid3 camera_from_world;
  int camera = 0;      // index into BundleProblem::cameras
  bool fixed = false;  // the caller's wish; nothing more is then held
};

struct BundleProblem {
  std::vector<CameraConfig> cameras;
  // Where the priors of refined lenses and ports pull to; empty: where the cameras start. To be
  // given where adjustments follow one another: each beginning anew they would hold nothing.
  std::vector<CameraConfig> expected_cameras;
  std::vector<BundleImage> images;
  std::vector<Vec3> points;
  std::vector<BundleObservation> observations;
  std::vector<PosePrior> priors;  // a, b are indices into images
};

struct BundleProgress {
  int iteration = 0;
  int max_iterations = 0;
  double cost = 0.0;
};

// Which parameters are unknowns, and how far they may stray from what is expected of them: one
// standard deviation of a Gaussian prior that goes with every refined parameter.
struct RefineLens {
  bool focal = false;
  bool principal_point = false;
  bool distortion = false;
  double sigma_focal = 0.05;            // of the focal length, a ratio
  double sigma_principal_point = 0.02;  // of the image's width, a ratio
  double sigma_distortion = 0.2;        // the coefficient itself

  bool Any() const { return focal || principal_point || distortion; }
};
struct RefinePort {
  bool normal = false;       // flat
  bool distance = false;     // flat
  bool center = false;       // dome
  bool index_water = false;  // both
  double sigma_normal_rad = 0.1;
  double sigma_distance = 0.5;  // of the distance, a ratio, by its logarithm
  double sigma_center_m = 0.01;
  double sigma_index = 0.005;

  bool Any() const { return normal || distance || center || index_water; }
};

// True when the refinement touches what this port has.
bool RefinesPort(PortType type, const RefinePort& refine);

// The scale held against the data's faint opinion; and left to the bent rays, held only between two
// adjustments so that none leaps.
inline constexpr double kHeldScale = 1e-4, kSoftScale = 1.0;

struct BundleOptions {
  RefineLens lens;
  RefinePort port;
  RobustLoss loss{LossType::kCauchy, 1.0};  // of image errors, scale in sigmas
  double sigma_px = 1.0;                    // of every observation
  int max_iterations = 50;
  double function_tolerance = 1e-7;
  int num_threads = 2;
  double scale_sigma = kHeldScale;  // of the prior for a scale that navigation does not give
  // After each step of all unknowns the points are adjusted to the new poses before the step is
  // judged. A trajectory without navigation bends easily, along arcs that a straight step leaves:
  // without this the solver creeps along them and stops before it is there.
  //   [Ruhe & Wedin 1980, SIAM Review 22(3), algorithm II]
  bool adjust_points_within = true;
  // After each iteration; false stops, and what has been reached is kept.
  std::function<bool(const BundleProgress&)> progress;
};

// Whether the bent rays can tell the scale where nothing else does. A refined lens or index takes
// the bending over. A dome's radius and glass stay as they are: its centre may be refined beside
// the scale, and with the scale held wrong goes wrong itself. The distance of a flat port goes with
// the scale: refined, what is expected of it tells the scale, as well as it is known. (Held at what
// the first pair happened to have, a scale that is wrong by 16 makes 20 mm into 1.3.)
bool RaysTellScale(PortType type, const BundleOptions& options);

// What was held because nothing else determines it.
struct BundleGauge {
  bool position = false;
  bool attitude = false;
  bool scale = false;
  bool scale_from_refraction = false;          // left to the bent rays
  int scale_image_a = -1, scale_image_b = -1;  // the pair whose distance is held
};

struct BundleReport {
  bool converged = false;
  bool interrupted = false;
  int iterations = 0;
  double initial_cost = 0.0;
  double final_cost = 0.0;
  double initial_mean_error_px = 0.0;  // over all observations that can be projected
  double final_mean_error_px = 0.0;
  int num_impossible = 0;  // observations that could not be projected at the end
  double seconds = 0.0;
  std::string solver;  // of the linear systems
  BundleGauge gauge;
};

// Changes the problem's poses, points and cameras. On error the problem is as it was:
//   kInvalidArgument  an index or number out of range, `where` and `detail` say which
//   kNotEnoughData    no observation
//   kNotConverged     the solver failed outright
Expected<BundleReport> AdjustBundle(const BundleOptions& options, BundleProblem* problem);

struct ErrorSummary {
  double mean_px = 0.0;
  double median_px = 0.0;
  double rms_px = 0.0;
  int num_observations = 0;
  int num_impossible = 0;   // not in the mean
  double redundancy = 1.0;  // part of the numbers observed that poses and points do not take up
};
// kInvalidArgument for a camera that cannot be.
Expected<ErrorSummary> SummariseErrors(const BundleProblem& problem);

// What was asked, with sigma and loss as the errors of a settled problem show them: sigma from
// their median and what poses and points took of them, the loss bent from there on where what was
// asked bends later. Errors of features are those of good ones, a tenth of a pixel, among those of
// edges that slide with the view: a loss that bends at a pixel takes all of the latter at their
// word. Never more than was asked, at least a tenth of it.
//   [Huber & Ronchetti 2009, Robust Statistics, sec. 7.8: scale by the median]
BundleOptions FitNoise(const BundleOptions& asked, const ErrorSummary& errors);

// The pair of images that are far apart, for the scale: from the first image the farthest, and from
// that the farthest. {-1, -1} when all are in one place.
std::array<int, 2> FarPair(const BundleProblem& problem);

// What the priors leave free, and priors that hold just that.
struct GaugeHold {
  BundleGauge gauge;
  std::vector<PosePrior> priors;
};
GaugeHold HoldGauge(const BundleProblem& problem, double scale_sigma = kHeldScale);

}  // namespace rsfm
