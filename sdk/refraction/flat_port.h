// A flat window of glass, thick and tilted in any direction.
//
// In the plane of the axis (the normal n) and the point, with r the point's distance from the axis
// and z its height along it, the light path satisfies
//   distance tan(theta_air) + thickness tan(theta_glass) + (z - distance - thickness)
//   tan(theta_water) = r
// with one unknown, the Snell invariant s = index_k sin(theta_k)   [Agrawal 2012, CVPR, sec. 4; She
// 2024]. Solved for u = tan(theta) in the medium of the lowest index: there the left side is a
// concave, increasing function of u, so that Newton from below is monotone and cannot leave the
// branch. Halley's steps from the paraxial image need two or three evaluations; see
// docs/refraction.md.
#pragma once

#include "rsfm/refraction/port.h"
#include "rsfm/refraction/port_batch.h"

namespace rsfm {

class FlatPort {
 public:
  // The most evaluations of the path equation that any valid input takes
  // (tests/refraction/port_solver_test.cc).
  static constexpr int kMaxSteps = 40;

  // Preconditions: as AnyCamera::Create checks; the normal is normalised here.
  explicit FlatPort(const PortConfig& config) noexcept;

  Projection RefractToAir(const Vec3& point, Vec3* direction) const noexcept;
  Projection RefractToAir(const Vec3& point, Vec3* direction,
                          Mat3* d_direction_d_point) const noexcept;
  Projection RefractToAir(const Vec3& point, Vec3* direction, AirJacobian* jacobian) const noexcept;
  Projection RefractToWater(const Vec3& direction, Ray3* ray) const noexcept;
  // Settles what it can of a block of points; false when this port has no such path.
  bool RefractToAir(PortBlock* block) const noexcept;
  Vec3 Axis() const noexcept { return normal_; }

  // How many evaluations the last stage took for this point: for tests of the bound.
  int CountSteps(const Vec3& point) const noexcept;

 private:
  struct Path;  // the solved light path
  Projection Solve(const Vec3& point, Path* path) const noexcept;
  Vec3 Direction(const Path& path) const noexcept;
  Mat3 PointJacobian(const Path& path) const noexcept;

  Vec3 normal_;
  double distance_, thickness_;
  double index_[3];        // air, glass, water
  int lowest_;             // the medium of the lowest index
  double ratio_[3];        // index_[lowest_] / index_[k]
  double excess_[3];       // 1 - ratio_^2, zero for the lowest itself
  double depth_ratio_[2];  // index_water / index_air, index_water / index_glass: apparent depths
};

}  // namespace rsfm
