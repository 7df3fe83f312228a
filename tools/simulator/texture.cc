#include "tools/simulator/texture.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "rsfm/base/rng.h"
#include "tools/simulator/noise.h"
#include "tools/simulator/parallel.h"

namespace rsfm::simulator {
namespace {

using Bytes16 = std::uint8_t __attribute__((vector_size(16)));
using Shorts8 = std::uint16_t __attribute__((vector_size(16)));
using Words4 = std::uint32_t __attribute__((vector_size(16)));
using Ints4 = std::int32_t __attribute__((vector_size(16)));

// The colour's bytes over those of `below`, whose fourth channel stays.
std::uint32_t Pack(const Rgb& colour, std::uint32_t below) {
  std::uint32_t packed = below & 0xFF000000u;
  for (int i = 0; i < 3; ++i) {
    const float value = std::clamp(colour[i], 0.0f, 1.0f);
    packed |= static_cast<std::uint32_t>(value * 255.0f + 0.5f) << (8 * i);
  }
  return packed;
}

Rgb Unpack(std::uint32_t packed) {
  Rgb colour;
  for (int i = 0; i < 3; ++i) {
    colour[i] = static_cast<float>((packed >> (8 * i)) & 0xFFu) * (1.0f / 255.0f);
  }
  return colour;
}

// The four bytes as floats: interleaved with zeros twice, which every SIMD unit has as one step.
Float4 Widen(std::uint32_t packed) {
  const Bytes16 bytes = std::bit_cast<Bytes16>(Words4{packed, 0, 0, 0});
  const Bytes16 twos = __builtin_shuffle(
      bytes, Bytes16{}, Bytes16{0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23});
  const Shorts8 fours =
      __builtin_shuffle(std::bit_cast<Shorts8>(twos), Shorts8{}, Shorts8{0, 8, 1, 9, 2, 10, 3, 11});
  return __builtin_convertvector(std::bit_cast<Ints4>(fours), Float4);
}

Float4 Blend2(std::uint32_t a, std::uint32_t b, float fraction) {
  const Float4 from = Widen(a);
  return from + fraction * (Widen(b) - from);
}

int Floor(float x) {
  const int i = static_cast<int>(x);
  return i - (x < static_cast<float>(i) ? 1 : 0);
}

// Stones of a seabed: greys and browns, some white shell, some dark weed, a little red algae.
Rgb PebbleColour(Rng* rng) {
  const double kind = rng->Uniform();
  const float tone = static_cast<float>(rng->Uniform());
  if (kind < 0.10) return {0.75f + 0.20f * tone, 0.72f + 0.20f * tone, 0.66f + 0.20f * tone};
  if (kind < 0.32) return {0.04f + 0.08f * tone, 0.05f + 0.08f * tone, 0.05f + 0.06f * tone};
  if (kind < 0.36) return {0.30f + 0.22f * tone, 0.16f + 0.12f * tone, 0.15f + 0.11f * tone};
  if (kind < 0.40) return {0.14f + 0.12f * tone, 0.19f + 0.14f * tone, 0.10f + 0.08f * tone};
  const float warm = static_cast<float>(rng->Uniform(0.75, 1.0));
  const float grey = 0.10f + 0.50f * tone;
  return {grey, grey * (0.6f + 0.4f * warm), grey * warm * 0.9f};
}

struct Pebble {
  float x, y, radius, aspect, cosine, sine, opacity;
  Rgb colour;
  std::uint32_t seed;
};

void PaintPebble(const Pebble& p, Texture* texture) {
  const int reach = static_cast<int>(std::ceil(p.radius * 1.3f)) + 1;
  const int cx = static_cast<int>(std::floor(p.x));
  const int cy = static_cast<int>(std::floor(p.y));
  for (int y = cy - reach; y <= cy + reach; ++y) {
    for (int x = cx - reach; x <= cx + reach; ++x) {
      const float dx = static_cast<float>(x) + 0.5f - p.x;
      const float dy = static_cast<float>(y) + 0.5f - p.y;
      const float a = (p.cosine * dx + p.sine * dy) / p.radius;
      const float b = (p.cosine * dy - p.sine * dx) / (p.radius * p.aspect);
      const float lump = 0.25f * GradientNoise(1.3f * a, 1.3f * b, p.seed);
      const float distance = std::sqrt(a * a + b * b) + lump;
      const float edge = std::clamp((1.0f - distance) * p.radius * p.aspect + 0.5f, 0.0f, 1.0f);
      if (edge <= 0.0f) continue;
      // A rounded look: lit from above left, a dark rim, and a speckle of its own.
      const float light = 1.0f - 0.25f * (dx + dy) / p.radius - 0.35f * distance * distance;
      const float speckle = 1.0f + 0.3f * GradientNoise(0.37f * dx, 0.37f * dy, p.seed + 1);
      const float shade = std::max(0.15f, light * speckle);
      const Rgb colour = {p.colour[0] * shade, p.colour[1] * shade, p.colour[2] * shade};
      texture->Blend(x, y, colour, edge * p.opacity);
    }
  }
}

}  // namespace

Texture::Level::Level(int width_in, int height_in, std::uint32_t fill)
    : width(width_in),
      height(height_in),
      blocks_per_row((static_cast<std::size_t>(width_in) + 3) / 4),
      texels(blocks_per_row * ((static_cast<std::size_t>(height_in) + 3) / 4) * 16, fill) {}

Texture::Texture(int width, int height, Edge edge, const Rgb& fill) : edge_(edge) {
  levels_.emplace_back(width, height, Pack(fill, 0));
}

std::uint32_t* Texture::TexelAt(int x, int y) {
  Level& level = levels_[0];
  if (edge_ == Edge::kRepeat) {
    x &= level.width - 1;
    y &= level.height - 1;
  } else if (x < 0 || y < 0 || x >= level.width || y >= level.height) {
    return nullptr;
  }
  return &level.texels[level.Index(x, y)];
}

void Texture::Blend(int x, int y, const Rgb& colour, float opacity) {
  std::uint32_t* texel = TexelAt(x, y);
  if (texel == nullptr) return;
  Rgb mixed = Unpack(*texel);
  for (int i = 0; i < 3; ++i) mixed[i] += opacity * (colour[i] - mixed[i]);
  *texel = Pack(mixed, *texel);
}

void Texture::Multiply(int x, int y, const Rgb& factor) {
  std::uint32_t* texel = TexelAt(x, y);
  if (texel == nullptr) return;
  Rgb colour = Unpack(*texel);
  for (int i = 0; i < 3; ++i) colour[i] *= factor[i];
  *texel = Pack(colour, *texel);
}

void Texture::SetFourth(int x, int y, float value) {
  std::uint32_t* texel = TexelAt(x, y);
  if (texel == nullptr) return;
  const float clamped = std::clamp(value, 0.0f, 1.0f);
  *texel = (*texel & 0xFFFFFFu) | static_cast<std::uint32_t>(clamped * 255.0f + 0.5f) << 24;
}

void Texture::BuildMips() {
  levels_.resize(1);
  while (levels_.back().width > 4 && levels_.back().height > 4) {
    const Level& fine = levels_.back();
    Level coarse(fine.width / 2, fine.height / 2, 0);
    for (int y = 0; y < coarse.height; ++y) {
      for (int x = 0; x < coarse.width; ++x) {
        const std::uint32_t children[4] = {fine.texels[fine.Index(2 * x, 2 * y)],
                                           fine.texels[fine.Index(2 * x + 1, 2 * y)],
                                           fine.texels[fine.Index(2 * x, 2 * y + 1)],
                                           fine.texels[fine.Index(2 * x + 1, 2 * y + 1)]};
        std::uint32_t packed = 0;
        for (int shift = 0; shift < 32; shift += 8) {
          std::uint32_t sum = 2;
          for (const std::uint32_t child : children) sum += (child >> shift) & 0xFFu;
          packed |= (sum / 4) << shift;
        }
        coarse.texels[coarse.Index(x, y)] = packed;
      }
    }
    levels_.push_back(std::move(coarse));
  }
}

Float4 Texture::Sample(float u, float v, float level) const {
  const int l = std::clamp(static_cast<int>(level), 0, static_cast<int>(levels_.size()) - 1);
  const Level& texels = levels_[l];
  const float scale = std::bit_cast<float>((127u - static_cast<std::uint32_t>(l)) << 23);  // 2^-l
  u = u * scale - 0.5f;
  v = v * scale - 0.5f;
  int x0 = Floor(u);
  int y0 = Floor(v);
  const float fx = u - static_cast<float>(x0);
  const float fy = v - static_cast<float>(y0);
  int x1 = x0 + 1;
  int y1 = y0 + 1;
  if (edge_ == Edge::kRepeat) {
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
  const std::uint32_t* t = texels.texels.data();
  const Float4 left = Blend2(t[texels.Index(x0, y0)], t[texels.Index(x0, y1)], fy);
  const Float4 right = Blend2(t[texels.Index(x1, y0)], t[texels.Index(x1, y1)], fy);
  return (left + fx * (right - left)) * (1.0f / 255.0f);
}

void PaintPebbles(const PebbleStyle& style, Texture* texture) {
  Rng rng(style.seed);
  const double ratio = std::pow(style.max_radius_px / style.min_radius_px, -style.exponent);
  for (int i = 0; i < style.count; ++i) {
    Pebble p;
    p.x = static_cast<float>(rng.Uniform(0.0, texture->width()));
    p.y = static_cast<float>(rng.Uniform(0.0, texture->height()));
    // Inverse of the truncated power law.
    const double u = rng.Uniform();
    p.radius = style.min_radius_px *
               static_cast<float>(std::pow(1.0 - u * (1.0 - ratio), -1.0 / style.exponent));
    p.aspect = static_cast<float>(rng.Uniform(0.55, 1.0));
    const double angle = rng.Uniform(0.0, 2.0 * std::numbers::pi);
    p.cosine = static_cast<float>(std::cos(angle));
    p.sine = static_cast<float>(std::sin(angle));
    p.colour = PebbleColour(&rng);
    p.opacity = style.opacity * static_cast<float>(rng.Uniform(0.6, 1.0));
    p.seed = static_cast<std::uint32_t>(rng.Next());
    PaintPebble(p, texture);
  }
}

void PaintTiledNoise(const TiledNoiseStyle& style, int num_threads, Texture* texture) {
  std::vector<TiledNoise> octaves;
  for (int i = 0; i < style.octaves; ++i) {
    octaves.emplace_back(style.period << i, texture->width(),
                         Hash(style.seed, static_cast<std::uint32_t>(i)));
  }
  ParallelFor(texture->height(), num_threads, [&](int y) {
    std::vector<float> row(static_cast<std::size_t>(texture->width()), 1.0f);
    float weight = style.amplitude;
    for (const TiledNoise& octave : octaves) {
      octave.AddRow(y, weight, row.data());
      weight *= style.gain;
    }
    for (int x = 0; x < texture->width(); ++x) {
      const float factor = std::max(0.1f, row[x]);
      texture->Multiply(x, y, {factor, factor, factor});
    }
  });
}

}  // namespace rsfm::simulator
