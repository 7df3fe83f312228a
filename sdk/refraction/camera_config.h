// What a camera file says: an in-air lens and the port in front of it. Plain data;
// AnyCamera::Create checks it.
#pragma once

#include <array>
#include <string_view>

#include "rsfm/base/linear.h"
#include "rsfm/base/static_vector.h"
#include "rsfm/camera/lens_model.h"

namespace rsfm {

enum class PortType : std::uint8_t { kNone, kFlat, kDome };

std::string_view ToString(PortType type) noexcept;  // "none", "flat", "dome"

// The order of the port's parameters in every parameter vector and Jacobian here, metres and
// ratios:
//   flat  nx ny nz distance thickness index_air index_glass index_water
//   dome  cx cy cz radius   thickness index_air index_glass index_water
// (the order that calibmar and colmap_underwater write).
inline constexpr int kNumPortParams = 8;
using PortParams = std::array<double, kNumPortParams>;

struct PortConfig {
  PortType type = PortType::kNone;
  Vec3 normal = Vec3::UnitZ();   // flat: unit, in the camera frame, towards the water
  double distance_m = 0.0;       // flat: camera centre to the inner surface, along the normal
  Vec3 center_m = Vec3::Zero();  // dome: its centre in the camera frame
  double radius_m = 0.0;         // dome: inner radius
  double thickness_m = 0.0;
  double index_air = 1.0;
  double index_glass = 1.52;
  double index_water = 1.334;

  PortParams Params() const noexcept;
  void SetParams(const PortParams& params) noexcept;
};

struct CameraConfig {
  LensModel lens = LensModel::kPinhole;
  int width = 0;   // px
  int height = 0;  // px
  StaticVector<double, kMaxLensParams> lens_params;
  PortConfig port;
};

}  // namespace rsfm
