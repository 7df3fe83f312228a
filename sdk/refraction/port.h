// What a port is: the interface of every housing window, as a concept.
#pragma once

#include <cmath>
#include <concepts>

#include "rsfm/base/linear.h"
#include "rsfm/base/ray3.h"
#include "rsfm/refraction/camera_config.h"
#include "rsfm/refraction/projection.h"

namespace rsfm {

// Points farther than this (metres) are refused as not finite, so that no square overflows.
inline constexpr double kMaxCoordinate = 1e100;
inline bool IsUsable(const Vec3& point) noexcept {
  return std::abs(point.x()) + std::abs(point.y()) + std::abs(point.z()) <=
         kMaxCoordinate;  // false for NaN
}

// Derivatives of the unit direction in air to the point in water (1/m) and to the port's
// parameters, whose order is that of camera_config.h. A flat port's normal is differentiated as a
// normalised vector: zero along itself.
struct AirJacobian {
  Mat3 d_direction_d_point;
  Eigen::Matrix<double, 3, kNumPortParams> d_direction_d_port;
};

// RefractToAir    a point in the water to the unit direction in air along which the lens sees it:
// the exact light path. RefractToWater  a unit direction in air to the ray in water: origin on the
// outer surface, unit direction. Both in the camera frame; outputs are untouched unless kOk. The
// Jacobians may be nullptr; d_direction_d_point alone is cheaper than all of AirJacobian.
template <class P>
concept Port = requires(const P port, const Vec3& vector, Vec3* direction, Ray3* ray,
                        Mat3* d_direction_d_point, AirJacobian* jacobian) {
  { port.RefractToAir(vector, direction) } -> std::same_as<Projection>;
  { port.RefractToAir(vector, direction, d_direction_d_point) } -> std::same_as<Projection>;
  { port.RefractToAir(vector, direction, jacobian) } -> std::same_as<Projection>;
  { port.RefractToWater(vector, ray) } -> std::same_as<Projection>;
  { port.Axis() } -> std::same_as<Vec3>;
};

}  // namespace rsfm
