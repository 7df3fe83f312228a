// A lens behind a port, composed at compile time: any two types that keep the two concepts, those
// chosen at run time (AnyLens, AnyPort) among them.
#pragma once

#include <cstddef>
#include <span>

#include "rsfm/camera/lens.h"
#include "rsfm/refraction/port.h"

namespace rsfm {

// Derivatives of a projection. Columns beyond the lens's own number of parameters are zero, as is
// everything of a port that the camera has not. A flat port's normal is differentiated as a
// normalised vector: zero along itself.
struct CameraJacobian {
  Mat23 d_pixel_d_point;              // px / m
  LensParamsJacobian d_pixel_d_lens;  // px / lens parameter
  Eigen::Matrix<double, 2, kNumPortParams>
      d_pixel_d_port;  // px / port parameter, in the order of camera_config.h
  // px / thickness and index of every layer outside the first
  Eigen::Matrix<double, 2, kNumOuterLayerParams> d_pixel_d_layers;
};

// Derivatives of a back-projection: origin (m) and unit direction of the ray in water, by pixel,
// lens and port, in the same columns.
struct RayJacobian {
  Eigen::Matrix<double, 3, 2> d_origin_d_pixel, d_direction_d_pixel;
  Eigen::Matrix<double, 3, kMaxLensParams> d_origin_d_lens, d_direction_d_lens;
  Eigen::Matrix<double, 3, kNumPortParams> d_origin_d_port, d_direction_d_port;
  Eigen::Matrix<double, 3, kNumOuterLayerParams> d_origin_d_layers, d_direction_d_layers;
};

inline Projection FromLensStatus(LensStatus status) noexcept {
  switch (status) {
    case LensStatus::kOk:
      return Projection::kOk;
    case LensStatus::kBehind:
      return Projection::kBehindLens;
    case LensStatus::kOutsideDomain:
      return Projection::kOutsideLensDomain;
  }
  return Projection::kOutsideLensDomain;
}

template <LensMapping L, Port P>
struct RefractiveCamera {
  L lens;
  P port;

  Projection Project(const Vec3& point_in_camera, Vec2* pixel) const noexcept {
    if (port.IsNone()) return FromLensStatus(lens.Project(point_in_camera, pixel));
    Vec3 direction;
    const Projection status = port.RefractToAir(point_in_camera, &direction);
    return status == Projection::kOk ? FromLensStatus(lens.Project(direction, pixel)) : status;
  }

  Projection Project(const Vec3& point_in_camera, Vec2* pixel,
                     Mat23* d_pixel_d_point) const noexcept {
    if (port.IsNone()) return FromLensStatus(lens.Project(point_in_camera, pixel, d_pixel_d_point));
    Vec3 direction;
    Mat3 d_direction_d_point;
    if (const Projection status =
            port.RefractToAir(point_in_camera, &direction, &d_direction_d_point);
        status != Projection::kOk) {
      return status;
    }
    Mat23 d_pixel_d_direction;
    const LensStatus status = lens.Project(direction, pixel, &d_pixel_d_direction);
    if (status != LensStatus::kOk) return FromLensStatus(status);
    d_pixel_d_point->noalias() = d_pixel_d_direction.lazyProduct(d_direction_d_point);
    return Projection::kOk;
  }

  Projection Project(const Vec3& point_in_camera, Vec2* pixel,
                     CameraJacobian* jacobian) const noexcept {
    if (port.IsNone()) {
      const LensStatus status = lens.Project(point_in_camera, pixel, &jacobian->d_pixel_d_point,
                                             &jacobian->d_pixel_d_lens);
      if (status != LensStatus::kOk) return FromLensStatus(status);
      jacobian->d_pixel_d_port.setZero();
      jacobian->d_pixel_d_layers.setZero();
      return Projection::kOk;
    }
    Vec3 direction;
    AirJacobian air;
    if (const Projection status = port.RefractToAir(point_in_camera, &direction, &air);
        status != Projection::kOk) {
      return status;
    }
    Mat23 of_direction;
    if (const LensStatus status =
            lens.Project(direction, pixel, &of_direction, &jacobian->d_pixel_d_lens);
        status != LensStatus::kOk) {
      return FromLensStatus(status);
    }
    jacobian->d_pixel_d_point.noalias() = of_direction.lazyProduct(air.d_direction_d_point);
    jacobian->d_pixel_d_port.noalias() = of_direction.lazyProduct(air.d_direction_d_port);
    if (port.NumOuterLayers() == 0) {
      jacobian->d_pixel_d_layers.setZero();
    } else {
      jacobian->d_pixel_d_layers.noalias() = of_direction.lazyProduct(air.d_direction_d_layers);
    }
    return Projection::kOk;
  }

  // All spans have the same length.
  void Project(std::span<const Vec3> points, std::span<Vec2> pixels,
               std::span<Projection> statuses) const noexcept {
    std::size_t first = 0;
    PortBlock block;
    for (; first + kPortBlock <= points.size(); first += kPortBlock) {
      for (int i = 0; i < kPortBlock; ++i) {
        const Vec3& point = points[first + i];
        block.x[i] = point.x();
        block.y[i] = point.y();
        block.z[i] = point.z();
      }
      if (!port.RefractToAir(&block)) break;
      for (int i = 0; i < kPortBlock; ++i) {
        const std::size_t k = first + i;
        const Vec3 direction(block.direction_x[i], block.direction_y[i], block.direction_z[i]);
        statuses[k] = block.settled[i] != 0.0 ? FromLensStatus(lens.Project(direction, &pixels[k]))
                                              : Project(points[k], &pixels[k]);
      }
    }
    for (std::size_t k = first; k < points.size(); ++k)
      statuses[k] = Project(points[k], &pixels[k]);
  }

  Projection Backproject(const Vec2& pixel, Ray3* ray_in_camera) const noexcept {
    Vec3 direction;
    const LensStatus status = lens.Unproject(pixel, &direction);
    return status == LensStatus::kOk ? port.RefractToWater(direction, ray_in_camera)
                                     : FromLensStatus(status);
  }

  // And where along the ray's line, in metres, the refraction axis is met: Port::RangeToAxis.
  Projection Backproject(const Vec2& pixel, Ray3* ray_in_camera,
                         double* range_to_axis) const noexcept {
    Vec3 direction;
    if (const LensStatus status = lens.Unproject(pixel, &direction); status != LensStatus::kOk)
      return FromLensStatus(status);
    const Projection status = port.RefractToWater(direction, ray_in_camera);
    if (status == Projection::kOk) *range_to_axis = port.RangeToAxis(direction, *ray_in_camera);
    return status;
  }

  Projection Backproject(const Vec2& pixel, Ray3* ray_in_camera,
                         RayJacobian* jacobian) const noexcept;

  // All spans have the same length.
  void Backproject(std::span<const Vec2> pixels, std::span<Ray3> rays,
                   std::span<Projection> statuses) const noexcept;
};

// The lens's part by the implicit function theorem, in a basis B of the plane across the unit
// direction: with J = d pixel / d direction, d direction / d pixel = B (J B)^-1, and what a
// parameter does to the pixel the direction takes back.
template <LensMapping L, Port P>
Projection RefractiveCamera<L, P>::Backproject(const Vec2& pixel, Ray3* ray_in_camera,
                                               RayJacobian* jacobian) const noexcept {
  Vec3 direction;
  if (const LensStatus status = lens.Unproject(pixel, &direction); status != LensStatus::kOk)
    return FromLensStatus(status);
  Vec2 again;
  Mat23 of_direction;
  LensParamsJacobian of_params;
  if (const LensStatus status = lens.Project(direction, &again, &of_direction, &of_params);
      status != LensStatus::kOk) {
    return FromLensStatus(status);  // on the very edge of the domain
  }
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = direction.unitOrthogonal();
  basis.col(1) = direction.cross(basis.col(0));
  const Mat2 across = of_direction * basis;
  const double determinant = across(0, 0) * across(1, 1) - across(0, 1) * across(1, 0);
  if (determinant == 0.0) return Projection::kOutsideLensDomain;
  Mat2 inverse;
  inverse << across(1, 1), -across(0, 1), -across(1, 0), across(0, 0);
  inverse /= determinant;
  const Eigen::Matrix<double, 3, 2> of_pixel = basis * inverse;

  WaterJacobian water;
  if (const Projection status = port.RefractToWater(direction, ray_in_camera, &water);
      status != Projection::kOk) {
    return status;
  }
  jacobian->d_origin_d_pixel.noalias() = water.d_origin_d_air.lazyProduct(of_pixel);
  jacobian->d_direction_d_pixel.noalias() = water.d_direction_d_air.lazyProduct(of_pixel);
  jacobian->d_origin_d_lens.noalias() = (-jacobian->d_origin_d_pixel).lazyProduct(of_params);
  jacobian->d_direction_d_lens.noalias() = (-jacobian->d_direction_d_pixel).lazyProduct(of_params);
  jacobian->d_origin_d_port = water.d_origin_d_port;
  jacobian->d_direction_d_port = water.d_direction_d_port;
  if (port.NumOuterLayers() == 0) {
    jacobian->d_origin_d_layers.setZero();
    jacobian->d_direction_d_layers.setZero();
  } else {
    jacobian->d_origin_d_layers = water.d_origin_d_layers;
    jacobian->d_direction_d_layers = water.d_direction_d_layers;
  }
  return Projection::kOk;
}

template <LensMapping L, Port P>
void RefractiveCamera<L, P>::Backproject(std::span<const Vec2> pixels, std::span<Ray3> rays,
                                         std::span<Projection> statuses) const noexcept {
  static_assert(kLensBlock == kPortBlock);
  std::size_t first = 0;
  LensBlock in_air;
  RayBlock block;
  for (; first + kPortBlock <= pixels.size(); first += kPortBlock) {
    for (int i = 0; i < kPortBlock; ++i) {
      in_air.x[i] = pixels[first + i].x();
      in_air.y[i] = pixels[first + i].y();
    }
    lens.UnprojectBlock(&in_air);
    // Directions that have not settled are set right before the port sees them.
    for (int i = 0; i < kPortBlock; ++i) {
      block.air_x[i] = in_air.settled[i] != 0.0 ? in_air.direction_x[i] : 0.0;
      block.air_y[i] = in_air.settled[i] != 0.0 ? in_air.direction_y[i] : 0.0;
      block.air_z[i] = in_air.settled[i] != 0.0 ? in_air.direction_z[i] : 1.0;
    }
    if (!port.RefractToWater(&block)) break;
    for (int i = 0; i < kPortBlock; ++i) {
      const std::size_t k = first + i;
      if (block.settled[i] != 0.0 && in_air.settled[i] != 0.0) {
        rays[k].origin = Vec3(block.origin_x[i], block.origin_y[i], block.origin_z[i]);
        rays[k].direction = Vec3(block.water_x[i], block.water_y[i], block.water_z[i]);
        statuses[k] = Projection::kOk;
      } else {
        statuses[k] = Backproject(pixels[k], &rays[k]);
      }
    }
  }
  for (std::size_t k = first; k < pixels.size(); ++k)
    statuses[k] = Backproject(pixels[k], &rays[k]);
}

}  // namespace rsfm
