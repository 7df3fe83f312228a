// Colour textures: 8-bit linear RGB and a fourth channel of one's own, bilinear, with a mip
// pyramid; and the painting of stones into them.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <vector>

#include "tools/simulator/scene.h"

namespace rsfm::simulator {

// log2 to 0.09, monotone and the same everywhere: good enough to choose a mip level.
inline float RoughLog2(float x) {
  const auto bits = std::bit_cast<std::uint32_t>(std::max(x, 1e-12f));
  return static_cast<float>(static_cast<int>(bits >> 23) - 127) +
         static_cast<float>(bits & 0x7FFFFFu) * 0x1.0p-23f;
}

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
  Edge edge() const { return edge_; }

  // Level 0 only; coordinates wrap or are ignored outside, as `edge` says.
  void Blend(int x, int y, const Rgb& colour, float opacity);
  void Multiply(int x, int y, const Rgb& factor);
  void SetFourth(int x, int y, float value);  // [0, 1]
  // After painting, before sampling with level > 0.
  void BuildMips();

  // (u, v) in texels of level 0; level 0 is the finest and is rounded down, then clamped. Values in
  // [0, 1]. Preconditions: `edge` is the texture's; u and v are finite and below 2^30 in size.
  template <Edge edge>
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
    std::size_t RowIndex(int y) const {
      return static_cast<std::size_t>(y >> 2) * blocks_per_row * 16 + (y & 3) * 4;
    }
    static std::size_t ColumnIndex(int x) {
      return static_cast<std::size_t>(x >> 2) * 16 + (x & 3);
    }
    std::size_t Index(int x, int y) const { return RowIndex(y) + ColumnIndex(x); }
  };

  std::uint32_t* TexelAt(int x, int y);

  Edge edge_ = Edge::kRepeat;
  std::vector<Level> levels_;
};

// The four bytes as floats: interleaved with zeros twice, which every SIMD unit has as one step.
inline Float4 WidenTexel(std::uint32_t packed) {
  using Bytes16 = std::uint8_t __attribute__((vector_size(16)));
  using Shorts8 = std::uint16_t __attribute__((vector_size(16)));
  using Words4 = std::uint32_t __attribute__((vector_size(16)));
  using Ints4 = std::int32_t __attribute__((vector_size(16)));
  const Bytes16 bytes = std::bit_cast<Bytes16>(Words4{packed, 0, 0, 0});
  const Bytes16 twos = __builtin_shuffle(
      bytes, Bytes16{}, Bytes16{0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23});
  const Shorts8 fours =
      __builtin_shuffle(std::bit_cast<Shorts8>(twos), Shorts8{}, Shorts8{0, 8, 1, 9, 2, 10, 3, 11});
  return __builtin_convertvector(std::bit_cast<Ints4>(fours), Float4);
}

template <Texture::Edge edge>
Float4 Texture::Sample(float u, float v, float level) const {
  const int l = std::clamp(static_cast<int>(level), 0, static_cast<int>(levels_.size()) - 1);
  const Level& texels = levels_[l];
  const float scale = std::bit_cast<float>((127u - static_cast<std::uint32_t>(l)) << 23);  // 2^-l
  u = u * scale - 0.5f;
  v = v * scale - 0.5f;
  const auto floor_of = [](float x) {
    const int i = static_cast<int>(x);
    return i - (x < static_cast<float>(i) ? 1 : 0);
  };
  int x0 = floor_of(u);
  int y0 = floor_of(v);
  const float fx = u - static_cast<float>(x0);
  const float fy = v - static_cast<float>(y0);
  int x1 = x0 + 1;
  int y1 = y0 + 1;
  if constexpr (edge == Edge::kRepeat) {
    x0 &= texels.width - 1;
    x1 &= texels.width - 1;
    y0 &= texels.height - 1;
    y1 &= texels.height - 1;
  } else {
    x0 = std::clamp(x0, 0, texels.width - 1);
    x1 = std::clamp(x1, 0, texels.width - 1);
    y0 = std::clamp(y0, 0, texels.height - 1);
    y1 = std::clamp(y1, 0, texels.height - 1);
  }
  const std::size_t row0 = texels.RowIndex(y0);
  const std::size_t row1 = texels.RowIndex(y1);
  const std::size_t column0 = Level::ColumnIndex(x0);
  const std::size_t column1 = Level::ColumnIndex(x1);
  const std::uint32_t* t = texels.texels.data();
  const float w11 = fx * fy;
  const float w01 = fy - w11;
  const float w10 = fx - w11;
  const float w00 = 1.0f - fx - w01;
  const Float4 sum = w00 * WidenTexel(t[row0 + column0]) + w10 * WidenTexel(t[row0 + column1]) +
                     w01 * WidenTexel(t[row1 + column0]) + w11 * WidenTexel(t[row1 + column1]);
  return sum * (1.0f / 255.0f);
}

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
void PaintPebbles(const PebbleStyle& style, int num_threads, Texture* texture);

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
