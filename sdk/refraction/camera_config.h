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

// A flat port may have more than one layer: a window, a film, a gap of air.
inline constexpr int kMaxPortLayers = 4;
struct PortLayer {
  double thickness_m = 0.0;
  double index = 1.0;
};
// The parameters of the layers outside the first, in Jacobians: thickness and index of each, from
// the inside out.
inline constexpr int kNumOuterLayerParams = 2 * (kMaxPortLayers - 1);

struct PortConfig {
  PortType type = PortType::kNone;
  Vec3 normal = Vec3::UnitZ();   // flat: unit, in the camera frame, towards the water
  double distance_m = 0.0;       // flat: camera centre to the inner surface, along the normal
  Vec3 center_m = Vec3::Zero();  // dome: its centre in the camera frame
  double radius_m = 0.0;         // dome: inner radius
  double thickness_m = 0.0;      // of the first, innermost layer; index_glass is its index
  double index_air = 1.0;
  double index_glass = 1.52;
  double index_water = 1.334;
  // flat: what lies between the first layer and the water, from the inside out; mostly nothing
  StaticVector<PortLayer, kMaxPortLayers - 1> outer_layers;

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
