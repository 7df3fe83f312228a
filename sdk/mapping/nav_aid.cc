#include "rsfm/mapping/nav_aid.h"

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
  return defaults;
}

std::optional<PosePrior> Robust(Expected<PosePrior> prior) {
  if (!prior) return std::nullopt;
  prior->loss = {LossType::kHuber, 3.0};
  return *prior;
}

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
  motion.rotation_covariance_rad2 = sigma.cwiseAbs2().asDiagonal();
  return motion;
}

std::optional<Rigid3> NavAid::CameraFromNed(const NavSample& sample) const noexcept {
  if (!sample.Has(NavField::kAttitude)) return std::nullopt;
  Vec3 position = sample.Has(NavField::kPosition) ? sample.position_ned_m : Vec3::Zero();
  if (sample.Has(NavField::kDepth)) position.z() = sample.depth_m;
  return rsfm::CameraFromNed({sample.ned_from_body, position}, body_from_camera_);
}

std::optional<PosePrior> NavAid::PositionPrior(int keyframe,
                                               const NavSample& sample) const noexcept {
  if (!sample.Has(NavField::kPosition)) return std::nullopt;
  return Robust(MakePositionPrior(keyframe, body_from_camera_, sample.position_ned_m,
                                  StatedOr(sample.sigma_position_m, defaults_.sigma_position_m)));
}

std::optional<PosePrior> NavAid::AttitudePrior(int keyframe,
                                               const NavSample& sample) const noexcept {
  if (!sample.Has(NavField::kAttitude)) return std::nullopt;
  return Robust(
      MakeAttitudePrior(keyframe, body_from_camera_, sample.ned_from_body,
                        StatedOr(sample.sigma_attitude_rad, defaults_.sigma_attitude_rad)));
}

std::optional<PosePrior> NavAid::DepthPrior(int keyframe, const NavSample& sample) const noexcept {
  if (!sample.Has(NavField::kDepth)) return std::nullopt;
  return Robust(MakeDepthPrior(keyframe, body_from_camera_, sample.depth_m,
                               StatedOr(sample.sigma_depth_m, defaults_.sigma_depth_m)));
}

std::optional<PosePrior> NavAid::DisplacementPrior(int a, int b, Utime start,
                                                   Utime end) const noexcept {
  const auto motion = buffer_.DeadReckon(start, end, defaults_);
  if (!motion) return std::nullopt;
  const Mat3 body_from_ned = motion->ned_from_body_start.conjugate().toRotationMatrix();
  const Mat3 covariance = body_from_ned * motion->covariance_m2 * body_from_ned.transpose();
  return Robust(MakeDisplacementPrior(a, b, body_from_camera_,
                                      body_from_ned * motion->displacement_ned_m,
                                      covariance.diagonal().cwiseSqrt().cwiseMax(1e-4)));
}

}  // namespace rsfm
