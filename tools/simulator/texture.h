// Colour textures: 8-bit linear RGB, bilinear, with a mip pyramid; and the painting of stones into
// them.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/simulator/scene.h"

namespace rsfm {

class Texture {
 public:
  enum class Edge { kRepeat, kClamp };

  Texture() = default;
  // Both sizes are powers of two where `edge` is kRepeat. Starts as uniform `fill`.
  Texture(int width, int height, Edge edge, const Rgb& fill);

  int width() const { return levels_[0].width; }
  int height() const { return levels_[0].height; }

  // Level 0 only; coordinates wrap or are ignored outside, as `edge` says.
  void Blend(int x, int y, const Rgb& colour, float opacity);
  void Multiply(int x, int y, const Rgb& factor);
  // After painting, before sampling with level > 0.
  void BuildMips();

  // (u, v) in texels of level 0; level 0 is the finest and is rounded down, then clamped.
  Rgb Sample(float u, float v, float level) const;

 private:
  struct Level {
    int width = 0;
    int height = 0;
    std::vector<std::uint32_t> texels;  // 0x00BBGGRR
  };

  std::uint32_t* TexelAt(int x, int y);

  Edge edge_ = Edge::kRepeat;
  std::vector<Level> levels_;
};

// Roughly elliptical, shaded, speckled pebbles with radii from min to max (texels) by a power law:
// the number with a radius above r falls as r^-exponent.
struct PebbleStyle {
  int count = 0;
  float min_radius_px = 2.0f;
  float max_radius_px = 20.0f;
  float exponent = 2.0f;
  float contrast = 1.0f;  // 0 paints nothing, 1 the full range of tones
  std::uint32_t seed = 1;
};
void PaintPebbles(const PebbleStyle& style, Texture* texture);

// Multiplies by 1 + amplitude * noise, `octaves` of it, the coarsest `period` cells to the
// texture's width. The result repeats with the texture.
void PaintTiledNoise(int period, int octaves, float gain, float amplitude, std::uint32_t seed,
                     Texture* texture);

}  // namespace rsfm
