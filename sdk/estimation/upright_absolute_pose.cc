#include "rsfm/estimation/upright_absolute_pose.h"

#include <cmath>

#include "rsfm/estimation/polynomial.h"

namespace rsfm {

UprightAbsoluteSolutions SolveUprightAbsolutePose(
    std::span<const Ray3, kUprightAbsoluteSampleSize> rays_in_camera,
    std::span<const Vec3, kUprightAbsoluteSampleSize> points_in_world, const Vec3& down_in_camera,
    const Vec3& down_in_world) noexcept {
  UprightAbsoluteSolutions solutions;
  const Quat upright_from_camera = Quat::FromTwoVectors(down_in_camera, Vec3::UnitZ());
  const Quat upright_from_world = Quat::FromTwoVectors(down_in_world, Vec3::UnitZ());
  const Vec3 direction_1 = upright_from_camera * rays_in_camera[0].direction;
  const Vec3 direction_2 = upright_from_camera * rays_in_camera[1].direction;
  const Vec3 origins = upright_from_camera * (rays_in_camera[0].origin - rays_in_camera[1].origin);
  const Vec3 points = upright_from_world * (points_in_world[0] - points_in_world[1]);
  const double horizontal = points.head<2>().norm();
  if (!direction_1.allFinite() || !direction_2.allFinite() || !origins.allFinite() ||
      !(horizontal > 1e-9 * points.norm()) || !std::isfinite(horizontal)) {
    return solutions;
  }
  // The heights: (d1z, -d2z) . lambda = height. The solutions are a foot plus mu along the line.
  const Vec2 slope(direction_1.z(), -direction_2.z());
  const double height = points.z() - origins.z();
  if (!(slope.squaredNorm() > 1e-20)) return solutions;
  const Vec2 foot = height / slope.squaredNorm() * slope;
  const Vec2 along(-slope.y() / slope.norm(), slope.x() / slope.norm());
  // The horizontal length: |base + mu step| = |points|.
  const Vec2 base =
      origins.head<2>() + foot[0] * direction_1.head<2>() - foot[1] * direction_2.head<2>();
  const Vec2 step = along[0] * direction_1.head<2>() - along[1] * direction_2.head<2>();
  double mu[2] = {0.0, 0.0};
  if (!SolveQuadratic(step.squaredNorm(), 2.0 * base.dot(step),
                      base.squaredNorm() - horizontal * horizontal, &mu[0], &mu[1])) {
    return solutions;
  }
  for (int k = 0; k < (mu[0] == mu[1] ? 1 : 2); ++k) {
    const Vec2 lambda = foot + mu[k] * along;
    if (!(lambda.minCoeff() > 0.0) || !lambda.allFinite()) continue;
    const Vec2 seen = base + mu[k] * step;
    const double theta =
        std::atan2(points.x() * seen.y() - points.y() * seen.x(), points.head<2>().dot(seen));
    const Quat turn(Eigen::AngleAxisd(theta, Vec3::UnitZ()));
    const Quat rotation =
        (upright_from_camera.conjugate() * turn * upright_from_world).normalized();
    const Vec3 translation = rays_in_camera[0].At(lambda[0]) - rotation * points_in_world[0];
    if (translation.allFinite() && rotation.coeffs().allFinite())
      solutions.TryPushBack({rotation, translation});
  }
  return solutions;
}

}  // namespace rsfm
