#include "rsfm/estimation/two_view.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "rsfm/estimation/two_view_checks.h"
#include "rsfm/estimation/two_view_problem.h"

namespace rsfm {

using internal::AnchorScale;
using internal::MakeRefineOptions;

namespace {

constexpr double kMinSigmaPx = 1e-3;
constexpr const char* kCheirality = "cheirality";

double Median(FixedVector<double>* values) {
  if (values->empty()) return 0.0;
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

}  // namespace

Status TwoViewOptions::Validate() const noexcept {
  if (const Status status = ransac.Validate(); !status) return status;
  if (!(loss.scale > 0.0)) return Fail(Errc::kInvalidArgument, "loss.scale");
  if (max_refine_iterations < 0)
    return Fail(Errc::kInvalidArgument, "max_refine_iterations", max_refine_iterations);
  if (max_bundle_iterations < 0)
    return Fail(Errc::kInvalidArgument, "max_bundle_iterations", max_bundle_iterations);
  if (!(sigma_baseline_m >= 0.0)) return Fail(Errc::kInvalidArgument, "sigma_baseline_m");
  if (!(min_baseline_m > 0.0)) return Fail(Errc::kInvalidArgument, "min_baseline_m");
  if (!(max_baseline_m > min_baseline_m)) return Fail(Errc::kInvalidArgument, "max_baseline_m");
  if (sigma_baseline_m > 0.0 && !(baseline_m >= min_baseline_m && baseline_m <= max_baseline_m)) {
    return Fail(Errc::kInvalidArgument, "baseline_m");
  }
  if (!(min_range_m > 0.0)) return Fail(Errc::kInvalidArgument, "min_range_m");
  if (!(range_log_sigma > 0.0)) return Fail(Errc::kInvalidArgument, "range_log_sigma");
  if (!(nominal_range_m > min_range_m)) return Fail(Errc::kInvalidArgument, "nominal_range_m");
  if (min_inliers < 7) return Fail(Errc::kInvalidArgument, "min_inliers", min_inliers);
  if (!(max_direction_sigma_rad > 0.0))
    return Fail(Errc::kInvalidArgument, "max_direction_sigma_rad");
  return {};
}

TwoViewEstimator::TwoViewEstimator(std::uint32_t capacity)
    : pairs_(capacity),
      workspace_(capacity),
      active_(capacity),
      values_(capacity),
      mask_(capacity),
      points_(capacity),
      bundle_(capacity) {}

std::size_t TwoViewEstimator::bytes() const {
  return pairs_.bytes() + workspace_.bytes() + active_.bytes() + values_.bytes() + mask_.bytes() +
         points_.bytes() + bundle_.bytes();
}

Status TwoViewEstimator::Prepare(const AnyCamera& camera_a, const AnyCamera& camera_b,
                                 std::span<const Vec2> pixels_a, std::span<const Vec2> pixels_b,
                                 const TwoViewOptions& options) {
  if (const Status status = options.Validate(); !status) return status;
  if (pixels_a.size() != pixels_b.size()) return Fail(Errc::kInvalidArgument, "pixels_b");
  if (pixels_a.size() > mask_.capacity()) return Fail(Errc::kOutOfCapacity, "pixels_a", capacity());
  num_observations_ = pixels_a.size();
  pairs_.clear();
  for (std::size_t i = 0; i < pixels_a.size(); ++i) {
    RayPair pair;
    pair.index = static_cast<int>(i);
    if (BackprojectDifferentiated(camera_a, pixels_a[i], &pair.a) &&
        BackprojectDifferentiated(camera_b, pixels_b[i], &pair.b)) {
      pairs_.TryPushBack(pair);
    }
  }
  const int usable = static_cast<int>(pairs_.size());
  if (usable < options.min_inliers) return Fail(Errc::kNotEnoughData, "pixels_a", usable);
  centre_a_ = internal::NearestPoint(pairs_.span(), true);
  centre_b_ = internal::NearestPoint(pairs_.span(), false);
  port_depth_m_ = 0.0;
  for (RayPair& pair : pairs_) {
    pair.bearing_a = (pair.a.ray.At(options.nominal_range_m) - centre_a_).normalized();
    port_depth_m_ = std::max(port_depth_m_, (pair.a.ray.origin - centre_a_).norm());
    pair.bearing_b = (pair.b.ray.At(options.nominal_range_m) - centre_b_).normalized();
  }
  return {};
}

void TwoViewEstimator::SelectInliers(const RelativePose& pose, double max_error_px,
                                     double* sigma_px) {
  active_.clear();
  values_.clear();
  for (std::size_t i = 0; i < pairs_.size(); ++i) {
    const double squared_error = SquaredSampsonError(pose, pairs_[i]);
    if (!(squared_error < max_error_px * max_error_px)) continue;
    active_.TryPushBack(static_cast<int>(i));
    values_.TryPushBack(std::sqrt(squared_error));
  }
  // The median of a normal error's absolute value.
  *sigma_px = std::max(kMinSigmaPx, Median(&values_) / 0.6745);
}

void TwoViewEstimator::KeepWithin(const RelativePose& pose, double max_error_px) {
  std::size_t kept = 0;
  for (std::size_t k = 0; k < active_.size(); ++k) {
    if (!(SquaredSampsonError(pose, pairs_[active_[k]]) < max_error_px * max_error_px)) continue;
    active_[kept] = active_[k];
    if (k < bundle_.size()) bundle_[kept] = bundle_[k];
    ++kept;
  }
  bundle_.TryResizeForOverwrite(std::min(kept, bundle_.size()));
  active_.TryResizeForOverwrite(kept);
}

Status TwoViewEstimator::CheckCheirality(const RelativePose& pose, const TwoViewOptions& options,
                                         TwoViewReport* report) {
  const Vec3 none = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
  points_.clear();
  mask_.clear();
  while (points_.size() < num_observations_) points_.TryPushBack(none);
  mask_.TryResize(num_observations_);
  values_.clear();
  int in_front = 0, judged = 0;
  const Rigid3 a_from_b = pose.ToRigid().Inverse();
  for (std::size_t k = 0; k < active_.size(); ++k) {
    const RayPair& pair = pairs_[active_[k]];
    double range_a = 0.0, range_b = 0.0, angle = 0.0;
    const bool meet = MeetingRanges(pose, pair, &range_a, &range_b, &angle);
    values_.TryPushBack(meet ? angle : 0.0);
    mask_[pair.index] = 1;
    if (!meet || !(angle > ParallaxNoise(pair, report->sigma_px))) continue;  // too far to tell
    ++judged;
    if (range_a > 0.0 && range_b > 0.0) {
      ++in_front;
      points_[pair.index] =
          k < bundle_.size() && bundle_[k].has_point
              ? bundle_[k].states[0].point_in_a
              : Vec3(0.5 * (pair.a.ray.At(range_a) + a_from_b * pair.b.ray.At(range_b)));
    } else {
      mask_[pair.index] = 0;
    }
  }
  report->median_parallax_rad = Median(&values_);
  report->num_inliers = static_cast<int>(active_.size()) - (judged - in_front);
  if (in_front < options.min_in_front_ratio * judged || report->num_inliers < options.min_inliers) {
    return Fail(Errc::kNotEnoughInliers, kCheirality, in_front);
  }
  if (judged < options.min_inliers / 2) return Fail(Errc::kDegenerate, "rotation", judged);
  return {};
}

Status TwoViewEstimator::CheckDegeneracy(const RelativePose& pose, const TwoViewOptions& options,
                                         TwoViewReport* report) {
  const std::span<const RayPair> pairs = pairs_.span();
  const std::span<const int> active = active_.span();
  const double max_error_px = options.ransac.max_error_px;
  if (!(internal::ThinnestSpreadPx(pairs, active) > 2.0 * max_error_px))
    return Fail(Errc::kDegenerate, "collinear");
  report->rotation_only_ratio =
      internal::RotationOnlyRatio(pairs, active, pose.rotation, max_error_px);
  if (report->rotation_only_ratio > options.max_rotation_only_ratio)
    return Fail(Errc::kDegenerate, "rotation");

  Vec3 plane = Vec3::Zero();
  report->plane_ratio = internal::PlaneRatio(pairs, active, pose, max_error_px, &plane);
  if (report->plane_ratio <= options.max_plane_ratio) return {};
  // Truncated at three sigmas: the few outliers among the inliers fit one of two poses by chance.
  const double max_squared_error =
      std::min(max_error_px * max_error_px, 9.0 * report->sigma_px * report->sigma_px);
  const auto score = [&](const RelativePose& candidate) {
    double sum = 0.0;
    for (const int i : active)
      sum += std::min(SquaredSampsonError(candidate, pairs[i]), max_squared_error);
    return sum;
  };
  const double own_score = score(pose);
  constexpr double kMinInFrontRatio = 0.95;  // a true second solution has all points in front
  for (RelativePose other : internal::OtherPosesOfPlane(pose, plane)) {
    EpipolarRefineOptions refine = MakeRefineOptions(options, report->sigma_px);
    AnchorScale({pairs, centre_a_, centre_b_, port_depth_m_}, active, options, &refine, &other);
    RefineEpipolar(pairs, active, refine, &other);
    const double turned =
        LogSo3(Quat(Mat3(other.rotation * pose.rotation.transpose())).normalized()).norm();
    if (turned < 0.02 && other.direction.dot(pose.direction) > 0.995) continue;  // it came back
    int in_front = 0;
    for (const int i : active) {
      double range_a = 0.0, range_b = 0.0, angle = 0.0;
      in_front += MeetingRanges(other, pairs[i], &range_a, &range_b, &angle) && range_a > 0.0 &&
                  range_b > 0.0;
    }
    if (in_front < kMinInFrontRatio * static_cast<double>(active.size())) continue;
    // The two scores are sums over residuals of different components of the noise: their difference
    // has a standard deviation of 2 sqrt(n) sigma^2. A second solution within four of them is not
    // excluded.
    const double spread =
        2.0 * std::sqrt(static_cast<double>(active.size())) * report->sigma_px * report->sigma_px;
    if (score(other) < own_score + 4.0 * spread) return Fail(Errc::kDegenerate, "plane");
  }
  return {};
}

Status TwoViewEstimator::Describe(const RelativePose& pose, const EpipolarRefineOptions& refine,
                                  const TwoViewOptions& options, TwoViewReport* report) {
  EpipolarRefineOptions weighted = refine;
  weighted.weighting = EpipolarWeighting::kSampson;  // the covariance is that of image noise
  const EpipolarNormal normal = LineariseEpipolar(pairs_.span(), active_.span(), pose, weighted);
  const double inverse_variance = 1.0 / (report->sigma_px * report->sigma_px);
  const Mat6 information = inverse_variance * normal.information;

  // Rotation and direction with the length marginalised, its weak prior included.
  using Mat5 = Eigen::Matrix<double, 5, 5>;
  using Vec5 = Eigen::Matrix<double, 5, 1>;
  const double own = information(5, 5) + inverse_variance * normal.weak_information(5, 5);
  const Vec5 cross = information.topRightCorner<5, 1>();
  const Mat5 marginal = information.topLeftCorner<5, 5>() - cross * cross.transpose() / own;
  const Eigen::LLT<Mat5> factor(marginal);
  if (factor.info() != Eigen::Success) return Fail(Errc::kDegenerate, "information");
  const Mat5 covariance = factor.solve(Mat5::Identity());
  report->sigma_rotation_rad = std::sqrt(
      Eigen::SelfAdjointEigenSolver<Mat3>(covariance.topLeftCorner<3, 3>()).eigenvalues()[2]);
  report->sigma_direction_rad = std::sqrt(
      Eigen::SelfAdjointEigenSolver<Mat2>(covariance.bottomRightCorner<2, 2>()).eigenvalues()[1]);
  if (!(report->sigma_rotation_rad <= options.max_direction_sigma_rad) ||
      !(report->sigma_direction_rad <= options.max_direction_sigma_rad)) {
    return Fail(Errc::kDegenerate, "information");
  }

  // The length with rotation and direction marginalised, by observations and navigation alone.
  report->baseline_m = 1.0 / pose.inverse_baseline;
  const Mat5 others = information.topLeftCorner<5, 5>();
  const double of_length = information(5, 5) - cross.dot(others.ldlt().solve(cross));
  report->sigma_baseline_m = std::numeric_limits<double>::infinity();
  if (of_length > 1e-9 * information(5, 5)) {
    const double sigma =
        1.0 / (std::sqrt(of_length) * pose.inverse_baseline * pose.inverse_baseline);
    if (sigma < options.max_baseline_m) report->sigma_baseline_m = sigma;
  }
  report->is_baseline_known =
      report->sigma_baseline_m <= options.max_relative_baseline_sigma * report->baseline_m;

  // From (rotation, tangent, inverse length) to the left perturbation (w, v) of the rigid
  // transform:
  //   tangent = s B' (v + w x t),  d s = -s^2 u . v.
  report->b_from_a = pose.ToRigid();
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(pose.direction);
  Mat6 chain = Mat6::Zero();
  chain.topLeftCorner<3, 3>().setIdentity();
  chain.block<2, 3>(3, 0) =
      -pose.inverse_baseline * basis.transpose() * Hat(report->b_from_a.translation);
  chain.block<2, 3>(3, 3) = pose.inverse_baseline * basis.transpose();
  chain.block<1, 3>(5, 3) =
      -pose.inverse_baseline * pose.inverse_baseline * pose.direction.transpose();
  report->information = chain.transpose() * information * chain;
  if (!report->information.allFinite()) return Fail(Errc::kDegenerate, "information");
  return {};
}

Expected<TwoViewReport> TwoViewEstimator::RefineWithinWater(const TwoViewImages& images,
                                                            const TwoViewOptions& options,
                                                            const RelativePose& pose,
                                                            const TwoViewReport& report) {
  Expected<TwoViewReport> result =
      RefineAndJudge(images, options, options.range_log_sigma, pose, report);
  if (result || result.error().where != kCheirality || options.sigma_baseline_m > 0.0)
    return result;
  double sigma_px = report.sigma_px;
  SelectInliers(pose, options.ransac.max_error_px, &sigma_px);
  return RefineAndJudge(images, options, 0.1 * options.range_log_sigma, pose, report);
}

void TwoViewEstimator::AdjustBundle(const TwoViewImages& images, const TwoViewOptions& options,
                                    EpipolarRefineOptions refine, RelativePose* pose,
                                    TwoViewReport* report) {
  bundle_.clear();
  if (options.max_bundle_iterations == 0 ||
      static_cast<int>(active_.size()) < options.min_inliers) {
    return;
  }
  bundle_.TryResizeForOverwrite(active_.size());
  refine.weighting = EpipolarWeighting::kSampson;
  refine.sigma_px = report->sigma_px;
  refine.loss.scale = options.loss.scale * report->sigma_px;
  refine.max_iterations = options.max_bundle_iterations;
  report->bundle_iterations +=
      RefineTwoViewBundle(images, pairs_.span(), active_.span(), refine, bundle_.span(), pose);
}

Expected<TwoViewReport> TwoViewEstimator::RefineAndJudge(const TwoViewImages& images,
                                                         const TwoViewOptions& options,
                                                         double range_log_sigma, RelativePose pose,
                                                         TwoViewReport report) {
  constexpr int kMaxRounds = 3;
  const double max_error_px = options.ransac.max_error_px;
  EpipolarRefineOptions refine = MakeRefineOptions(options, report.sigma_px);
  for (int round = 0; round < kMaxRounds; ++round) {
    if (static_cast<int>(active_.size()) < options.min_inliers) break;
    refine = MakeRefineOptions(options, report.sigma_px);
    refine.priors.weak_log_sigma = range_log_sigma;
    const internal::StandIn stand_in{pairs_.span(), centre_a_, centre_b_, port_depth_m_};
    AnchorScale(stand_in, active_.span(), options, &refine, &pose);
    report.refine_iterations += RefineEpipolar(pairs_.span(), active_.span(), refine, &pose);
    if (round == 0 && !(options.sigma_baseline_m > 0.0))
      report.refine_iterations +=
          internal::TryNominalLength(stand_in, active_.span(), options, refine, &pose);
    const std::size_t before = active_.size();
    const double sigma_before = report.sigma_px;
    // What noise throws beyond a tight threshold is information, and without it there is a bias.
    const double adjusted_px = std::clamp(4.0 * report.sigma_px, max_error_px, 2.0 * max_error_px);
    SelectInliers(pose, adjusted_px, &report.sigma_px);
    if (active_.size() == before && std::abs(report.sigma_px - sigma_before) < 0.01 * sigma_before)
      break;
  }
  AdjustBundle(images, options, refine, &pose, &report);
  KeepWithin(pose, max_error_px);
  report.num_inliers = static_cast<int>(active_.size());
  report.num_observations = static_cast<int>(num_observations_);
  report.num_unusable = report.num_observations - static_cast<int>(pairs_.size());
  // The share of the image within the threshold of a line across it.
  const double width = images.camera_a->width(), height = images.camera_a->height();
  const double chance = 2.0 * max_error_px * std::hypot(width, height) / (width * height);
  if (report.num_inliers < options.min_inliers ||
      !IsMeaningful(report.num_inliers, static_cast<int>(pairs_.size()), kFivePointSampleSize,
                    chance, 10.0)) {
    return Fail(Errc::kNotEnoughInliers, "inliers", report.num_inliers);
  }
  if (const Status status = CheckDegeneracy(pose, options, &report); !status)
    return tl::unexpected(status.error());
  if (const Status status = CheckCheirality(pose, options, &report); !status)
    return tl::unexpected(status.error());
  refine.priors.weak_log_sigma = options.range_log_sigma;
  if (const Status status = Describe(pose, refine, options, &report); !status)
    return tl::unexpected(status.error());
  return report;
}

Expected<TwoViewReport> TwoViewEstimator::Estimate(const AnyCamera& camera_a,
                                                   const AnyCamera& camera_b,
                                                   std::span<const Vec2> pixels_a,
                                                   std::span<const Vec2> pixels_b,
                                                   const TwoViewOptions& options) noexcept {
  if (const Status status = Prepare(camera_a, camera_b, pixels_a, pixels_b, options); !status) {
    return tl::unexpected(status.error());
  }
  EpipolarRefineOptions local = MakeRefineOptions(options, options.ransac.max_error_px / 3.0);
  local.weighting = EpipolarWeighting::kSampson;
  local.loss = RobustLoss{};
  local.max_iterations = 4;
  internal::TwoViewProblem problem({pairs_.span(), centre_a_, centre_b_, port_depth_m_}, options,
                                   local);
  RelativePose pose;
  const Expected<RansacReport> ransac = Ransac(problem, options.ransac, &workspace_, &pose);
  if (!ransac) return tl::unexpected(ransac.error());
  TwoViewReport report;
  report.ransac = *ransac;
  SelectInliers(pose, options.ransac.max_error_px, &report.sigma_px);
  return RefineWithinWater({&camera_a, &camera_b, pixels_a, pixels_b}, options, pose, report);
}

Expected<TwoViewReport> TwoViewEstimator::Refine(const AnyCamera& camera_a,
                                                 const AnyCamera& camera_b,
                                                 std::span<const Vec2> pixels_a,
                                                 std::span<const Vec2> pixels_b,
                                                 const Rigid3& b_from_a_start,
                                                 const TwoViewOptions& options) noexcept {
  const double length = b_from_a_start.translation.norm();
  if (!std::isfinite(length) || !(length > 0.0) ||
      !(std::abs(b_from_a_start.rotation.norm() - 1.0) < 1e-6)) {
    return Fail(Errc::kInvalidArgument, "b_from_a_start");
  }
  if (const Status status = Prepare(camera_a, camera_b, pixels_a, pixels_b, options); !status) {
    return tl::unexpected(status.error());
  }
  RelativePose pose = RelativePose::FromRigid(b_from_a_start);
  pose.inverse_baseline =
      std::clamp(pose.inverse_baseline, 1.0 / options.max_baseline_m, 1.0 / options.min_baseline_m);
  TwoViewReport report;
  // The first round takes everything, its noise being that of the start.
  SelectInliers(pose, std::numeric_limits<double>::max(), &report.sigma_px);
  return RefineWithinWater({&camera_a, &camera_b, pixels_a, pixels_b}, options, pose, report);
}

}  // namespace rsfm
