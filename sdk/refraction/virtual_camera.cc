#include "rsfm/refraction/virtual_camera.h"

#include <algorithm>

namespace rsfm {
namespace {

// Sine of the angle between ray and axis below which their intersection is not computed.
constexpr double kMinSine = 1e-4;

}  // namespace

Projection ComputeVirtualCamera(const AnyCamera& camera, const Vec2& pixel,
                                VirtualCamera* result) noexcept {
  Ray3 ray;
  if (const Projection status = camera.Backproject(pixel, &ray); status != Projection::kOk)
    return status;
  if (!(ray.direction.z() > 0.0)) return Projection::kOutsideLensDomain;
  const Vec3 axis = camera.RefractionAxis();
  const Vec3 across = ray.direction - axis.dot(ray.direction) * axis;
  const double sine_squared = across.squaredNorm();
  // Nearest to the camera centre, and never ahead of the ray's origin: the point would lie behind
  // the virtual camera.
  double range = std::min(ray.RangeTo(Vec3::Zero()), 0.0);
  if (sine_squared > kMinSine * kMinSine) {
    const double to_axis = -across.dot(ray.origin) / sine_squared;
    if (to_axis <= 0.0) range = to_axis;
  }
  const double focal = camera.MeanFocalLength();
  result->center_in_camera = ray.At(range);
  result->focal_px = focal;
  result->principal_point_px = pixel - Vec2(focal * ray.direction.x() / ray.direction.z(),
                                            focal * ray.direction.y() / ray.direction.z());
  return Projection::kOk;
}

}  // namespace rsfm
