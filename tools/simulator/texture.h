// Colour textures: 8-bit linear RGB and a fourth channel of one's own, bilinear, with a mip
// pyramid; and the painting of stones into them.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/simulator/scene.h"

namespace rsfm::simulator {

// Four channels in one vector register: red, green, blue, and the fourth. Arithmetic is per
// channel.
using Float4 = float __attribute__((vector_size(16)));

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
  void SetFourth(int x, int y, float value);  // [0, 1]
  // After painting, before sampling with level > 0.
  void BuildMips();

  // (u, v) in texels of level 0; level 0 is the finest and is rounded down, then clamped. Values in
  // [0, 1]. Precondition: u and v are finite and below 2^30 in size.
  Float4 Sample(float u, float v, float level) const;

 private:
  // In blocks of 4 x 4, one cache line each, so that a walk in any direction touches few of them.
  struct Level {
    int width = 0;
    int height = 0;
    std::size_t blocks_per_row = 0;
    std::vector<std::uint32_t> texels;  // 0xFFBBGGRR, F the fourth channel

    Level() = default;
    Level(int width_in, int height_in, std::uint32_t fill);
    std::size_t Index(int x, int y) const {
      return (static_cast<std::size_t>(y >> 2) * blocks_per_row + (x >> 2)) * 16 + (y & 3) * 4 +
             (x & 3);
    }
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
  float opacity = 1.0f;  // 0 paints nothing
  std::uint32_t seed = 1;
};
void PaintPebbles(const PebbleStyle& style, Texture* texture);

// Multiplies by 1 + amplitude * noise, `octaves` of it, the coarsest `period` cells to the
// texture's width. The result repeats with the texture, which is square.
struct TiledNoiseStyle {
  int period = 16;
  int octaves = 5;
  float gain = 0.8f;
  float amplitude = 0.2f;
  std::uint32_t seed = 1;
};
void PaintTiledNoise(const TiledNoiseStyle& style, int num_threads, Texture* texture);

}  // namespace rsfm::simulator
