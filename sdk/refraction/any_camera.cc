#include "rsfm/refraction/any_camera.h"

#include <cmath>

namespace rsfm {
namespace {

// A normal further from unit length than this is a mistake in the file, not rounding.
constexpr double kUnitTolerance = 1e-6;

Status CheckLens(const CameraConfig& config) {
  if (config.width <= 0) return Fail(Errc::kInvalidArgument, "width");
  if (config.height <= 0) return Fail(Errc::kInvalidArgument, "height");
  if (NumLensParams(config.lens) == 0) return Fail(Errc::kInvalidArgument, "model");
  if (static_cast<int>(config.lens_params.size()) != NumLensParams(config.lens)) {
    return Fail(Errc::kInvalidArgument, "params",
                static_cast<std::int32_t>(config.lens_params.size()));
  }
  for (std::size_t i = 0; i < config.lens_params.size(); ++i) {
    const bool is_focal = static_cast<int>(i) < NumFocalLengths(config.lens);
    const double value = config.lens_params[i];
    if (!std::isfinite(value) || (is_focal && value <= 0.0)) {
      return Fail(Errc::kInvalidArgument, "params", static_cast<std::int32_t>(i));
    }
  }
  return {};
}

Status CheckPort(const PortConfig& port) {
  if (port.type == PortType::kNone) return {};
  // Written so that NaN fails every test.
  if (!(port.thickness_m >= 0.0 && port.thickness_m <= 10.0))
    return Fail(Errc::kInvalidArgument, "thickness_m");
  if (!(port.index_air >= 1.0 && port.index_air <= 4.0))
    return Fail(Errc::kInvalidArgument, "index_air");
  if (!(port.index_glass >= 1.0 && port.index_glass <= 4.0))
    return Fail(Errc::kInvalidArgument, "index_glass");
  if (!(port.index_water >= 1.0 && port.index_water <= 4.0))
    return Fail(Errc::kInvalidArgument, "index_water");
  for (std::size_t i = 0; i < port.outer_layers.size(); ++i) {
    const PortLayer& layer = port.outer_layers[i];
    if (port.type != PortType::kFlat || !(layer.thickness_m >= 0.0 && layer.thickness_m <= 10.0) ||
        !(layer.index >= 1.0 && layer.index <= 4.0)) {
      return Fail(Errc::kInvalidArgument, "layers", static_cast<std::int32_t>(i) + 1);
    }
  }
  if (port.type == PortType::kFlat) {
    if (!(std::abs(port.normal.norm() - 1.0) <= kUnitTolerance))
      return Fail(Errc::kInvalidArgument, "normal");
    if (!(port.normal.z() > 0.0)) return Fail(Errc::kInvalidArgument, "normal");
    if (!(port.distance_m >= 0.0 && port.distance_m <= 10.0))
      return Fail(Errc::kInvalidArgument, "distance_m");
  } else {
    if (!(port.radius_m > 0.0 && port.radius_m <= 10.0))
      return Fail(Errc::kInvalidArgument, "radius_m");
    if (!(port.center_m.norm() < port.radius_m)) return Fail(Errc::kInvalidArgument, "center_m");
  }
  return {};
}

}  // namespace

Expected<AnyCamera> AnyCamera::Create(const CameraConfig& config) noexcept {
  if (const Status status = CheckLens(config); !status) return tl::unexpected(status.error());
  if (const Status status = CheckPort(config.port); !status) return tl::unexpected(status.error());
  const auto lens =
      AnyLens::Create(config.lens, {config.lens_params.data(), config.lens_params.size()});
  if (!lens) return Fail(Errc::kInvalidArgument, "model");
  // Parameters with which the model maps nothing (an angle of view of 180 degrees, a negative
  // beta).
  if (!(lens->max_radius_squared() > 0.0))
    return Fail(Errc::kInvalidArgument, "params", NumFocalLengths(config.lens) + 2);
  return AnyCamera(config, Composed{*lens, AnyPort(config.port)});
}

Projection AnyCamera::Project(const Vec3& point_in_camera, Vec2* pixel) const noexcept {
  return camera_.Project(point_in_camera, pixel);
}

Projection AnyCamera::Project(const Vec3& point_in_camera, Vec2* pixel,
                              Mat23* d_pixel_d_point) const noexcept {
  return camera_.Project(point_in_camera, pixel, d_pixel_d_point);
}

Projection AnyCamera::Project(const Vec3& point_in_camera, Vec2* pixel,
                              CameraJacobian* jacobian) const noexcept {
  return camera_.Project(point_in_camera, pixel, jacobian);
}

Projection AnyCamera::Backproject(const Vec2& pixel, Ray3* ray_in_camera) const noexcept {
  return camera_.Backproject(pixel, ray_in_camera);
}

Projection AnyCamera::Backproject(const Vec2& pixel, Ray3* ray_in_camera,
                                  RayJacobian* jacobian) const noexcept {
  return camera_.Backproject(pixel, ray_in_camera, jacobian);
}

Projection AnyCamera::Backproject(const Vec2& pixel, Ray3* ray_in_camera,
                                  double* range_to_axis) const noexcept {
  return camera_.Backproject(pixel, ray_in_camera, range_to_axis);
}

void AnyCamera::Project(std::span<const Vec3> points_in_camera, std::span<Vec2> pixels,
                        std::span<Projection> statuses) const noexcept {
  camera_.Project(points_in_camera, pixels, statuses);
}

void AnyCamera::Backproject(std::span<const Vec2> pixels, std::span<Ray3> rays_in_camera,
                            std::span<Projection> statuses) const noexcept {
  camera_.Backproject(pixels, rays_in_camera, statuses);
}

double AnyCamera::MeanFocalLength() const noexcept {
  const auto& params = config_.lens_params;
  return NumFocalLengths(config_.lens) == 1 ? params[0] : 0.5 * (params[0] + params[1]);
}

Vec3 AnyCamera::RefractionAxis() const noexcept { return camera_.port.Axis(); }

}  // namespace rsfm
