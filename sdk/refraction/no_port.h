// No port: the camera is in the medium itself, or its lens parameters already contain the water.
#pragma once

#include <cmath>
#include <limits>

#include "rsfm/refraction/port.h"

namespace rsfm {

class NoPort {
 public:
  explicit NoPort(const PortConfig& = {}) noexcept {}

  Projection RefractToAir(const Vec3& point, Vec3* direction) const noexcept {
    const double norm = point.norm();
    if (!(norm > 0.0)) return Projection::kBehindPort;
    *direction = point / norm;
    return Projection::kOk;
  }
  Projection RefractToAir(const Vec3& point, Vec3* direction,
                          Mat3* d_direction_d_point) const noexcept {
    const double norm = point.norm();
    if (!(norm > 0.0)) return Projection::kBehindPort;
    *direction = point / norm;
    *d_direction_d_point = (Mat3::Identity() - *direction * direction->transpose()) / norm;
    return Projection::kOk;
  }
  Projection RefractToAir(const Vec3& point, Vec3* direction,
                          AirJacobian* jacobian) const noexcept {
    jacobian->d_direction_d_port.setZero();
    return RefractToAir(point, direction, &jacobian->d_direction_d_point);
  }
  Projection RefractToWater(const Vec3& direction, Ray3* ray) const noexcept {
    *ray = {Vec3::Zero(), direction};
    return Projection::kOk;
  }
  Projection RefractToWater(const Vec3& direction, Ray3* ray,
                            WaterJacobian* jacobian) const noexcept {
    jacobian->d_origin_d_air.setZero();
    jacobian->d_direction_d_air.setIdentity();
    jacobian->d_origin_d_port.setZero();
    jacobian->d_direction_d_port.setZero();
    return RefractToWater(direction, ray);
  }
  bool RefractToAir(PortBlock*) const noexcept { return false; }
  bool RefractToWater(RayBlock* block) const noexcept {
    for (int i = 0; i < kPortBlock; ++i) {
      block->origin_x[i] = block->origin_y[i] = block->origin_z[i] = 0.0;
      block->water_x[i] = block->air_x[i];
      block->water_y[i] = block->air_y[i];
      block->water_z[i] = block->air_z[i];
      block->settled[i] = 1.0;
    }
    return true;
  }
  // All rays leave from the camera's centre, which is on any axis.
  double RangeToAxis(const Vec3&, const Ray3&) const noexcept { return 0.0; }
  Vec3 Axis() const noexcept { return Vec3::UnitZ(); }
  static constexpr bool IsNone() { return true; }
  int NumOuterLayers() const noexcept { return 0; }
};

}  // namespace rsfm
