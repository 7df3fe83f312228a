// Light in water: attenuation, backscatter, and the light of strobes carried by the vehicle.
//
//   I(channel) = albedo * E * exp(-c (r_camera + r_light)) + B (1 - exp(-b r_camera))
//   E = sum over strobes of cos(incidence) * beam(angle off its axis) / r_light^2, plus ambient
// [Jaffe 1990, IEEE J. Oceanic Eng. 15(2), single scattering; the form of Akkaynak & Treibitz 2018,
// CVPR, eq. (20), with coefficients b and c of their own for backscatter and direct signal]
#pragma once

#include <vector>

#include "tools/simulator/scene.h"

namespace rsfm::simulator {

struct Strobe {
  Vec3 position_in_camera = Vec3::Zero();  // metres
  double beam_angle_deg = 45.0;            // off its axis (the camera's z) where it gives half
};

struct WaterOptions {
  bool attenuation = true;
  Vec3 attenuation_per_m = Vec3(0.30, 0.075, 0.055);  // c: red, green, blue
  bool backscatter = true;
  Vec3 backscatter_level = Vec3(0.010, 0.045, 0.060);  // B, relative to white in the image
  Vec3 backscatter_per_m = Vec3(0.25, 0.16, 0.14);     // b
  bool strobe = true;                                  // off: an even light that does not fall off
  std::vector<Strobe> strobes = {{Vec3(-0.45, -0.15, 0.0), 50.0}, {Vec3(0.45, -0.15, 0.0), 50.0}};
  double ambient = 0.08;       // even light, relative to the strobes' at the exposed range
  double white_balance = 0.6;  // 0: colours as the water leaves them; 1: grey at the exposed range
};

// Tabulated: a few multiplications per sample. Immutable after construction, thread-safe.
class Water {
 public:
  // Exposes so that an albedo of 0.35, seen squarely at `exposed_range_m` on the camera's axis,
  // gives `grey` in the green channel (linear, 1 is white).
  Water(const WaterOptions& options, double exposed_range_m, double grey);

  // Linear image value of a surface. All in the camera frame, metres; range is from the camera.
  // The sum over `count` samples, where `albedo` is the sum of theirs.
  Rgb Shade(const Vec3f& point, const Vec3f& normal, float range_m, const Rgb& albedo,
            float count = 1.0f) const;
  // What is seen where nothing is hit.
  Rgb Veil() const { return veil_; }

 private:
  // exp(-k r) for the three channels at r = i * step; linear in between, error below 1e-4.
  class ExpTable {
   public:
    ExpTable() = default;
    ExpTable(const Vec3& per_m, bool enabled);
    Rgb At(float range_m) const;

   private:
    std::vector<Rgb> values_;
  };

  WaterOptions options_;
  ExpTable direct_;
  ExpTable scatter_;
  std::vector<Vec3f> strobe_positions_;
  std::vector<float> beam_inverse_widths_;
  float strobe_scale_ = 1.0f;
  float ambient_scale_ = 0.0f;
  Rgb gain_ = {1.0f, 1.0f, 1.0f};
  Rgb veil_ = {0.0f, 0.0f, 0.0f};
};

}  // namespace rsfm::simulator
