#include "rsfm/estimation/nav_factor.h"

#include <cmath>

namespace rsfm {
namespace {

void Attitude(const NavFactor& factor, const CarriedBody& body, const NavStates& states,
              NavEvaluation* result) {
  const Quat biased = ExpSo3(Vec3(0.0, 0.0, states[kHeadingBias]));
  const Vec3 drift = states[kClockOffset] * factor.rate_radps;
  const Quat moved = ExpSo3(drift);
  result->residual =
      LogSo3(moved * biased * Quat(body.world_from_body) * factor.ned_from_body.conjugate());
  const Mat3 chain = LeftJacobianInverseSo3(result->residual);
  const Mat3 moved_matrix = chain * moved.toRotationMatrix();
  result->d_residual_d_a.leftCols<3>() =
      -moved_matrix * biased.toRotationMatrix() * body.world_from_camera;
  result->d_residual_d_states.col(kHeadingBias) = moved_matrix.col(2);
  result->d_residual_d_states.col(kClockOffset) =
      chain * LeftJacobianSo3(drift) * factor.rate_radps;
}

void Displacement(const NavFactor& factor, const CarriedBody& a, const CarriedBody& b,
                  const NavStates& states, NavEvaluation* result) {
  const Mat3 biased = ExpSo3(Vec3(0.0, 0.0, states[kHeadingBias])).toRotationMatrix();
  const double scale = 1.0 + states[kVelocityScale];
  const Vec3 between = biased * (b.position - a.position);
  // The scale multiplies the poses and not the measurement: that one's noise would be squared in
  // the normal equations, and pull at a scale that little else holds.
  const Vec3 moved = between + states[kClockOffset] * factor.velocity_mps +
                     factor.turned * states.segment<3>(kVelocityLever);
  result->residual =
      scale * moved - factor.measured_m - factor.by_misalignment * states.segment<3>(kMisalignment);
  result->d_residual_d_a = -scale * biased * a.d_position;
  result->d_residual_d_b = scale * biased * b.d_position;
  auto& d_states = result->d_residual_d_states;
  d_states.col(kHeadingBias) = scale * Vec3::UnitZ().cross(between);
  d_states.col(kVelocityScale) = moved;
  d_states.middleCols<3>(kMisalignment) = -factor.by_misalignment;
  d_states.middleCols<3>(kVelocityLever) = scale * factor.turned;
  d_states.col(kClockOffset) = scale * factor.velocity_mps;
}

}  // namespace

CarriedBody::CarriedBody(const Rigid3& body_from_camera, const Rigid3& camera_from_world) noexcept {
  const Vec3 origin_in_camera = body_from_camera.OriginOfTarget();
  world_from_camera = camera_from_world.rotation.toRotationMatrix().transpose();
  world_from_body = world_from_camera * body_from_camera.rotation.toRotationMatrix().transpose();
  position = world_from_camera * (origin_in_camera - camera_from_world.translation);
  d_position.leftCols<3>() = world_from_camera * Hat(origin_in_camera);
  d_position.rightCols<3>() = -world_from_camera;
}

NavEvaluation EvaluateNavFactor(const NavFactor& factor, const Rigid3& camera_a_from_world,
                                const Rigid3& camera_b_from_world,
                                const NavStates& states) noexcept {
  NavEvaluation result;
  const CarriedBody a(factor.body_from_camera, camera_a_from_world);
  const double clock_s = states[kClockOffset];
  switch (factor.kind) {
    case NavFactorKind::kAttitude:
      Attitude(factor, a, states, &result);
      break;
    case NavFactorKind::kDisplacement:
      Displacement(factor, a, CarriedBody(factor.body_from_camera, camera_b_from_world), states,
                   &result);
      break;
    case NavFactorKind::kDepth:
      result.residual[0] =
          a.position.z() + clock_s * factor.velocity_mps.z() - factor.measured_m.z();
      result.d_residual_d_a.row(0) = a.d_position.row(2);
      result.d_residual_d_states(0, kClockOffset) = factor.velocity_mps.z();
      break;
    case NavFactorKind::kPosition:
      result.residual = a.position + clock_s * factor.velocity_mps - factor.measured_m;
      result.d_residual_d_a = a.d_position;
      result.d_residual_d_states.col(kClockOffset) = factor.velocity_mps;
      break;
  }
  result.residual = (factor.sqrt_information * result.residual).eval();
  result.d_residual_d_a = (factor.sqrt_information * result.d_residual_d_a).eval();
  result.d_residual_d_b = (factor.sqrt_information * result.d_residual_d_b).eval();
  result.d_residual_d_states = (factor.sqrt_information * result.d_residual_d_states).eval();
  return result;
}

Status ValidateNavFactor(const NavFactor& factor) noexcept {
  const bool is_pair = factor.kind == NavFactorKind::kDisplacement;
  if (factor.a < 0 || (is_pair && (factor.b < 0 || factor.b == factor.a)))
    return Fail(Errc::kInvalidArgument, "nav_factor.keyframe", factor.a);
  if (!factor.body_from_camera.translation.allFinite() ||
      !(std::abs(factor.body_from_camera.rotation.norm() - 1.0) < 1e-6))
    return Fail(Errc::kInvalidArgument, "nav_factor.body_from_camera");
  if (!(std::abs(factor.ned_from_body.norm() - 1.0) < 1e-6))
    return Fail(Errc::kInvalidArgument, "nav_factor.ned_from_body");
  if (!factor.measured_m.allFinite() || !factor.by_misalignment.allFinite() ||
      !factor.turned.allFinite())
    return Fail(Errc::kInvalidArgument, "nav_factor.measured");
  if (!factor.rate_radps.allFinite() || !factor.velocity_mps.allFinite())
    return Fail(Errc::kInvalidArgument, "nav_factor.rate");
  if (!factor.sqrt_information.allFinite() || !(factor.loss.scale > 0.0))
    return Fail(Errc::kInvalidArgument, "nav_factor.sqrt_information");
  return {};
}

}  // namespace rsfm
