#include "tools/simulator/texture.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "rsfm/base/rng.h"
#include "tools/common/parallel.h"
#include "tools/simulator/noise.h"

namespace rsfm::simulator {
namespace {

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

// One row of a pebble whose centre is dy above it.
void PaintPebbleRow(const Pebble& p, int row, float dy, int cx, int reach, Texture* texture) {
  for (int x = cx - reach; x <= cx + reach; ++x) {
    const float dx = static_cast<float>(x) + 0.5f - p.x;
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
    texture->Blend(x, row, colour, edge * p.opacity);
  }
}

// The part of a pebble in rows [first, end) of the texture, and of its repetitions above and below.
void PaintPebble(const Pebble& p, int first, int end, Texture* texture) {
  const int reach = static_cast<int>(std::ceil(p.radius * 1.3f)) + 1;
  const int cx = static_cast<int>(std::floor(p.x));
  const int cy = static_cast<int>(std::floor(p.y));
  const int height = texture->height();
  for (const int shift : {-height, 0, height}) {
    if (shift != 0 && texture->edge() == Texture::Edge::kClamp) continue;
    const int from = std::max(first, cy + shift - reach);
    const int to = std::min(end, cy + shift + reach + 1);
    for (int row = from; row < to; ++row) {
      const float dy = static_cast<float>(row - shift) + 0.5f - p.y;
      PaintPebbleRow(p, row, dy, cx, reach, texture);
    }
  }
}

std::vector<Pebble> DrawPebbles(const PebbleStyle& style, int width, int height) {
  Rng rng(style.seed);
  std::vector<Pebble> pebbles(static_cast<std::size_t>(std::max(0, style.count)));
  const double ratio = std::pow(style.max_radius_px / style.min_radius_px, -style.exponent);
  for (Pebble& p : pebbles) {
    p.x = static_cast<float>(rng.Uniform(0.0, width));
    p.y = static_cast<float>(rng.Uniform(0.0, height));
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
  }
  return pebbles;
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

void PaintPebbles(const PebbleStyle& style, int num_threads, Texture* texture) {
  const std::vector<Pebble> pebbles = DrawPebbles(style, texture->width(), texture->height());
  // Bands of rows, each of which paints its part of all the pebbles, in their order.
  constexpr int kBand = 64;
  ParallelFor((texture->height() + kBand - 1) / kBand, num_threads, [&](int band) {
    const int first = band * kBand;
    const int end = std::min(first + kBand, texture->height());
    for (const Pebble& pebble : pebbles) PaintPebble(pebble, first, end, texture);
  });
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
