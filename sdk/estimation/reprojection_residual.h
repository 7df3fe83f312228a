// The true image error of a point, with analytic derivatives: the residual of every bundle
// adjustment here, on board and at the desk.
//
//   error = projection(camera, camera_from_world * point_in_world) - observed            [px]
//
// through the exact refracted path. Poses are perturbed on the left, (rotation, translation), see
// rigid3.h. All functions allocate nothing and leave their outputs untouched unless they return
// kOk.
#pragma once

#include "rsfm/base/rigid3.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

// What an observation that cannot be projected costs: an error of this length with zero
// derivatives. It pulls nothing, and a step that makes an observation impossible pays for it.
inline constexpr double kImpossibleErrorPx = 1000.0;

struct ReprojectionJacobian {
  Mat26 d_error_d_pose;                                     // px / (rad, m)
  Mat23 d_error_d_point;                                    // px / m, the point in the world
  Eigen::Matrix<double, 2, kMaxLensParams> d_error_d_lens;  // px / lens parameter
  Eigen::Matrix<double, 2, kNumPortParams> d_error_d_port;  // px / port parameter
};

// The error alone.
Projection ReprojectionError(const AnyCamera& camera, const Rigid3& camera_from_world,
                             const Vec3& point_in_world, const Vec2& observed_px,
                             Vec2* error_px) noexcept;

// The error with its derivatives to pose and point: a calibrated camera.
Projection ReprojectionError(const AnyCamera& camera, const Rigid3& camera_from_world,
                             const Vec3& point_in_world, const Vec2& observed_px, Vec2* error_px,
                             Mat26* d_error_d_pose, Mat23* d_error_d_point) noexcept;

// The error with its derivatives to everything.
Projection ReprojectionError(const AnyCamera& camera, const Rigid3& camera_from_world,
                             const Vec3& point_in_world, const Vec2& observed_px, Vec2* error_px,
                             ReprojectionJacobian* jacobian) noexcept;

// The derivative to the pose of a body that carries the camera, from that to the camera's own pose:
//   camera_from_world = camera_from_body * body_from_world.
// Exp(d) on the body is Exp(Adjoint(camera_from_body) d) on the camera.
inline Mat26 ChainToBody(const Mat26& d_error_d_camera_pose, const Rigid3& camera_from_body) {
  return d_error_d_camera_pose * AdjointSe3(camera_from_body);
}

}  // namespace rsfm
