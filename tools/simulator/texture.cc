#include "tools/simulator/texture.h"

#include <algorithm>
#include <cmath>

#include "rsfm/base/rng.h"
#include "tools/simulator/noise.h"

namespace rsfm {
namespace {

std::uint32_t Pack(const Rgb& colour) {
  std::uint32_t packed = 0;
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
  if (kind < 0.30) return {0.04f + 0.08f * tone, 0.05f + 0.08f * tone, 0.05f + 0.06f * tone};
  if (kind < 0.36) return {0.32f + 0.25f * tone, 0.10f + 0.10f * tone, 0.12f + 0.10f * tone};
  if (kind < 0.42) return {0.10f + 0.10f * tone, 0.20f + 0.16f * tone, 0.06f + 0.06f * tone};
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

Texture::Texture(int width, int height, Edge edge, const Rgb& fill) : edge_(edge), levels_(1) {
  levels_[0] = {width, height,
                std::vector<std::uint32_t>(static_cast<std::size_t>(width) * height, Pack(fill))};
}

std::uint32_t* Texture::TexelAt(int x, int y) {
  Level& level = levels_[0];
  if (edge_ == Edge::kRepeat) {
    x &= level.width - 1;
    y &= level.height - 1;
  } else if (x < 0 || y < 0 || x >= level.width || y >= level.height) {
    return nullptr;
  }
  return &level.texels[static_cast<std::size_t>(y) * level.width + x];
}

void Texture::Blend(int x, int y, const Rgb& colour, float opacity) {
  std::uint32_t* texel = TexelAt(x, y);
  if (texel == nullptr) return;
  Rgb mixed = Unpack(*texel);
  for (int i = 0; i < 3; ++i) mixed[i] += opacity * (colour[i] - mixed[i]);
  *texel = Pack(mixed);
}

void Texture::Multiply(int x, int y, const Rgb& factor) {
  std::uint32_t* texel = TexelAt(x, y);
  if (texel == nullptr) return;
  Rgb colour = Unpack(*texel);
  for (int i = 0; i < 3; ++i) colour[i] *= factor[i];
  *texel = Pack(colour);
}

void Texture::BuildMips() {
  levels_.resize(1);
  while (levels_.back().width > 4 && levels_.back().height > 4) {
    const Level& fine = levels_.back();
    Level coarse{fine.width / 2, fine.height / 2, {}};
    coarse.texels.resize(static_cast<std::size_t>(coarse.width) * coarse.height);
    for (int y = 0; y < coarse.height; ++y) {
      for (int x = 0; x < coarse.width; ++x) {
        const std::uint32_t* row =
            &fine.texels[static_cast<std::size_t>(2 * y) * fine.width + 2 * x];
        std::uint32_t packed = 0;
        for (int shift = 0; shift < 24; shift += 8) {
          const std::uint32_t sum = ((row[0] >> shift) & 0xFFu) + ((row[1] >> shift) & 0xFFu) +
                                    ((row[fine.width] >> shift) & 0xFFu) +
                                    ((row[fine.width + 1] >> shift) & 0xFFu);
          packed |= ((sum + 2) / 4) << shift;
        }
        coarse.texels[static_cast<std::size_t>(y) * coarse.width + x] = packed;
      }
    }
    levels_.push_back(std::move(coarse));
  }
}

Rgb Texture::Sample(float u, float v, float level) const {
  const int l = std::clamp(static_cast<int>(level), 0, static_cast<int>(levels_.size()) - 1);
  const Level& texels = levels_[l];
  const float scale = 1.0f / static_cast<float>(1 << l);
  u = u * scale - 0.5f;
  v = v * scale - 0.5f;
  int x0, y0, x1, y1;
  float fx, fy;
  if (edge_ == Edge::kRepeat) {
    const float floor_u = std::floor(u);
    const float floor_v = std::floor(v);
    fx = u - floor_u;
    fy = v - floor_v;
    x0 = static_cast<int>(floor_u) & (texels.width - 1);
    y0 = static_cast<int>(floor_v) & (texels.height - 1);
    x1 = (x0 + 1) & (texels.width - 1);
    y1 = (y0 + 1) & (texels.height - 1);
  } else {
    u = std::clamp(u, 0.0f, static_cast<float>(texels.width - 1));
    v = std::clamp(v, 0.0f, static_cast<float>(texels.height - 1));
    x0 = static_cast<int>(u);
    y0 = static_cast<int>(v);
    fx = u - static_cast<float>(x0);
    fy = v - static_cast<float>(y0);
    x1 = std::min(x0 + 1, texels.width - 1);
    y1 = std::min(y0 + 1, texels.height - 1);
  }
  const std::uint32_t* row0 = &texels.texels[static_cast<std::size_t>(y0) * texels.width];
  const std::uint32_t* row1 = &texels.texels[static_cast<std::size_t>(y1) * texels.width];
  const std::uint32_t t00 = row0[x0], t10 = row0[x1], t01 = row1[x0], t11 = row1[x1];
  const float w11 = fx * fy;
  const float w10 = fx - w11;
  const float w01 = fy - w11;
  const float w00 = 1.0f - fx - w01;
  Rgb colour;
  for (int i = 0; i < 3; ++i) {
    const int shift = 8 * i;
    colour[i] = (1.0f / 255.0f) * (w00 * static_cast<float>((t00 >> shift) & 0xFFu) +
                                   w10 * static_cast<float>((t10 >> shift) & 0xFFu) +
                                   w01 * static_cast<float>((t01 >> shift) & 0xFFu) +
                                   w11 * static_cast<float>((t11 >> shift) & 0xFFu));
  }
  return colour;
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
    p.opacity = style.contrast * static_cast<float>(rng.Uniform(0.6, 1.0));
    p.seed = static_cast<std::uint32_t>(rng.Next());
    PaintPebble(p, texture);
  }
}

void PaintTiledNoise(int period, int octaves, float gain, float amplitude, std::uint32_t seed,
                     Texture* texture) {
  for (int y = 0; y < texture->height(); ++y) {
    for (int x = 0; x < texture->width(); ++x) {
      float sum = 0.0f;
      float weight = amplitude;
      int cells = period;
      for (int i = 0; i < octaves; ++i) {
        const float scale = static_cast<float>(cells) / static_cast<float>(texture->width());
        sum += weight * TiledNoise((static_cast<float>(x) + 0.5f) * scale,
                                   (static_cast<float>(y) + 0.5f) * scale, cells,
                                   Hash(seed, static_cast<std::uint32_t>(i)));
        weight *= gain;
        cells *= 2;
      }
      const float factor = std::max(0.1f, 1.0f + sum);
      texture->Multiply(x, y, {factor, factor, factor});
    }
  }
}

}  // namespace rsfm
