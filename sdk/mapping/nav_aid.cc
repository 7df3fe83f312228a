#include "rsfm/mapping/nav_aid.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <numbers>

#include "rsfm/navigation/lever_arm.h"

namespace rsfm {
namespace {

Vec3 StatedOr(const Vec3& sigma, const Vec3& fallback) {
  return (sigma.array() > 0.0).select(sigma, fallback);
}
double StatedOr(double sigma, double fallback) { return sigma > 0.0 ? sigma : fallback; }

NavSample Defaults(const MapperOptions& options) {
  NavSample defaults;
  defaults.sigma_position_m = Vec3::Constant(options.position_sigma_m);
  defaults.sigma_attitude_rad =
      Vec3::Constant(options.attitude_sigma_deg * std::numbers::pi / 180.0);
  defaults.sigma_velocity_mps = Vec3::Constant(options.velocity_sigma_mps);
  defaults.sigma_depth_m = options.depth_sigma_m;
  defaults.sigma_altitude_m = options.altitude_sigma_m;
  return defaults;
}

constexpr RobustLoss kHuber{LossType::kHuber, 3.0};    // noise with a heavy tail
constexpr RobustLoss kCauchy{LossType::kCauchy, 3.0};  // a sensor may stick or jump altogether
constexpr double kVerticalPart = 0.005;  // of a displacement: what roll and pitch are off by

Mat3 InverseOf(const Vec3& sigma) { return sigma.cwiseInverse().asDiagonal(); }

}  // namespace

double CameraMotion::sigma_baseline_m() const {
  const double length = baseline_m();
  if (!(length > 0.0)) return std::sqrt(displacement_covariance_m2.trace());
  const Vec3 direction = start_from_end.translation / length;
  return std::sqrt(direction.dot(displacement_covariance_m2 * direction));
}

NavAid::NavAid(const MapperOptions& options, const Rigid3& body_from_camera, NavBuffer buffer)
    : body_from_camera_(body_from_camera),
      defaults_(Defaults(options)),
      buffer_(std::move(buffer)) {}

Expected<NavAid> NavAid::Create(const MapperOptions& options, const Rigid3& body_from_camera) {
  NavBufferOptions buffer_options;
  buffer_options.capacity = options.nav_samples;
  buffer_options.max_gap_s = options.nav_max_gap_s;
  auto buffer = NavBuffer::Create(buffer_options);
  if (!buffer) return tl::unexpected(buffer.error());
  return NavAid(options, body_from_camera, std::move(*buffer));
}

std::optional<NavMotion> NavAid::BodyMotion(Utime start, Utime end) const noexcept {
  std::optional<NavMotion> best;
  if (const auto motion = buffer_.DeadReckon(start, end, defaults_)) best = *motion;
  const NavSample a = buffer_.At(start), b = buffer_.At(end);
  const bool has_positions = a.Has(NavField::kPosition) && b.Has(NavField::kPosition) &&
                             a.Has(NavField::kAttitude) && b.Has(NavField::kAttitude);
  if (has_positions) {
    NavMotion motion;
    motion.displacement_ned_m = b.position_ned_m - a.position_ned_m;
    motion.ned_from_body_start = a.ned_from_body;
    motion.ned_from_body_end = b.ned_from_body;
    const Vec3 sigma = StatedOr(b.sigma_position_m, defaults_.sigma_position_m);
    motion.covariance_m2 = (2.0 * sigma.cwiseAbs2()).asDiagonal();
    if (!best || motion.covariance_m2.trace() < best->covariance_m2.trace()) best = motion;
  }
  return best;
}

std::optional<CameraMotion> NavAid::Motion(Utime start, Utime end) const noexcept {
  const std::optional<NavMotion> body = BodyMotion(start, end);
  if (!body) return std::nullopt;
  const Quat ned_from_start = body->ned_from_body_start * body_from_camera_.rotation;
  const Quat ned_from_end = body->ned_from_body_end * body_from_camera_.rotation;
  CameraMotion motion;
  motion.start_from_end = {
      (ned_from_start.conjugate() * ned_from_end).normalized(),
      ned_from_start.conjugate() * CameraDisplacement(*body, body_from_camera_)};
  const Mat3 start_from_ned = ned_from_start.conjugate().toRotationMatrix();
  motion.displacement_covariance_m2 =
      start_from_ned * body->covariance_m2 * start_from_ned.transpose();
  const Vec3 sigma = defaults_.sigma_attitude_rad;
  motion.rotation_covariance_rad2 = (2.0 * sigma.cwiseAbs2()).asDiagonal();  // of two attitudes
  return motion;
}

std::optional<Rigid3> NavAid::CameraFromNed(const NavSample& sample) const noexcept {
  if (!sample.Has(NavField::kAttitude)) return std::nullopt;
  Vec3 position = sample.Has(NavField::kPosition) ? sample.position_ned_m : Vec3::Zero();
  if (sample.Has(NavField::kDepth)) position.z() = sample.depth_m;
  return rsfm::CameraFromNed({sample.ned_from_body, position}, body_from_camera_);
}

Mat6 NavAid::CovarianceFromNed(const NavSample& sample, double heading_bias_rad) const noexcept {
  Mat6 covariance = Mat6::Zero();
  const Vec3 attitude = StatedOr(sample.sigma_attitude_rad, defaults_.sigma_attitude_rad);
  Vec3 turn = attitude.cwiseAbs2(), place = Vec3::Zero();
  turn.z() += heading_bias_rad * heading_bias_rad;
  if (sample.Has(NavField::kPosition))
    place = StatedOr(sample.sigma_position_m, defaults_.sigma_position_m).cwiseAbs2();
  if (sample.Has(NavField::kDepth))
    place.z() = std::pow(StatedOr(sample.sigma_depth_m, defaults_.sigma_depth_m), 2);
  const Mat3 camera_from_ned =
      (body_from_camera_.rotation.conjugate() * sample.ned_from_body.conjugate())
          .toRotationMatrix();
  covariance.topLeftCorner<3, 3>() =
      camera_from_ned * turn.asDiagonal() * camera_from_ned.transpose();
  covariance.bottomRightCorner<3, 3>() =
      camera_from_ned * place.asDiagonal() * camera_from_ned.transpose();
  return covariance;
}

std::optional<NavFactor> NavAid::AttitudeFactor(int keyframe, const NavSample& sample,
                                                const Vec3& rate_radps) const noexcept {
  if (!sample.Has(NavField::kAttitude)) return std::nullopt;
  NavFactor factor;
  factor.kind = NavFactorKind::kAttitude;
  factor.a = keyframe;
  factor.body_from_camera = body_from_camera_;
  factor.ned_from_body = sample.ned_from_body;
  factor.rate_radps = rate_radps;
  factor.sqrt_information =
      InverseOf(StatedOr(sample.sigma_attitude_rad, defaults_.sigma_attitude_rad));
  factor.loss = kHuber;
  return factor;
}

std::optional<NavFactor> NavAid::DepthFactor(int keyframe, const NavSample& sample,
                                             const Vec3& velocity_mps) const noexcept {
  if (!sample.Has(NavField::kDepth)) return std::nullopt;
  NavFactor factor;
  factor.kind = NavFactorKind::kDepth;
  factor.a = keyframe;
  factor.body_from_camera = body_from_camera_;
  factor.measured_m.z() = sample.depth_m;
  factor.velocity_mps = velocity_mps;
  factor.sqrt_information(0, 0) = 1.0 / StatedOr(sample.sigma_depth_m, defaults_.sigma_depth_m);
  factor.loss = kCauchy;
  return factor;
}

std::optional<NavFactor> NavAid::DisplacementFactor(int a, int b, Utime start,
                                                    Utime end) const noexcept {
  const auto sums = buffer_.IntegrateVelocity(start, end, defaults_);
  if (!sums) return std::nullopt;
  NavFactor factor;
  factor.kind = NavFactorKind::kDisplacement;
  factor.a = a;
  factor.b = b;
  factor.body_from_camera = body_from_camera_;
  factor.measured_m = sums->displacement_ned_m;
  factor.by_misalignment = sums->by_misalignment;
  factor.turned = sums->turned;
  factor.velocity_mps = sums->velocity_change_mps;
  Mat3 covariance = sums->covariance_m2 + 1e-8 * Mat3::Identity();
  const double vertical = kVerticalPart * sums->displacement_ned_m.norm();
  covariance(2, 2) += vertical * vertical;
  const Eigen::LLT<Mat3> cholesky(covariance);
  if (cholesky.info() != Eigen::Success) return std::nullopt;
  factor.sqrt_information = cholesky.matrixL().solve(Mat3::Identity());
  factor.loss = kCauchy;
  return factor;
}

std::optional<NavFactor> NavAid::PositionFactor(int keyframe, Utime utime, Utime begin, Utime end,
                                                const Vec3& velocity_mps) const noexcept {
  NavFactor factor;
  double nearest_s = -1.0;
  Vec3 sigma = Vec3::Zero();
  buffer_.ForEachPosition(begin, end, [&](Utime at, const Vec3& position, const Vec3& stated) {
    const double later_s = SecondsFromUs(at - utime);
    if (nearest_s >= 0.0 && std::abs(later_s) >= nearest_s) return;
    nearest_s = std::abs(later_s);
    factor.measured_m = position - later_s * velocity_mps;
    sigma = StatedOr(stated, defaults_.sigma_position_m) +
            Vec3::Constant(0.1 * velocity_mps.norm() * nearest_s);
  });
  if (nearest_s < 0.0) return std::nullopt;
  factor.kind = NavFactorKind::kPosition;
  factor.a = keyframe;
  factor.body_from_camera = body_from_camera_;
  factor.velocity_mps = velocity_mps;
  factor.sqrt_information = InverseOf(sigma);
  factor.loss = kCauchy;
  return factor;
}

}  // namespace rsfm
