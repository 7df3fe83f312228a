#include "rsfm/refraction/any_camera.h"

#include <cmath>
#include <optional>

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

template <class L>
typename L::Params LensParams(const CameraConfig& config) {
  typename L::Params params;
  for (int i = 0; i < L::kNumParams; ++i) params[i] = config.lens_params[i];
  return params;
}

template <class L>
CameraVariant ComposePort(const CameraConfig& config) {
  const L lens(LensParams<L>(config));
  switch (config.port.type) {
    case PortType::kFlat:
      return RefractiveCamera<L, FlatPort>{lens, FlatPort(config.port)};
    case PortType::kDome:
      return RefractiveCamera<L, DomePort>{lens, DomePort(config.port)};
    case PortType::kNone:
      break;
  }
  return RefractiveCamera<L, NoPort>{lens, NoPort(config.port)};
}

template <class... Ls>
CameraVariant Compose(const CameraConfig& config, LensTypeList<Ls...>) {
  std::optional<CameraVariant> result;
  (void)((Ls::kModel == config.lens ? (result.emplace(ComposePort<Ls>(config)), true) : false) ||
         ...);
  return *result;  // CheckLens has found the model
}

}  // namespace

Expected<AnyCamera> AnyCamera::Create(const CameraConfig& config) noexcept {
  if (const Status status = CheckLens(config); !status) return tl::unexpected(status.error());
  if (const Status status = CheckPort(config.port); !status) return tl::unexpected(status.error());
  const CameraVariant camera = Compose(config, AllLenses{});
  // Parameters with which the model maps nothing (an angle of view of 180 degrees, a negative
  // beta).
  if (!std::visit([](const auto& c) { return c.lens.max_radius_squared() > 0.0; }, camera)) {
    return Fail(Errc::kInvalidArgument, "params", NumFocalLengths(config.lens) + 2);
  }
  return AnyCamera(config, camera);
}

Projection AnyCamera::Project(const Vec3& point_in_camera, Vec2* pixel) const noexcept {
  return std::visit([&](const auto& camera) { return camera.Project(point_in_camera, pixel); },
                    camera_);
}

Projection AnyCamera::Project(const Vec3& point_in_camera, Vec2* pixel,
                              Mat23* d_pixel_d_point) const noexcept {
  return std::visit(
      [&](const auto& camera) { return camera.Project(point_in_camera, pixel, d_pixel_d_point); },
      camera_);
}

Projection AnyCamera::Project(const Vec3& point_in_camera, Vec2* pixel,
                              CameraJacobian* jacobian) const noexcept {
  return std::visit(
      [&](const auto& camera) { return camera.Project(point_in_camera, pixel, jacobian); },
      camera_);
}

Projection AnyCamera::Backproject(const Vec2& pixel, Ray3* ray_in_camera) const noexcept {
  return std::visit([&](const auto& camera) { return camera.Backproject(pixel, ray_in_camera); },
                    camera_);
}

void AnyCamera::Project(std::span<const Vec3> points_in_camera, std::span<Vec2> pixels,
                        std::span<Projection> statuses) const noexcept {
  std::visit([&](const auto& camera) { camera.Project(points_in_camera, pixels, statuses); },
             camera_);
}

void AnyCamera::Backproject(std::span<const Vec2> pixels, std::span<Ray3> rays_in_camera,
                            std::span<Projection> statuses) const noexcept {
  std::visit(
      [&](const auto& camera) {
        for (std::size_t i = 0; i < pixels.size(); ++i) {
          statuses[i] = camera.Backproject(pixels[i], &rays_in_camera[i]);
        }
      },
      camera_);
}

double AnyCamera::MeanFocalLength() const noexcept {
  const auto& params = config_.lens_params;
  return NumFocalLengths(config_.lens) == 1 ? params[0] : 0.5 * (params[0] + params[1]);
}

Vec3 AnyCamera::RefractionAxis() const noexcept {
  return std::visit([](const auto& camera) { return camera.port.Axis(); }, camera_);
}

}  // namespace rsfm
