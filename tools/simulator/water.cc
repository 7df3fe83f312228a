#include "tools/simulator/water.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace rsfm::simulator {
namespace {

constexpr float kTableStepM = 0.02f;
constexpr int kTableSize = 4096;  // to 82 m; nothing is left of the light there
constexpr double kExposedAlbedo = 0.35;

// A strobe's brightness off its axis: smooth, 1 on the axis, a half where 1 - cosine is the width.
float BeamProfile(float cosine, float inverse_width) {
  const float x = (1.0f - cosine) * inverse_width;
  return 1.0f / (1.0f + x * x);
}

}  // namespace

Water::ExpTable::ExpTable(const Vec3& per_m, bool enabled) : values_(kTableSize + 1) {
  for (int i = 0; i <= kTableSize; ++i) {
    for (int c = 0; c < 3; ++c) {
      values_[i][c] = enabled ? static_cast<float>(std::exp(-per_m[c] * i * kTableStepM)) : 1.0f;
    }
  }
}

Rgb Water::ExpTable::At(float range_m) const {
  const float position =
      std::clamp(range_m * (1.0f / kTableStepM), 0.0f, static_cast<float>(kTableSize) - 0.001f);
  const int i = static_cast<int>(position);
  const float fraction = position - static_cast<float>(i);
  const Rgb& low = values_[i];
  const Rgb& high = values_[i + 1];
  return {low[0] + fraction * (high[0] - low[0]), low[1] + fraction * (high[1] - low[1]),
          low[2] + fraction * (high[2] - low[2])};
}

Water::Water(const WaterOptions& options, double exposed_range_m, double grey)
    : options_(options),
      direct_(options.attenuation_per_m, options.attenuation),
      scatter_(options.backscatter_per_m, options.backscatter) {
  if (options_.strobe) {
    for (const Strobe& strobe : options_.strobes) {
      strobe_positions_.push_back(strobe.position_in_camera.cast<float>());
      const double half = 1.0 - std::cos(strobe.beam_angle_deg * std::numbers::pi / 180.0);
      beam_inverse_widths_.push_back(static_cast<float>(1.0 / std::max(half, 1e-6)));
    }
  }
  // Exposure: first with gain 1 at the reference, then scaled to the asked grey.
  const auto range = static_cast<float>(exposed_range_m);
  const Vec3f point(0.0f, 0.0f, range);
  const Vec3f normal(0.0f, 0.0f, -1.0f);
  const auto albedo = static_cast<float>(kExposedAlbedo);
  if (!strobe_positions_.empty()) {
    // The strobes' own irradiance at the reference becomes 1.
    float bare = 0.0f;
    for (std::size_t i = 0; i < strobe_positions_.size(); ++i) {
      const Vec3f from_light = point - strobe_positions_[i];
      const float distance = from_light.norm();
      const float cosine = from_light.z() / distance;
      bare += cosine * BeamProfile(cosine, beam_inverse_widths_[i]) / (distance * distance);
    }
    strobe_scale_ = 1.0f / std::max(bare, 1e-9f);
    ambient_scale_ = static_cast<float>(options_.ambient);
  } else {
    ambient_scale_ = 1.0f;
  }
  const Rgb exposed = Shade(point, normal, range, {albedo, albedo, albedo});
  for (int c = 0; c < 3; ++c) {
    const double balance = std::pow(exposed[1] / exposed[c], options_.white_balance);
    gain_[c] = static_cast<float>(grey / exposed[1] * balance);
  }
  for (int c = 0; c < 3; ++c) {
    veil_[c] = options_.backscatter ? static_cast<float>(options_.backscatter_level[c]) : 0.0f;
  }
}

Rgb Water::Shade(const Vec3f& point, const Vec3f& normal, float range_m, const Rgb& albedo,
                 float count) const {
  Rgb light = {0.0f, 0.0f, 0.0f};
  for (std::size_t i = 0; i < strobe_positions_.size(); ++i) {
    const Vec3f from_light = point - strobe_positions_[i];
    const float squared = from_light.squaredNorm();
    const float distance = std::sqrt(squared);
    const float inverse = 1.0f / std::max(distance, 1e-3f);
    const float incidence = std::max(0.0f, -from_light.dot(normal) * inverse);
    const float beam = BeamProfile(from_light.z() * inverse, beam_inverse_widths_[i]);
    const float level = strobe_scale_ * incidence * beam * inverse * inverse;
    const Rgb direct = direct_.At(range_m + distance);
    for (int c = 0; c < 3; ++c) light[c] += level * direct[c];
  }
  const Rgb ambient = direct_.At(range_m);
  const Rgb scatter = scatter_.At(range_m);
  Rgb value;
  for (int c = 0; c < 3; ++c) {
    light[c] += ambient_scale_ * ambient[c];
    value[c] = gain_[c] * albedo[c] * light[c] + count * veil_[c] * (1.0f - scatter[c]);
  }
  return value;
}

}  // namespace rsfm::simulator
