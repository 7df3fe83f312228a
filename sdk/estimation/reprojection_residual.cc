#include "rsfm/estimation/reprojection_residual.h"

namespace rsfm {
namespace {

// d (Exp(delta) x) / d delta = [-Hat(x), I], so a row j of d_pixel_d_point gives (x cross j, j).
Mat26 ChainToPose(const Mat23& d_pixel_d_point, const Vec3& point_in_camera) {
  Mat26 result;
  for (int row = 0; row < 2; ++row) {
    const Vec3 j = d_pixel_d_point.row(row).transpose();
    result.row(row).head<3>() = point_in_camera.cross(j).transpose();
  }
  result.rightCols<3>() = d_pixel_d_point;
  return result;
}

}  // namespace

Projection ReprojectionError(const AnyCamera& camera, const Rigid3& camera_from_world,
                             const Vec3& point_in_world, const Vec2& observed_px,
                             Vec2* error_px) noexcept {
  Vec2 pixel;
  const Projection status = camera.Project(camera_from_world * point_in_world, &pixel);
  if (status == Projection::kOk) *error_px = pixel - observed_px;
  return status;
}

Projection ReprojectionError(const AnyCamera& camera, const Rigid3& camera_from_world,
                             const Vec3& point_in_world, const Vec2& observed_px, Vec2* error_px,
                             Mat26* d_error_d_pose, Mat23* d_error_d_point) noexcept {
  const Mat3 rotation = camera_from_world.rotation.toRotationMatrix();
  const Vec3 point_in_camera = rotation * point_in_world + camera_from_world.translation;
  Vec2 pixel;
  Mat23 d_pixel_d_point;
  const Projection status = camera.Project(point_in_camera, &pixel, &d_pixel_d_point);
  if (status != Projection::kOk) return status;
  *error_px = pixel - observed_px;
  *d_error_d_pose = ChainToPose(d_pixel_d_point, point_in_camera);
  d_error_d_point->noalias() = d_pixel_d_point * rotation;
  return Projection::kOk;
}

Projection ReprojectionError(const AnyCamera& camera, const Rigid3& camera_from_world,
                             const Vec3& point_in_world, const Vec2& observed_px, Vec2* error_px,
                             ReprojectionJacobian* jacobian) noexcept {
  const Mat3 rotation = camera_from_world.rotation.toRotationMatrix();
  const Vec3 point_in_camera = rotation * point_in_world + camera_from_world.translation;
  Vec2 pixel;
  CameraJacobian of_camera;
  const Projection status = camera.Project(point_in_camera, &pixel, &of_camera);
  if (status != Projection::kOk) return status;
  *error_px = pixel - observed_px;
  jacobian->d_error_d_pose = ChainToPose(of_camera.d_pixel_d_point, point_in_camera);
  jacobian->d_error_d_point.noalias() = of_camera.d_pixel_d_point * rotation;
  jacobian->d_error_d_lens = of_camera.d_pixel_d_lens;
  jacobian->d_error_d_port = of_camera.d_pixel_d_port;
  return Projection::kOk;
}

}  // namespace rsfm
