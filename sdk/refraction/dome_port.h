// A spherical shell of glass around a centre that need not be the camera's: a dome, thick and
// decentred in any direction.
//
// In the plane of the dome's centre, the camera and the point, every stretch of the light path has
// a distance b_k from the centre, and index_k b_k is the same for all (Bouguer's form of Snell's
// law, [Born & Wolf, Principles of Optics, sec. 3.2.1]). Each surface of radius rho turns the ray
// by asin(b_out / rho) - asin(b_in / rho). So with the direction to the point as the reference, the
// camera's ray at angle beta arrives where it should when
//   R sin(beta + turns(beta)) = b_water(beta),   R the point's distance from the centre:
// one equation in one unknown, without a singularity for a centred camera or a point on the axis.
// Turns are added as unit complex numbers, four square roots an evaluation; Halley's method from the
// paraxial path needs two. See docs/refraction.md.
#pragma once

#include "rsfm/refraction/port.h"

namespace rsfm {

class DomePort {
 public:
  // The most evaluations of the path equation: kMaxFastSteps by Halley's method, then the bracketed
  // search.
  static constexpr int kMaxFastSteps = 12;
  static constexpr int kMaxBracketSteps = 120;

  // Preconditions: as AnyCamera::Create checks.
  explicit DomePort(const PortConfig& config) noexcept;

  Projection RefractToAir(const Vec3& point, Vec3* direction) const noexcept;
  Projection RefractToAir(const Vec3& point, Vec3* direction,
                          Mat3* d_direction_d_point) const noexcept;
  Projection RefractToAir(const Vec3& point, Vec3* direction, AirJacobian* jacobian) const noexcept;
  Projection RefractToWater(const Vec3& direction, Ray3* ray) const noexcept;
  Projection RefractToWater(const Vec3& direction, Ray3* ray,
                            WaterJacobian* jacobian) const noexcept;
  bool RefractToAir(PortBlock* block) const noexcept;
  bool RefractToWater(RayBlock* block) const noexcept;
  double RangeToAxis(const Vec3& direction, const Ray3& ray) const noexcept;
  static constexpr bool IsNone() { return false; }
  int NumOuterLayers() const noexcept { return 0; }
  // The decentring direction; the optical axis for a centred dome.
  Vec3 Axis() const noexcept;

  // How many evaluations the search took for this point: for tests of the bound.
  int CountSteps(const Vec3& point) const noexcept;

 private:
  struct Plane;   // the point and the camera in the plane of the path
  struct Path;    // the path equation and its derivatives at one angle
  struct Frame3;  // the solved path in space, with what every derivative needs
  struct Trace;   // the path from the camera outwards
  struct TraceSlopes;
  TraceSlopes MakeSlopes(const Trace& trace) const noexcept;
  Projection TraceOut(const Vec3& direction, Trace* trace) const noexcept;
  DomeBlockParams BlockParams() const noexcept;
  bool Evaluate(const Plane& plane, double cosine, double sine, Path* path) const noexcept;
  Projection Solve(const Vec3& point, Plane* plane, Path* path) const noexcept;
  bool SolveBracketed(Plane* plane, Path* path) const noexcept;
  static Vec3 Direction(const Plane& plane, const Path& path) noexcept;
  Frame3 MakeFrame(const Plane& plane, const Path& path) const noexcept;

  Vec3 center_;
  double inner_, outer_;                // radii
  double index_[3];                     // air, glass, water
  double air_to_glass_, air_to_water_;  // index ratios
  double inner_squared_, outer_squared_;
  double per_inner_squared_, per_outer_squared_;
  double center_squared_;
  double paraxial_bend_;  // how much a ray is turned per distance from the centre, close to it
};

}  // namespace rsfm
