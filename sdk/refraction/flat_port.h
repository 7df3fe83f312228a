// A flat window, thick and tilted in any direction, of one to four layers: glass, a film, a gap.
//
// In the plane of the axis (the normal n) and the point, with r the point's distance from the axis
// and z its height along it, the light path satisfies
//   distance tan(theta_air) + sum_k thickness_k tan(theta_k) + (z - end) tan(theta_water) = r,
// end = distance + sum_k thickness_k, with one unknown, the Snell invariant s = index_k
// sin(theta_k)   [Agrawal 2012, CVPR, sec. 4; She 2024]. Solved for u = tan(theta) in the medium of
// the lowest index: there the left side is a concave, increasing function of u, however many layers
// there are, so that Newton from below is monotone and cannot leave the branch. Halley's steps from
// the paraxial image need two evaluations; see docs/refraction.md.
#pragma once

#include "rsfm/refraction/port.h"

namespace rsfm {

class FlatPort {
 public:
  static constexpr int kMaxMedia = kMaxPortLayers + 2;  // air, layers, water
  // The bound on evaluations of the path equation; what wild inputs really take is measured in
  // tests/refraction/port_solver_test.cc.
  static constexpr int kMaxSteps = 40;

  // Preconditions: as AnyCamera::Create checks; the normal is normalised here.
  explicit FlatPort(const PortConfig& config) noexcept;

  Projection RefractToAir(const Vec3& point, Vec3* direction) const noexcept;
  Projection RefractToAir(const Vec3& point, Vec3* direction,
                          Mat3* d_direction_d_point) const noexcept;
  Projection RefractToAir(const Vec3& point, Vec3* direction, AirJacobian* jacobian) const noexcept;
  // Total internal reflection where a layer (a gap of air behind a denser first medium) or the
  // water is too thin to let the light through.
  Projection RefractToWater(const Vec3& direction, Ray3* ray) const noexcept;
  Projection RefractToWater(const Vec3& direction, Ray3* ray,
                            WaterJacobian* jacobian) const noexcept;
  // One layer only, and the first with air as the lowest medium only.
  bool RefractToAir(PortBlock* block) const noexcept;
  bool RefractToWater(RayBlock* block) const noexcept;
  double RangeToAxis(const Vec3& direction, const Ray3& ray) const noexcept;
  Vec3 Axis() const noexcept { return normal_; }
  static constexpr bool IsNone() { return false; }
  int NumOuterLayers() const noexcept { return num_media_ - 3; }

  // How many evaluations the path of this point took: for tests of the bound.
  int CountSteps(const Vec3& point) const noexcept;

 private:
  struct Path;   // the solved light path
  struct Slope;  // its derivatives to the invariant
  Projection Solve(const Vec3& point, Path* path) const noexcept;
  bool SolveThreeMedia(double r, double water, Path* path) const noexcept;
  bool SolveMoreMedia(double r, double water, Path* path) const noexcept;
  Vec3 Direction(const Path& path) const noexcept;
  Slope MakeSlope(const Path& path) const noexcept;
  Mat3 PointJacobian(const Path& path, const Slope& slope) const noexcept;

  Vec3 normal_;
  int num_media_;            // 3 for a single layer
  int lowest_;               // the medium of the lowest index
  double distance_;          // length_[0]
  double end_;               // of the last layer
  double apparent_;          // depth of all before the water, as seen from the water on the axis
  double index_[kMaxMedia];  // air, layers, water
  double length_[kMaxMedia - 1];  // of all but the water
  double ratio_[kMaxMedia];       // index_[lowest_] / index_[k]
  double excess_[kMaxMedia];      // 1 - ratio_^2, zero for the lowest itself
};

}  // namespace rsfm
