#include "tools/offline/bundle.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "rsfm/estimation/reprojection_residual.h"
#include "tools/offline/bundle_passes.h"

namespace rsfm {
namespace {

bool IsFinite(const Rigid3& pose) {
  return pose.rotation.coeffs().allFinite() && pose.translation.allFinite() &&
         std::abs(pose.rotation.norm() - 1.0) < 1e-6;
}

Status Check(const BundleProblem& problem) {
  const int num_cameras = static_cast<int>(problem.cameras.size());
  const int num_images = static_cast<int>(problem.images.size());
  const int num_points = static_cast<int>(problem.points.size());
  for (int i = 0; i < num_cameras; ++i)
    if (const auto camera = AnyCamera::Create(problem.cameras[i]); !camera)
      return tl::unexpected<Error>(camera.error());
  if (!problem.expected_cameras.empty() &&
      problem.expected_cameras.size() != problem.cameras.size())
    return Fail(Errc::kInvalidArgument, "expected_cameras");
  for (int i = 0; i < num_images; ++i) {
    const int camera = problem.images[i].camera;
    if (camera < 0 || camera >= num_cameras) return Fail(Errc::kInvalidArgument, "camera", i);
    if (!IsFinite(problem.images[i].camera_from_world))
      return Fail(Errc::kInvalidArgument, "camera_from_world", i);
  }
  for (int i = 0; i < num_points; ++i)
    if (!problem.points[i].allFinite()) return Fail(Errc::kInvalidArgument, "point", i);
  if (problem.observations.empty()) return Fail(Errc::kNotEnoughData, "observations");
  for (std::size_t i = 0; i < problem.observations.size(); ++i) {
    const BundleObservation& o = problem.observations[i];
    if (o.image < 0 || o.image >= num_images || o.point < 0 || o.point >= num_points ||
        !o.pixel.allFinite())
      return Fail(Errc::kInvalidArgument, "observation", static_cast<int>(i));
  }
  for (std::size_t i = 0; i < problem.priors.size(); ++i) {
    const PosePrior& prior = problem.priors[i];
    if (prior.a < 0 || prior.a >= num_images || prior.b >= num_images ||
        (prior.IsRelative() && prior.b < 0))
      return Fail(Errc::kInvalidArgument, "prior", static_cast<int>(i));
  }
  return {};
}

// Levenberg and Marquardt on poses and shared parameters, the points following.
//   [Nielsen 1999, IMM-REP-1999-05, for the damping]
class Minimiser {
 public:
  Minimiser(const BundleOptions& options, const BundleProblem& problem,
            const std::vector<PosePrior>& hold)
      : options_(options),
        unknowns_(options,
                  problem.expected_cameras.empty() ? problem.cameras : problem.expected_cameras),
        passes_(options, problem, hold, unknowns_),
        system_(passes_.pattern(), unknowns_.count()) {
    state_.configs = problem.cameras;
    state_.points = problem.points;
    for (const CameraConfig& config : problem.cameras)
      state_.cameras.push_back(*AnyCamera::Create(config));
    for (const BundleImage& image : problem.images) state_.poses.push_back(image.camera_from_world);
  }

  const BundleState& state() const { return state_; }

  Status Run(BundleReport* report) {
    report->initial_cost = cost_ = passes_.Evaluate(state_);
    if (!std::isfinite(cost_)) return Fail(Errc::kNotConverged, "bundle adjustment");
    const ReducedSums* sums = &passes_.Linearise(state_);
    for (int i = 1; i <= options_.max_iterations; ++i) {
      report->iterations = i;
      const double cost_before = cost_;
      const Outcome outcome = Step(*sums);
      if (options_.progress && !options_.progress({i, options_.max_iterations, cost_})) {
        report->interrupted = true;
        break;
      }
      if (outcome == Outcome::kNothingLeft ||
          (outcome == Outcome::kAccepted &&
           cost_before - cost_ <= options_.function_tolerance * cost_)) {
        report->converged = true;
        break;
      }
      if (lambda_ > kMaxDamping) break;
      // Where the curvature has misled once it is left out for good.
      trusts_curvature_ &= !(is_near_ && outcome == Outcome::kRefused);
      const bool is_near =
          trusts_curvature_ && outcome == Outcome::kAccepted && cost_before - cost_ < kNear * cost_;
      if (outcome == Outcome::kAccepted || is_near != is_near_) {
        is_near_ = is_near;
        passes_.TakeCurvature(is_near_ ? kCurvatureTaken : 0.0);
        sums = &passes_.Linearise(state_);
      }
    }
    report->final_cost = cost_;
    return {};
  }

 private:
  enum class Outcome { kAccepted, kRefused, kNothingLeft };
  static constexpr double kMaxDamping = 1e12;
  // Steps that lower the cost by less than kNear of it are near the optimum: the loss's own
  // curvature is then taken into account, up to kCurvatureTaken.
  static constexpr double kNear = 0.01, kCurvatureTaken = 0.5;
  static constexpr double kForetold = 0.01;

  Outcome Refuse() {
    lambda_ *= growth_;
    growth_ *= 2.0;
    return Outcome::kRefused;
  }

  Outcome Step(const ReducedSums& sums) {
    Eigen::VectorXd pose_step, shared_step;
    if (!system_.Solve(sums, lambda_, &pose_step, &shared_step)) return Refuse();
    const double predicted = Predicted(sums, pose_step, shared_step);
    if (!(predicted > 0.1 * options_.function_tolerance * cost_)) return Outcome::kNothingLeft;
    BundleState moved;
    if (!unknowns_.Plus(shared_step, state_.configs, &moved.configs)) return Refuse();
    for (const CameraConfig& config : moved.configs)
      moved.cameras.push_back(*AnyCamera::Create(config));
    moved.poses = state_.poses;
    for (std::size_t i = 0; i < moved.poses.size(); ++i) {
      const int block = passes_.PoseBlock(static_cast<int>(i));
      if (block < 0) continue;
      moved.poses[i] = Perturb(state_.poses[i], pose_step.segment<6>(6 * block));
      moved.poses[i].rotation.normalize();
    }
    moved.points = state_.points;
    const double cost = passes_.MovePoints(state_, pose_step, shared_step, &moved);
    const double gain = (cost_ - cost) / predicted;
    if (!(cost < cost_) || !(gain > 1e-4)) return Refuse();
    // Where the model foretold the cost, what the data hardly know (a scale that bent rays alone
    // tell) is held back by nothing but the damping.
    const double least = std::abs(gain - 1.0) < kForetold ? 1e-3 : 0.1;
    lambda_ = std::max(1e-12, lambda_ * std::max(least, 1.0 - std::pow(2.0 * gain - 1.0, 3)));
    growth_ = 2.0;
    state_ = std::move(moved);
    passes_.Accept();
    cost_ = cost;
    return Outcome::kAccepted;
  }

  double Predicted(const ReducedSums& sums, const Eigen::VectorXd& pose_step,
                   const Eigen::VectorXd& shared_step) const {
    const double damped = sums.pose_diagonal.dot(pose_step.cwiseAbs2()) +
                          sums.shared_diagonal.dot(shared_step.cwiseAbs2());
    return sums.points_decrease + 0.5 * (lambda_ * damped - sums.pose_gradient.dot(pose_step) -
                                         sums.shared_gradient.dot(shared_step));
  }

  const BundleOptions& options_;
  CameraUnknowns unknowns_;
  BundlePasses passes_;
  ReducedSystem system_;
  BundleState state_;
  double cost_ = 0.0;
  double lambda_ = 1e-5, growth_ = 2.0;
  bool is_near_ = false, trusts_curvature_ = true;
};

constexpr double kLeastRedundancy = 0.1;  // errors of fewer say nothing of the noise

}  // namespace

Expected<ErrorSummary> SummariseErrors(const BundleProblem& problem) {
  std::vector<AnyCamera> cameras;
  for (const CameraConfig& config : problem.cameras) {
    const Expected<AnyCamera> camera = AnyCamera::Create(config);
    if (!camera) return tl::unexpected<Error>(camera.error());
    cameras.push_back(*camera);
  }
  ErrorSummary summary;
  double sum = 0.0, squares = 0.0;
  std::vector<float> norms;
  norms.reserve(problem.observations.size());
  for (const BundleObservation& o : problem.observations) {
    const BundleImage& image = problem.images[o.image];
    Vec2 error;
    if (ReprojectionError(cameras[image.camera], image.camera_from_world, problem.points[o.point],
                          o.pixel, &error) != Projection::kOk) {
      ++summary.num_impossible;
      continue;
    }
    ++summary.num_observations;
    norms.push_back(static_cast<float>(error.norm()));
    sum += error.norm();
    squares += error.squaredNorm();
  }
  if (summary.num_observations > 0) {
    summary.mean_px = sum / summary.num_observations;
    summary.rms_px = std::sqrt(squares / summary.num_observations);
    const auto middle = norms.begin() + static_cast<std::ptrdiff_t>(norms.size() / 2);
    std::nth_element(norms.begin(), middle, norms.end());
    summary.median_px = *middle;
    const double numbers = 2.0 * summary.num_observations;
    const double unknowns = 3.0 * static_cast<double>(problem.points.size()) +
                            6.0 * static_cast<double>(problem.images.size());
    summary.redundancy = std::max(kLeastRedundancy, (numbers - unknowns) / numbers);
  }
  return summary;
}

BundleOptions FitNoise(const BundleOptions& asked, const ErrorSummary& errors) {
  constexpr double kMedianInSigmas = 1.1774;  // of a Rayleigh distribution: sqrt(2 ln 2)
  constexpr double kLeast = 0.1;
  const double sigma_px = std::max(
      errors.median_px / (kMedianInSigmas * std::sqrt(errors.redundancy)), kLeast * asked.sigma_px);
  if (!(sigma_px < asked.sigma_px)) return asked;
  BundleOptions fitted = asked;
  fitted.sigma_px = sigma_px;
  fitted.loss.scale = std::min(asked.loss.scale * asked.sigma_px / sigma_px, kMedianInSigmas);
  return fitted;
}

Expected<BundleReport> AdjustBundle(const BundleOptions& options, BundleProblem* problem) {
  const auto start = std::chrono::steady_clock::now();
  if (const Status valid = Check(*problem); !valid) return tl::unexpected<Error>(valid.error());
  if (!(options.sigma_px > 0.0)) return Fail(Errc::kInvalidArgument, "sigma_px");
  if (!(options.loss.scale > 0.0)) return Fail(Errc::kInvalidArgument, "loss.scale");
  const bool caller_holds = std::any_of(problem->images.begin(), problem->images.end(),
                                        [](const BundleImage& image) { return image.fixed; });
  GaugeHold hold;
  if (!caller_holds) hold = HoldGauge(*problem, options.scale_sigma);

  BundleReport report;
  report.gauge = hold.gauge;
  report.solver = "CHOLMOD, bordered";
  report.initial_mean_error_px = SummariseErrors(*problem)->mean_px;
  {
    Minimiser minimiser(options, *problem, hold.priors);
    if (const Status done = minimiser.Run(&report); !done)
      return tl::unexpected<Error>(done.error());
    const BundleState& state = minimiser.state();
    for (std::size_t i = 0; i < state.poses.size(); ++i)
      problem->images[i].camera_from_world = state.poses[i];
    problem->points = state.points;
    problem->cameras = state.configs;
  }
  const ErrorSummary errors = *SummariseErrors(*problem);
  report.final_mean_error_px = errors.mean_px;
  report.num_impossible = errors.num_impossible;
  report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return report;
}

}  // namespace rsfm
