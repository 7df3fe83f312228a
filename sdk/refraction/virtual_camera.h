// Virtual cameras: for each pixel a pinhole camera on the refraction axis that sees the pixel's ray
// in water perspectively.   [Telem & Filin 2010; She 2024, arXiv:2403.08640, "Virtual Camera
// Computation", eq. (2)]
#pragma once

#include "rsfm/refraction/any_camera.h"

namespace rsfm {

// Same rotation as the camera; mean focal length; principal point such that the observed pixel is
// kept.
struct VirtualCamera {
  Vec3 center_in_camera = Vec3::Zero();  // metres
  double focal_px = 0.0;
  Vec2 principal_point_px = Vec2::Zero();

  // Precondition: the point is in front of the virtual centre.
  Vec2 Project(const Vec3& point_in_camera) const {
    const Vec3 p = point_in_camera - center_in_camera;
    return Vec2(focal_px * p.x() / p.z(), focal_px * p.y() / p.z()) + principal_point_px;
  }
};

// The farthest that a virtual centre may lie behind the surface, over the size of the port.
inline constexpr double kMaxVirtualReach = 100.0;

// The centre is where the ray's line meets the refraction axis, in closed form: continuous where
// ray and axis coincide and where the camera is nearly central (the camera's own centre in the
// limit). A decentred dome may send a ray parallel to its axis, or make them meet ahead of the
// surface, where no camera can stand; then, and beyond kMaxVirtualReach, the point of the ray's
// line nearest to the camera centre is taken, which is on the same line, so that the virtual camera
// still sees the ray exactly. kOutsideLensDomain for rays that do not look forward (z <= 0), for
// which a perspective camera does not exist.
Projection ComputeVirtualCamera(const AnyCamera& camera, const Vec2& pixel,
                                VirtualCamera* result) noexcept;

}  // namespace rsfm
