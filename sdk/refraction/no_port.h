// No port: the camera is in the medium itself, or its lens parameters already contain the water.
#pragma once

#include <cmath>

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
  Vec3 Axis() const noexcept { return Vec3::UnitZ(); }
};

}  // namespace rsfm
