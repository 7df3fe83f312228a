// The numerical evaluation of absolute and relative pose estimation of [She 2024,
// arXiv:2403.08640, sec. IV-A]: random rigs and scenes at several noise levels, each method on the
// same ones, with the Cramer-Rao bound.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tools/evaluation/solver_scenes.h"

namespace rsfm {

enum class SolverFigure { kAbsolutePose, kRelativePose };
std::string_view ToString(SolverFigure figure);  // "abs_pose", "rel_pose"

struct SolverRequest {
  SolverFigure figure = SolverFigure::kAbsolutePose;
  SolverPort port = SolverPort::kFlat;
  std::vector<double> noise_px;
  int experiments = 1000;  // at each noise level, each with a rig and a scene of its own
  std::uint64_t seed = 1;
  int threads = 1;  // no influence on any result but the times
};

inline constexpr int kSolverPoints = 200;
inline constexpr double kSolverOutlierRatio = 0.3;

// Angles in degrees; translation is the camera centre's distance in mm for absolute poses, the
// angle between the baselines for relative ones. A failure counts as 180 degrees and the scene's
// median range.
struct SolverRow {
  double noise_px = 0.0;
  std::string_view method;
  int experiments = 0;
  int failures = 0;
  double rotation_error_deg_mean = 0.0, rotation_error_deg_std = 0.0;
  double translation_error_mean = 0.0, translation_error_std = 0.0;
  double inlier_ratio_mean = 0.0;  // 0 for a failure
  double time_ms_median = 0.0;     // of the thread's clock; rays and best-fit camera included
};

// What no unbiased estimator can beat: the mean errors of a normal distribution with the inverse of
// the Fisher information of the true inliers as its covariance, averaged over the same scenes. The
// length of the baseline counts as known to a factor of e, as our estimator has it.
struct SolverBound {
  double noise_px = 0.0;
  double rotation_error_deg = 0.0;
  double translation_error = 0.0;
  double inlier_ratio = 0.0;  // of all observations, within the methods' threshold at the true pose
};

struct SolverEvaluation {
  SolverFigure figure = SolverFigure::kAbsolutePose;
  SolverPort port = SolverPort::kFlat;
  std::vector<SolverRow> rows;      // by noise, then by method
  std::vector<SolverBound> bounds;  // by noise
};

// `progress(done)` is called from any thread after each of noise_px.size() * experiments
// experiments; false stops the work: nothing is returned then.
std::optional<SolverEvaluation> EvaluateSolvers(const SolverRequest& request,
                                                const std::function<bool(std::int64_t)>& progress);

std::string ToCsv(const std::vector<SolverRow>& rows);
std::string ToCsv(const std::vector<SolverBound>& bounds);

}  // namespace rsfm
