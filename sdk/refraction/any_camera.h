// Any camera: RefractiveCamera over the closed sets of lenses and of ports, each dispatched to once
// per call, or once per block of a batch.
//
// Frames: the camera frame is x right, y down, z forward, its origin the lens's centre in air.
// Pixels as COLMAP has them: the centre of the top-left pixel is (0.5, 0.5). Metres. All functions
// are thread-safe, allocate nothing, throw nothing, and leave their outputs untouched on failure.
#pragma once

#include <span>

#include "rsfm/base/error.h"
#include "rsfm/base/ray3.h"
#include "rsfm/camera/any_lens.h"
#include "rsfm/refraction/any_port.h"
#include "rsfm/refraction/camera_config.h"
#include "rsfm/refraction/projection.h"
#include "rsfm/refraction/refractive_camera.h"

namespace rsfm {

class AnyCamera {
 public:
  // Checks everything a camera file can get wrong. kInvalidArgument; `where` is the field's name in
  // the camera file
  // ("params", "normal", "radius_m", ...), `detail` the index of the lens parameter for "params",
  // that of the layer, counted from the inside and from zero, for "layers".
  static Expected<AnyCamera> Create(const CameraConfig& config) noexcept;

  const CameraConfig& config() const { return config_; }
  int width() const { return config_.width; }
  int height() const { return config_.height; }

  // Point in the camera frame to pixel: the exact refracted path. The pixel may lie outside the
  // image.
  Projection Project(const Vec3& point_in_camera, Vec2* pixel) const noexcept;
  Projection Project(const Vec3& point_in_camera, Vec2* pixel,
                     Mat23* d_pixel_d_point) const noexcept;
  Projection Project(const Vec3& point_in_camera, Vec2* pixel,
                     CameraJacobian* jacobian) const noexcept;

  // Pixel to the ray in water: origin on the port's outer surface (the camera centre without a
  // port), unit direction.
  Projection Backproject(const Vec2& pixel, Ray3* ray_in_camera) const noexcept;
  // And its derivatives by pixel, lens and port.
  Projection Backproject(const Vec2& pixel, Ray3* ray_in_camera,
                         RayJacobian* jacobian) const noexcept;
  // And where along the ray's line, in metres from its origin, the refraction axis is met: negative
  // behind the surface, infinite where ray and axis are parallel. In closed form, so that it has
  // its limit where the two coincide (a pixel on the axis, a centred dome).
  Projection Backproject(const Vec2& pixel, Ray3* ray_in_camera,
                         double* range_to_axis) const noexcept;

  // The same in batches; all spans have the same length. Entries that fail keep their output and
  // get their status.
  void Project(std::span<const Vec3> points_in_camera, std::span<Vec2> pixels,
               std::span<Projection> statuses) const noexcept;
  void Backproject(std::span<const Vec2> pixels, std::span<Ray3> rays_in_camera,
                   std::span<Projection> statuses) const noexcept;

  bool IsInImage(const Vec2& pixel) const noexcept {
    return pixel.x() >= 0.0 && pixel.y() >= 0.0 && pixel.x() <= config_.width &&
           pixel.y() <= config_.height;
  }

  // The mean of the lens's focal lengths, px.
  double MeanFocalLength() const noexcept;

  // The axis on which every refracted ray's line has a point nearest to the camera: the flat port's
  // normal, the dome's decentring direction; the optical axis where there is no port or no
  // decentring.
  Vec3 RefractionAxis() const noexcept;

 private:
  using Composed = RefractiveCamera<AnyLens, AnyPort>;
  AnyCamera(const CameraConfig& config, const Composed& camera)
      : config_(config), camera_(camera) {}

  CameraConfig config_;
  Composed camera_;
};

}  // namespace rsfm
