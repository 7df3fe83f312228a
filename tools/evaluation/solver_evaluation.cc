#include "tools/evaluation/solver_evaluation.h"

#include <time.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

#include "rsfm/estimation/reprojection_residual.h"
#include "tools/common/parallel.h"
#include "tools/evaluation/solver_methods.h"

namespace rsfm {
namespace {

constexpr int kMaxMethods = 6;
constexpr double kMaxAbsoluteErrorPx = 12.0, kMaxRelativeErrorPx = 4.0;

double Degrees(double radians) { return radians * 180.0 / std::numbers::pi; }

// The clock of this thread alone: other threads do not lengthen it.
double ThreadMilliseconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

struct Outcome {
  bool failed = true;
  double rotation_deg = 180.0;
  double translation = 0.0;
  double inlier_ratio = 0.0;
  double time_ms = 0.0;
};

struct Experiment {
  Outcome outcomes[kMaxMethods];
  SolverBound bound;
};

// Mean lengths of the two parts of a normal vector with the given information.
struct MeanLengths {
  double first = 0.0, second = 0.0;
};
MeanLengths MeanOfNormal(const Mat6& information, int second_size, std::uint64_t seed) {
  constexpr int kDraws = 32;
  const Eigen::LLT<Mat6> factor(information);
  if (factor.info() != Eigen::Success) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    return {kInfinity, kInfinity};
  }
  MeanLengths mean;
  Rng rng(seed);
  for (int k = 0; k < kDraws; ++k) {
    Vec6 z;
    for (int i = 0; i < 6; ++i) z[i] = rng.Gaussian();
    const Vec6 x = factor.matrixU().solve(z);
    mean.first += x.head<3>().norm() / kDraws;
    mean.second += x.segment(3, second_size).norm() / kDraws;
  }
  return mean;
}

std::vector<std::string_view> MethodNames(SolverFigure figure) {
  std::vector<std::string_view> names;
  if (figure == SolverFigure::kAbsolutePose) {
    for (int m = 0; m <= static_cast<int>(AbsoluteMethod::kGp3pRefined); ++m)
      names.push_back(ToString(static_cast<AbsoluteMethod>(m)));
  } else {
    for (int m = 0; m <= static_cast<int>(RelativeMethod::kOurs); ++m)
      names.push_back(ToString(static_cast<RelativeMethod>(m)));
  }
  return names;
}

SolverBound BoundOf(const AnyCamera& camera, const AbsolutePoseScene& scene, double noise_px,
                    std::uint64_t seed) {
  SolverBound bound;
  Mat6 information = Mat6::Zero();
  int inliers = 0;
  for (std::size_t i = 0; i < scene.pixels.size(); ++i) {
    Vec2 error;
    Mat26 d_pose;
    Mat23 d_point;
    if (ReprojectionError(camera, scene.camera_from_world, scene.points_in_world[i],
                          scene.pixels[i], &error, &d_pose, &d_point) != Projection::kOk) {
      continue;
    }
    inliers += error.norm() < kMaxAbsoluteErrorPx;
    if (!scene.is_outlier[i]) information += d_pose.transpose() * d_pose;
  }
  bound.inlier_ratio = static_cast<double>(inliers) / static_cast<double>(scene.pixels.size());
  if (!(noise_px > 0.0)) return bound;
  // The centre -R' t moves by R' v for the left perturbation (w, v): by the length of v.
  const MeanLengths mean = MeanOfNormal(information / (noise_px * noise_px), 3, seed);
  bound.rotation_error_deg = Degrees(mean.first);
  bound.translation_error = 1e3 * mean.second;
  return bound;
}

SolverBound BoundOf(const AnyCamera& camera, const RelativePoseScene& scene, double noise_px,
                    std::uint64_t seed) {
  SolverBound bound;
  const RelativePose truth = RelativePose::FromRigid(scene.b_from_a);
  std::vector<RayPair> exact;
  std::vector<int> active;
  int inliers = 0;
  for (std::size_t i = 0; i < scene.pixels_a.size(); ++i) {
    RayPair pair;
    if (BackprojectDifferentiated(camera, scene.pixels_a[i], &pair.a) &&
        BackprojectDifferentiated(camera, scene.pixels_b[i], &pair.b)) {
      inliers += SquaredSampsonError(truth, pair) < kMaxRelativeErrorPx * kMaxRelativeErrorPx;
    }
    if (scene.is_outlier[i] || !BackprojectDifferentiated(camera, scene.exact_a[i], &pair.a) ||
        !BackprojectDifferentiated(camera, scene.exact_b[i], &pair.b)) {
      continue;
    }
    active.push_back(static_cast<int>(exact.size()));
    exact.push_back(pair);
  }
  bound.inlier_ratio = static_cast<double>(inliers) / static_cast<double>(scene.pixels_a.size());
  if (!(noise_px > 0.0)) return bound;
  // At noise-free pixels the squared first-order distance is the marginal likelihood of the pose.
  EpipolarRefineOptions options;
  options.sigma_px = noise_px;
  options.priors.weak_length_m = 1.0 / truth.inverse_baseline;
  const EpipolarNormal normal = LineariseEpipolar(exact, active, truth, options);
  const MeanLengths mean =
      MeanOfNormal((normal.information + normal.weak_information) / (noise_px * noise_px), 2, seed);
  bound.rotation_error_deg = Degrees(mean.first);
  bound.translation_error = Degrees(mean.second);
  return bound;
}

template <class Solve>
Outcome Run(const Solve& solve, const Rigid3& truth, bool is_absolute, double failure) {
  Outcome outcome;
  outcome.translation = failure;
  const double start = ThreadMilliseconds();
  const std::optional<SolverResult> result = solve();
  outcome.time_ms = ThreadMilliseconds() - start;
  if (!result) return outcome;
  outcome.failed = false;
  outcome.inlier_ratio = result->inlier_ratio;
  outcome.rotation_deg = Degrees(AngleBetween(result->pose.rotation, truth.rotation));
  outcome.translation =
      is_absolute ? 1e3 * (result->pose.OriginOfTarget() - truth.OriginOfTarget()).norm()
                  : Degrees(std::atan2(result->pose.translation.cross(truth.translation).norm(),
                                       result->pose.translation.dot(truth.translation)));
  return outcome;
}

Experiment RunExperiment(const SolverRequest& request, std::size_t level, int index,
                         SolverWorkspace* workspace) {
  const double noise_px = request.noise_px[level];
  // A stream of its own for each experiment: the order of execution does not matter.
  std::uint64_t seed = Rng(request.seed).Next();
  seed = Rng(seed + static_cast<std::uint64_t>(std::llround(1e6 * noise_px))).Next();
  seed = Rng(seed + static_cast<std::uint64_t>(index)).Next();
  Rng rng(seed);
  Experiment experiment;
  const AnyCamera camera = RandomSolverCamera(request.port, &rng);
  if (request.figure == SolverFigure::kAbsolutePose) {
    const AbsolutePoseScene scene =
        RandomAbsolutePoseScene(camera, noise_px, kSolverPoints, kSolverOutlierRatio, &rng);
    for (int m = 0; m <= static_cast<int>(AbsoluteMethod::kGp3pRefined); ++m) {
      experiment.outcomes[m] = Run(
          [&] {
            return SolveAbsolute(static_cast<AbsoluteMethod>(m), camera, scene, seed, workspace);
          },
          scene.camera_from_world, true, 1e3 * scene.median_range_m);
    }
    experiment.bound = BoundOf(camera, scene, noise_px, seed);
    return experiment;
  }
  const RelativePoseScene scene =
      RandomRelativePoseScene(camera, noise_px, kSolverPoints, kSolverOutlierRatio, &rng);
  for (int m = 0; m <= static_cast<int>(RelativeMethod::kOurs); ++m) {
    experiment.outcomes[m] = Run(
        [&] {
          return SolveRelative(static_cast<RelativeMethod>(m), camera, scene, seed, workspace);
        },
        scene.b_from_a, false, 180.0);
  }
  experiment.bound = BoundOf(camera, scene, noise_px, seed);
  return experiment;
}

// Mean and standard deviation, summed in order: the same from run to run.
template <class Value>
void Summarise(const std::vector<Experiment>& experiments, std::size_t first, int count,
               const Value& value, double* mean, double* deviation) {
  double sum = 0.0, squares = 0.0;
  for (int e = 0; e < count; ++e) sum += value(experiments[first + e]);
  *mean = sum / count;
  for (int e = 0; e < count; ++e) {
    const double difference = value(experiments[first + e]) - *mean;
    squares += difference * difference;
  }
  *deviation = count > 1 ? std::sqrt(squares / (count - 1)) : 0.0;
}

SolverRow MakeRow(const std::vector<Experiment>& experiments, std::size_t first, int count,
                  int method) {
  SolverRow row;
  row.experiments = count;
  std::vector<double> times;
  for (int e = 0; e < count; ++e) {
    row.failures += experiments[first + e].outcomes[method].failed;
    times.push_back(experiments[first + e].outcomes[method].time_ms);
  }
  std::nth_element(times.begin(), times.begin() + count / 2, times.end());
  row.time_ms_median = times[static_cast<std::size_t>(count) / 2];
  double unused = 0.0;
  Summarise(
      experiments, first, count,
      [method](const Experiment& e) { return e.outcomes[method].rotation_deg; },
      &row.rotation_error_deg_mean, &row.rotation_error_deg_std);
  Summarise(
      experiments, first, count,
      [method](const Experiment& e) { return e.outcomes[method].translation; },
      &row.translation_error_mean, &row.translation_error_std);
  Summarise(
      experiments, first, count,
      [method](const Experiment& e) { return e.outcomes[method].inlier_ratio; },
      &row.inlier_ratio_mean, &unused);
  return row;
}

std::string Format(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

}  // namespace

std::string_view ToString(SolverFigure figure) {
  return figure == SolverFigure::kAbsolutePose ? "abs_pose" : "rel_pose";
}

std::optional<SolverEvaluation> EvaluateSolvers(const SolverRequest& request,
                                                const std::function<bool(std::int64_t)>& progress) {
  const std::int64_t total =
      static_cast<std::int64_t>(request.noise_px.size()) * request.experiments;
  std::vector<Experiment> experiments(static_cast<std::size_t>(total));
  std::atomic<std::int64_t> done = 0;
  const bool all = ParallelWork(total, request.threads, [&] {
    return [&, workspace = SolverWorkspace(kSolverPoints)](std::int64_t i) mutable {
      experiments[static_cast<std::size_t>(i)] =
          RunExperiment(request, static_cast<std::size_t>(i / request.experiments),
                        static_cast<int>(i % request.experiments), &workspace);
      return progress(++done);
    };
  });
  if (!all) return std::nullopt;

  SolverEvaluation evaluation;
  evaluation.figure = request.figure;
  evaluation.port = request.port;
  const std::vector<std::string_view> names = MethodNames(request.figure);
  for (std::size_t level = 0; level < request.noise_px.size(); ++level) {
    const std::size_t first = level * static_cast<std::size_t>(request.experiments);
    for (int m = 0; m < static_cast<int>(names.size()); ++m) {
      SolverRow row = MakeRow(experiments, first, request.experiments, m);
      row.noise_px = request.noise_px[level];
      row.method = names[static_cast<std::size_t>(m)];
      evaluation.rows.push_back(row);
    }
    SolverBound bound;
    bound.noise_px = request.noise_px[level];
    double unused = 0.0;
    const auto mean = [&](double SolverBound::*member, double* value) {
      Summarise(
          experiments, first, request.experiments,
          [member](const Experiment& e) { return e.bound.*member; }, value, &unused);
    };
    mean(&SolverBound::rotation_error_deg, &bound.rotation_error_deg);
    mean(&SolverBound::translation_error, &bound.translation_error);
    mean(&SolverBound::inlier_ratio, &bound.inlier_ratio);
    evaluation.bounds.push_back(bound);
  }
  return evaluation;
}

std::string ToCsv(const std::vector<SolverRow>& rows) {
  std::string csv =
      "noise_px,method,experiments,failures,rotation_error_deg_mean,rotation_error_deg_std,"
      "translation_error_mean,translation_error_std,inlier_ratio_mean,time_ms_median\n";
  for (const SolverRow& row : rows) {
    csv += Format("%.9g", row.noise_px) + "," + std::string(row.method) + "," +
           std::to_string(row.experiments) + "," + std::to_string(row.failures);
    for (const double value :
         {row.rotation_error_deg_mean, row.rotation_error_deg_std, row.translation_error_mean,
          row.translation_error_std, row.inlier_ratio_mean}) {
      csv += "," + Format("%.9g", value);
    }
    csv += "," + Format("%.4g", row.time_ms_median) + "\n";
  }
  return csv;
}

std::string ToCsv(const std::vector<SolverBound>& bounds) {
  std::string csv = "noise_px,rotation_error_deg,translation_error,inlier_ratio_at_truth\n";
  for (const SolverBound& bound : bounds) {
    csv += Format("%.9g", bound.noise_px) + "," + Format("%.9g", bound.rotation_error_deg) + "," +
           Format("%.9g", bound.translation_error) + "," + Format("%.9g", bound.inlier_ratio) +
           "\n";
  }
  return csv;
}

}  // namespace rsfm
