// The estimators that the evaluation compares: the paper's, written as the paper says, and ours.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "rsfm/estimation/absolute_pose.h"
#include "rsfm/estimation/two_view.h"
#include "tools/evaluation/solver_scenes.h"

namespace rsfm {

struct SolverResult {
  Rigid3 pose;  // camera_from_world or b_from_a
  double inlier_ratio = 0.0;
};

// Memory of one thread, for scenes of up to `capacity` observations.
struct SolverWorkspace {
  explicit SolverWorkspace(std::uint32_t capacity)
      : absolute(capacity), relative(capacity), ransac(capacity) {}

  AbsolutePoseEstimator absolute;
  TwoViewEstimator relative;
  RansacWorkspace ransac;
};

// Threshold 12 px, confidence 0.99999, 100 to 10000 samples, as the peer's evaluation.
enum class AbsoluteMethod {
  kP3pInAir,     // P3P in RANSAC on the un-refracted points: the baseline
  kGp3p,         // GP3P in the same RANSAC on the refracted rays
  kGp3pRefined,  // the product: GP3P in LO-RANSAC, refined on the true image error
};
std::string_view ToString(AbsoluteMethod method);  // "p3p_in_air", "gp3p", "gp3p_refined"
std::optional<SolverResult> SolveAbsolute(AbsoluteMethod method, const AnyCamera& camera,
                                          const AbsolutePoseScene& scene, std::uint64_t seed,
                                          SolverWorkspace* workspace);

// Threshold 4 px; confidence and samples as above, but at most 2000 for the 17-point solver and 200
// for GR6P: with 30 % outliers a sample without any is then missed once in a hundred and once in a
// hundred thousand times.
enum class RelativeMethod {
  kFivePointInAir,  // five points in RANSAC on the un-refracted points: the baseline
  kBestFit,         // five points in RANSAC on the best-fit perspective camera
  kBestFitRefined,  // then the virtual epipolar cost of its inliers, in six degrees of freedom
  kHu17,            // 17 rays, linear, in RANSAC on the refracted rays
  kGr6p,            // generalised eight-point in the same RANSAC
  kOurs,            // TwoViewEstimator
};
std::string_view ToString(RelativeMethod method);
std::optional<SolverResult> SolveRelative(RelativeMethod method, const AnyCamera& camera,
                                          const RelativePoseScene& scene, std::uint64_t seed,
                                          SolverWorkspace* workspace);

}  // namespace rsfm
