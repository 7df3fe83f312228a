#include "rsfm/refraction/virtual_camera.h"

#include <algorithm>
#include <cmath>

namespace rsfm {

Projection ComputeVirtualCamera(const AnyCamera& camera, const Vec2& pixel,
                                VirtualCamera* result) noexcept {
  Ray3 ray;
  double range = 0.0;
  if (const Projection status = camera.Backproject(pixel, &ray, &range); status != Projection::kOk)
    return status;
  if (!(ray.direction.z() > 0.0)) return Projection::kOutsideLensDomain;
  const double nearest = ray.RangeTo(Vec3::Zero());
  const double reach = kMaxVirtualReach * (std::abs(nearest) + ray.origin.norm());
  if (!(range <= 0.0 && range >= -reach)) range = std::min(nearest, 0.0);
  const double focal = camera.MeanFocalLength();
  result->center_in_camera = ray.At(range);
  result->focal_px = focal;
  result->principal_point_px = pixel - Vec2(focal * ray.direction.x() / ray.direction.z(),
                                            focal * ray.direction.y() / ray.direction.z());
  return Projection::kOk;
}

}  // namespace rsfm
