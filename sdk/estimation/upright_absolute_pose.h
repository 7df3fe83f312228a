// Pose of a camera that knows which way is down, with or without a single centre, from two world
// points.
#pragma once

#include <span>

#include "rsfm/base/ray3.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/base/static_vector.h"

namespace rsfm {

inline constexpr int kUprightAbsoluteSampleSize = 2;
using UprightAbsoluteSolutions = StaticVector<Rigid3, 2>;

// camera_from_world with R down_in_world = down_in_camera exactly, such that each point lies on its
// own ray,  o_i + lambda_i d_i = R X_i + t,  lambda_i > 0. `down_in_camera`, `down_in_world`: unit,
// the same direction (gravity by an attitude sensor).
//   With both frames turned upright R is a turn about the vertical, which keeps heights and
// horizontal lengths: one linear and one quadratic equation in lambda_1, lambda_2.   [Kukelova
// 2010, ACCV, "Closed-Form Solutions to Minimal Absolute Pose Problems with Known Vertical
// Direction", for rays with origins of their own] None for points above one another, coincident or
// both on horizontal rays' planes, and when an input is not finite.
UprightAbsoluteSolutions SolveUprightAbsolutePose(
    std::span<const Ray3, kUprightAbsoluteSampleSize> rays_in_camera,
    std::span<const Vec3, kUprightAbsoluteSampleSize> points_in_world, const Vec3& down_in_camera,
    const Vec3& down_in_world) noexcept;

}  // namespace rsfm
