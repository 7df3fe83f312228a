// A lens behind a port, composed at compile time.
#pragma once

#include <cstddef>
#include <span>
#include <type_traits>

#include "rsfm/camera/lens.h"
#include "rsfm/refraction/no_port.h"
#include "rsfm/refraction/port.h"
#include "rsfm/refraction/port_batch.h"

namespace rsfm {

// Derivatives of a projection. Columns beyond the lens's own number of parameters are zero, as is
// everything of a port that the camera has not. A flat port's normal is differentiated as a
// normalised vector: zero along itself.
struct CameraJacobian {
  Mat23 d_pixel_d_point;                                    // px / m
  Eigen::Matrix<double, 2, kMaxLensParams> d_pixel_d_lens;  // px / lens parameter
  Eigen::Matrix<double, 2, kNumPortParams>
      d_pixel_d_port;  // px / port parameter, in the order of camera_config.h
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

template <Lens L, Port P>
struct RefractiveCamera {
  L lens;
  P port;
  static constexpr bool kHasPort = !std::is_same_v<P, NoPort>;

  Projection Project(const Vec3& point_in_camera, Vec2* pixel) const noexcept {
    if constexpr (!kHasPort) {
      return FromLensStatus(lens.Project(point_in_camera, pixel));
    } else {
      Vec3 direction;
      const Projection status = port.RefractToAir(point_in_camera, &direction);
      return status == Projection::kOk ? FromLensStatus(lens.Project(direction, pixel)) : status;
    }
  }

  Projection Project(const Vec3& point_in_camera, Vec2* pixel,
                     Mat23* d_pixel_d_point) const noexcept {
    if constexpr (!kHasPort) {
      return FromLensStatus(lens.Project(point_in_camera, pixel, d_pixel_d_point));
    } else {
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
  }

  Projection Project(const Vec3& point_in_camera, Vec2* pixel,
                     CameraJacobian* jacobian) const noexcept {
    Vec3 direction = point_in_camera;
    AirJacobian air;
    if constexpr (kHasPort) {
      if (const Projection status = port.RefractToAir(point_in_camera, &direction, &air);
          status != Projection::kOk) {
        return status;
      }
    }
    LensJacobian<L::kNumParams> of_lens;
    if (const LensStatus status = lens.Project(direction, pixel, &of_lens);
        status != LensStatus::kOk) {
      return FromLensStatus(status);
    }
    jacobian->d_pixel_d_lens.setZero();
    jacobian->d_pixel_d_lens.template leftCols<L::kNumParams>() = of_lens.d_pixel_d_params;
    if constexpr (kHasPort) {
      jacobian->d_pixel_d_point.noalias() =
          of_lens.d_pixel_d_direction.lazyProduct(air.d_direction_d_point);
      jacobian->d_pixel_d_port.noalias() =
          of_lens.d_pixel_d_direction.lazyProduct(air.d_direction_d_port);
    } else {
      jacobian->d_pixel_d_point = of_lens.d_pixel_d_direction;
      jacobian->d_pixel_d_port.setZero();
    }
    return Projection::kOk;
  }

  // All spans have the same length.
  void Project(std::span<const Vec3> points, std::span<Vec2> pixels,
               std::span<Projection> statuses) const noexcept {
    std::size_t first = 0;
    if constexpr (kHasPort) {
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
          statuses[k] = block.settled[i] != 0.0
                            ? FromLensStatus(lens.Project(direction, &pixels[k]))
                            : Project(points[k], &pixels[k]);
        }
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
};

}  // namespace rsfm
