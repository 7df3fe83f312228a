#include "rsfm/estimation/absolute_pose.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "rsfm/estimation/gp3p.h"
#include "rsfm/estimation/p3p.h"
#include "rsfm/estimation/reprojection_residual.h"
#include "rsfm/estimation/upright_absolute_pose.h"

namespace rsfm {
namespace {

constexpr double kMinSigmaPx = 1e-3;

// Normal equations of the pose, (rotation, translation).
struct Normal {
  double cost = 0.0;
  Mat6 information = Mat6::Zero();
  Vec6 gradient = Vec6::Zero();

  void Add(const Mat26& jacobian, const Vec2& error, double weight) {
    const Mat26 weighted = weight * jacobian;
    information.noalias() += weighted.transpose().lazyProduct(jacobian);
    gradient.noalias() += weighted.transpose().lazyProduct(error);
  }
  // Levenberg's step with Marquardt's scaling; false when the system is not positive definite.
  bool Step(double damping, Vec6* step) const {
    Mat6 damped = information;
    damped.diagonal() *= 1.0 + damping;
    const Eigen::LLT<Mat6> factor(damped);
    if (factor.info() != Eigen::Success) return false;
    *step = factor.solve(-gradient);
    return step->allFinite();
  }
};

// The sum of an observation's derivative: d q / d(rotation, translation) = [-[p]x, I] for p = R X +
// t.
inline Mat26 ChainToPose(const Mat23& d_error_d_point, const Vec3& p) {
  Mat26 jacobian;
  for (int r = 0; r < 2; ++r) {
    const Vec3 row = d_error_d_point.row(r).transpose();
    jacobian.block<1, 3>(r, 0) = p.cross(row).transpose();
    jacobian.block<1, 3>(r, 3) = row.transpose();
  }
  return jacobian;
}

struct Hypothesis {
  Mat3 rotation = Mat3::Identity();
  Vec3 translation = Vec3::Zero();
};

// The RANSAC problem: poses from the rays of a sample, the first-order image error as the
// criterion.
template <int kSize>
class Problem {
 public:
  static constexpr int kSampleSize = kSize;
  static constexpr int kErrorDof = 2;
  using Model = Hypothesis;
  using Models = StaticVector<Model, Gp3pSolutions::capacity()>;
  using Observation = AbsolutePoseEstimator::Observation;

  Problem(std::span<const Observation> observations, const AbsolutePoseOptions& options,
          bool has_centre)
      : observations_(observations), options_(options), has_centre_(has_centre) {}

  int Size() const { return static_cast<int>(observations_.size()); }

  void Solve(std::span<const int, kSampleSize> sample, Models* models) const {
    std::array<Ray3, kSampleSize> rays;
    std::array<Vec3, kSampleSize> points;
    for (int i = 0; i < kSampleSize; ++i) {
      rays[i] = observations_[sample[i]].ray;
      points[i] = observations_[sample[i]].point_in_world;
    }
    const auto add = [models](const auto& poses) {
      for (const Rigid3& pose : poses)
        models->TryPushBack({pose.rotation.toRotationMatrix(), pose.translation});
    };
    if constexpr (kSampleSize == kUprightAbsoluteSampleSize) {
      add(SolveUprightAbsolutePose(rays, points, options_.down_in_camera, options_.down_in_world));
    } else if (has_centre_) {
      add(SolveP3p(std::array<Vec3, 3>{rays[0].direction, rays[1].direction, rays[2].direction},
                   points));
    } else {
      add(SolveGp3p(rays, points));
    }
  }

  double SquaredError(const Model& model, int i) const {
    const Observation& observation = observations_[i];
    const Vec3 q =
        model.rotation * observation.point_in_world + (model.translation - observation.ray.origin);
    const double depth = observation.ray.direction.dot(q);
    if (!(depth > 0.0)) return std::numeric_limits<double>::infinity();
    return (observation.pixel_from_offset * q).squaredNorm() / (depth * depth);
  }

  // Gauss-Newton on the first-order error: at most 3 steps, over at most about kMaxUsed
  // observations evenly chosen.
  bool Refine(std::span<const int> inliers, Model* model) const {
    constexpr std::size_t kMaxUsed = 256;
    const std::size_t stride = 1 + inliers.size() / kMaxUsed;
    Model current = *model;
    for (int step = 0; step < 3; ++step) {
      Normal normal;
      for (std::size_t k = 0; k < inliers.size(); k += stride) {
        const Observation& observation = observations_[inliers[k]];
        const Vec3 p = current.rotation * observation.point_in_world + current.translation;
        const Vec3 q = p - observation.ray.origin;
        const double inverse_depth = 1.0 / observation.ray.direction.dot(q);
        const Vec2 error = inverse_depth * (observation.pixel_from_offset * q);
        const Mat23 d_error_d_point =
            inverse_depth *
            (observation.pixel_from_offset - error * observation.ray.direction.transpose());
        normal.Add(ChainToPose(d_error_d_point, p), error, 1.0);
      }
      Vec6 delta;
      if (!normal.Step(1e-9, &delta)) return false;
      const Rigid3 update = ExpSe3(delta);
      current.rotation = update.rotation.toRotationMatrix() * current.rotation;
      current.translation = update * current.translation;
      if (delta.squaredNorm() < 1e-14) break;
    }
    *model = current;
    return true;
  }

 private:
  std::span<const Observation> observations_;
  const AbsolutePoseOptions& options_;
  bool has_centre_;  // all rays pass through the camera's origin
};
static_assert(RansacProblem<Problem<kGp3pSampleSize>>);
static_assert(RansacProblem<Problem<kUprightAbsoluteSampleSize>>);

// The true image error of the active observations with a robust loss in units of sigma.
Normal Linearise(const AnyCamera& camera, std::span<const Vec2> pixels,
                 std::span<const AbsolutePoseEstimator::Observation> observations,
                 std::span<const int> active, const Rigid3& camera_from_world,
                 const RobustLoss& loss) {
  Normal normal;
  const Mat3 rotation = camera_from_world.rotation.toRotationMatrix();
  for (const int i : active) {
    const Vec3 p = rotation * observations[i].point_in_world + camera_from_world.translation;
    Vec2 pixel;
    Mat23 d_pixel_d_point;
    if (camera.Project(p, &pixel, &d_pixel_d_point) != Projection::kOk) {
      normal.cost += loss.Rho(kImpossibleErrorPx * kImpossibleErrorPx);
      continue;
    }
    const Vec2 error = pixel - pixels[observations[i].index];
    const double squared_error = error.squaredNorm();
    normal.cost += loss.Rho(squared_error);
    normal.Add(ChainToPose(d_pixel_d_point, p), error, loss.Weight(squared_error));
  }
  return normal;
}

// Levenberg-Marquardt; leaves the pose at the lowest cost found and returns the iterations.
int Minimise(const AnyCamera& camera, std::span<const Vec2> pixels,
             std::span<const AbsolutePoseEstimator::Observation> observations,
             std::span<const int> active, const RobustLoss& loss, int max_iterations,
             Rigid3* camera_from_world) {
  Normal normal = Linearise(camera, pixels, observations, active, *camera_from_world, loss);
  double damping = 1e-6;
  int iteration = 0;
  while (iteration < max_iterations) {
    ++iteration;
    Vec6 step;
    if (!normal.Step(damping, &step)) {
      damping = std::max(1e-6, damping * 10.0);
      continue;
    }
    const double predicted = -step.dot(normal.gradient);
    const Rigid3 candidate = Perturb(*camera_from_world, step);
    if (predicted < 1e-8 * normal.cost) {
      // The step is worth nothing in cost and is far below the pose's uncertainty: take it unseen.
      *camera_from_world = candidate;
      break;
    }
    const Normal next = Linearise(camera, pixels, observations, active, candidate, loss);
    if (next.cost < normal.cost) {
      *camera_from_world = candidate;
      normal = next;
      damping = std::max(1e-12, damping * 0.1);
    } else {
      damping = std::max(1e-4, damping * 10.0);
    }
  }
  return iteration;
}

}  // namespace

Status AbsolutePoseOptions::Validate() const noexcept {
  if (const Status status = ransac.Validate(); !status) return status;
  if (!(loss.scale > 0.0)) return Fail(Errc::kInvalidArgument, "loss.scale");
  if (max_refine_iterations < 0)
    return Fail(Errc::kInvalidArgument, "max_refine_iterations", max_refine_iterations);
  if (min_inliers < 4) return Fail(Errc::kInvalidArgument, "min_inliers", min_inliers);
  if (!(max_rotation_sigma_rad > 0.0))
    return Fail(Errc::kInvalidArgument, "max_rotation_sigma_rad");
  if (down_in_camera != Vec3::Zero() || down_in_world != Vec3::Zero()) {
    if (!(std::abs(down_in_camera.norm() - 1.0) < 1e-6))
      return Fail(Errc::kInvalidArgument, "down_in_camera");
    if (!(std::abs(down_in_world.norm() - 1.0) < 1e-6))
      return Fail(Errc::kInvalidArgument, "down_in_world");
  }
  if (!(linearisation_range_m > 0.0)) return Fail(Errc::kInvalidArgument, "linearisation_range_m");
  return {};
}

AbsolutePoseEstimator::AbsolutePoseEstimator(std::uint32_t capacity)
    : observations_(capacity),
      workspace_(capacity),
      mask_(capacity),
      active_(capacity),
      errors_(capacity) {}

std::size_t AbsolutePoseEstimator::bytes() const {
  return observations_.bytes() + workspace_.bytes() + mask_.bytes() + active_.bytes() +
         errors_.bytes();
}

Status AbsolutePoseEstimator::Prepare(const AnyCamera& camera, std::span<const Vec2> pixels,
                                      std::span<const Vec3> points_in_world,
                                      const AbsolutePoseOptions& options, bool with_rays) {
  if (const Status status = options.Validate(); !status) return status;
  if (pixels.size() != points_in_world.size())
    return Fail(Errc::kInvalidArgument, "points_in_world");
  if (pixels.size() > mask_.capacity()) return Fail(Errc::kOutOfCapacity, "pixels", capacity());
  observations_.clear();
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (!pixels[i].allFinite() || !points_in_world[i].allFinite()) continue;
    Observation observation;
    observation.point_in_world = points_in_world[i];
    observation.index = static_cast<int>(i);
    if (with_rays) {
      Vec2 pixel;
      if (camera.Backproject(pixels[i], &observation.ray) != Projection::kOk) continue;
      if (camera.Project(observation.ray.At(options.linearisation_range_m), &pixel,
                         &observation.pixel_from_offset) != Projection::kOk) {
        continue;
      }
      observation.pixel_from_offset *= options.linearisation_range_m;
    }
    observations_.TryPushBack(observation);
  }
  const int usable = static_cast<int>(observations_.size());
  if (usable < options.min_inliers) return Fail(Errc::kNotEnoughData, "pixels", usable);
  return {};
}

int AbsolutePoseEstimator::SelectInliers(const AnyCamera& camera, std::span<const Vec2> pixels,
                                         const Rigid3& camera_from_world, double max_error_px,
                                         double* sigma_px, bool* changed) {
  const Mat3 rotation = camera_from_world.rotation.toRotationMatrix();
  const std::size_t before = active_.size();
  std::size_t same = 0;
  errors_.clear();
  std::size_t count = 0;
  for (std::size_t i = 0; i < observations_.size(); ++i) {
    const Observation& observation = observations_[i];
    Vec2 pixel;
    if (camera.Project(rotation * observation.point_in_world + camera_from_world.translation,
                       &pixel) != Projection::kOk) {
      continue;
    }
    const double squared_error = (pixel - pixels[observation.index]).squaredNorm();
    if (!(squared_error < max_error_px * max_error_px)) continue;
    same += count < before && active_[count] == static_cast<int>(i);
    if (count < active_.size()) {
      active_[count] = static_cast<int>(i);
    } else {
      active_.TryPushBack(static_cast<int>(i));
    }
    errors_.TryPushBack(squared_error);
    ++count;
  }
  active_.TryResize(count);
  *changed = same != count || before != count;
  if (count > 0) {
    // The median of a squared error of two Gaussian coordinates is 2 ln 2 sigma^2.
    const auto middle = errors_.begin() + static_cast<std::ptrdiff_t>(count / 2);
    std::nth_element(errors_.begin(), middle, errors_.end());
    *sigma_px = std::max(kMinSigmaPx, std::sqrt(*middle / (2.0 * std::numbers::ln2)));
  }
  return static_cast<int>(count);
}

Expected<AbsolutePoseReport> AbsolutePoseEstimator::RefineAndJudge(
    const AnyCamera& camera, std::span<const Vec2> pixels, const AbsolutePoseOptions& options,
    AbsolutePoseReport report) {
  constexpr int kMaxRounds = 4;  // of choosing inliers and refining on them
  const std::span<const Observation> observations = observations_.span();
  const double max_error_px = options.ransac.max_error_px;
  for (int round = 0; round < kMaxRounds; ++round) {
    if (static_cast<int>(active_.size()) < options.min_inliers) break;
    RobustLoss loss = options.loss;
    loss.scale *= report.sigma_px;
    report.refine_iterations += Minimise(camera, pixels, observations, active_.span(), loss,
                                         options.max_refine_iterations, &report.camera_from_world);
    bool changed = false;
    SelectInliers(camera, pixels, report.camera_from_world, max_error_px, &report.sigma_px,
                  &changed);
    if (!changed) break;
  }
  report.num_inliers = static_cast<int>(active_.size());
  report.num_observations = static_cast<int>(pixels.size());
  report.num_unusable = report.num_observations - static_cast<int>(observations_.size());
  const double chance =
      std::numbers::pi * max_error_px * max_error_px /
      (static_cast<double>(camera.width()) * static_cast<double>(camera.height()));
  if (report.num_inliers < options.min_inliers ||
      !IsMeaningful(report.num_inliers, static_cast<int>(observations_.size()), kGp3pSampleSize,
                    chance, 4.0)) {
    return Fail(Errc::kNotEnoughInliers, "inliers", report.num_inliers);
  }

  const RobustLoss no_loss;
  const Normal normal =
      Linearise(camera, pixels, observations, active_.span(), report.camera_from_world, no_loss);
  const Eigen::LLT<Mat6> factor(normal.information);
  if (factor.info() != Eigen::Success) return Fail(Errc::kDegenerate, "points_in_world");
  const Mat6 covariance_per_px = factor.solve(Mat6::Identity());
  const double widest =
      Eigen::SelfAdjointEigenSolver<Mat3>(covariance_per_px.topLeftCorner<3, 3>()).eigenvalues()[2];
  // Judged for a noise of at least one pixel: noise-free data do not make a geometry sound.
  if (!(std::sqrt(widest) * std::max(1.0, report.sigma_px) <= options.max_rotation_sigma_rad)) {
    return Fail(Errc::kDegenerate, "points_in_world");
  }
  report.covariance = report.sigma_px * report.sigma_px * covariance_per_px;
  report.rms_error_px = std::sqrt(normal.cost / (2.0 * report.num_inliers));
  if (!report.covariance.allFinite() || !report.camera_from_world.translation.allFinite() ||
      !report.camera_from_world.rotation.coeffs().allFinite()) {
    return Fail(Errc::kDegenerate, "points_in_world");
  }
  mask_.clear();
  mask_.TryResize(pixels.size());
  for (const int i : active_) mask_[observations_[i].index] = 1;
  return report;
}

Expected<AbsolutePoseReport> AbsolutePoseEstimator::Estimate(
    const AnyCamera& camera, std::span<const Vec2> pixels, std::span<const Vec3> points_in_world,
    const AbsolutePoseOptions& options) noexcept {
  if (const Status status = Prepare(camera, pixels, points_in_world, options, true); !status) {
    return tl::unexpected(status.error());
  }
  const bool has_centre = camera.config().port.type == PortType::kNone;
  Hypothesis model;
  Expected<RansacReport> ransac;
  if (options.down_in_camera != Vec3::Zero()) {
    Problem<kUprightAbsoluteSampleSize> problem(observations_.span(), options, has_centre);
    ransac = Ransac(problem, options.ransac, &workspace_, &model);
  } else {
    Problem<kGp3pSampleSize> problem(observations_.span(), options, has_centre);
    ransac = Ransac(problem, options.ransac, &workspace_, &model);
  }
  if (!ransac) return tl::unexpected(ransac.error());
  AbsolutePoseReport report;
  report.ransac = *ransac;
  report.camera_from_world = Rigid3(Quat(model.rotation).normalized(), model.translation);
  bool changed = false;
  SelectInliers(camera, pixels, report.camera_from_world, options.ransac.max_error_px,
                &report.sigma_px, &changed);
  return RefineAndJudge(camera, pixels, options, report);
}

Expected<AbsolutePoseReport> AbsolutePoseEstimator::Refine(
    const AnyCamera& camera, std::span<const Vec2> pixels, std::span<const Vec3> points_in_world,
    const Rigid3& camera_from_world_start, const AbsolutePoseOptions& options) noexcept {
  if (!camera_from_world_start.translation.allFinite() ||
      !camera_from_world_start.rotation.coeffs().allFinite() ||
      std::abs(camera_from_world_start.rotation.norm() - 1.0) > 1e-6) {
    return Fail(Errc::kInvalidArgument, "camera_from_world_start");
  }
  if (const Status status = Prepare(camera, pixels, points_in_world, options, false); !status) {
    return tl::unexpected(status.error());
  }
  AbsolutePoseReport report;
  report.camera_from_world = camera_from_world_start;
  // The first round takes everything, its noise being that of the start.
  bool changed = false;
  SelectInliers(camera, pixels, report.camera_from_world, kImpossibleErrorPx, &report.sigma_px,
                &changed);
  report.sigma_px = std::max(report.sigma_px, kMinSigmaPx);
  return RefineAndJudge(camera, pixels, options, report);
}

}  // namespace rsfm
