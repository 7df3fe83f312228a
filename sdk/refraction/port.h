// What a port is: the interface of every housing window, as a concept.
#pragma once

#include <cmath>
#include <concepts>

#include "rsfm/base/linear.h"
#include "rsfm/base/ray3.h"
#include "rsfm/refraction/camera_config.h"
#include "rsfm/refraction/port_batch.h"
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
// normalised vector: zero along itself. d_direction_d_layers is written, and defined, for a port of
// several layers only.
struct AirJacobian {
  Mat3 d_direction_d_point;
  Eigen::Matrix<double, 3, kNumPortParams> d_direction_d_port;
  Eigen::Matrix<double, 3, kNumOuterLayerParams> d_direction_d_layers;
};

// Derivatives of the ray in water to the unit direction in air, of which only changes across the
// direction exist, and to the port's parameters as above.
struct WaterJacobian {
  Mat3 d_origin_d_air, d_direction_d_air;
  Eigen::Matrix<double, 3, kNumPortParams> d_origin_d_port, d_direction_d_port;
  Eigen::Matrix<double, 3, kNumOuterLayerParams> d_origin_d_layers, d_direction_d_layers;
};

// RefractToAir    a point in the water to the unit direction in air along which the lens sees it:
//                 the exact light path.
// RefractToWater  a unit direction in air to the ray in water: origin on the outer surface, unit
//                 direction.
// RangeToAxis     where along the line of the ray in water, whose direction in air is given, the
//                 refraction axis is met (negative: behind the surface; infinite: nowhere). In
//                 closed form, so that it has its limit where ray and axis coincide.
// All in the camera frame; outputs are untouched unless kOk. d_direction_d_point alone is cheaper
// than all of AirJacobian.
template <class P>
concept Port = requires(const P port, const Vec3& vector, const Ray3& in_water, Vec3* direction,
                        Ray3* ray, Mat3* d_direction_d_point, AirJacobian* air,
                        WaterJacobian* water, PortBlock* point_block, RayBlock* ray_block) {
  { port.RefractToAir(vector, direction) } -> std::same_as<Projection>;
  { port.RefractToAir(vector, direction, d_direction_d_point) } -> std::same_as<Projection>;
  { port.RefractToAir(vector, direction, air) } -> std::same_as<Projection>;
  { port.RefractToWater(vector, ray) } -> std::same_as<Projection>;
  { port.RefractToWater(vector, ray, water) } -> std::same_as<Projection>;
  // Settle what they can of a block; false where this port has no such path.
  { port.RefractToAir(point_block) } -> std::same_as<bool>;
  { port.RefractToWater(ray_block) } -> std::same_as<bool>;
  { port.RangeToAxis(vector, in_water) } -> std::same_as<double>;
  { port.Axis() } -> std::same_as<Vec3>;
  { port.NumOuterLayers() } -> std::same_as<int>;
  { port.IsNone() } -> std::same_as<bool>;  // directions in air and water are the same
};

}  // namespace rsfm
