#include "tools/simulator/noise.h"

#include <cmath>

namespace rsfm::simulator {
namespace {

float Fade(float t) { return t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f); }
float Lerp(float a, float b, float t) { return a + t * (b - a); }

// One of 16 gradient directions, by the lattice point's hash.
float Gradient2(std::uint32_t hash, float dx, float dy) {
  constexpr float kC[16] = {1.0f,  0.9239f,  0.7071f,  0.3827f,  0.0f, -0.3827f, -0.7071f, -0.9239f,
                            -1.0f, -0.9239f, -0.7071f, -0.3827f, 0.0f, 0.3827f,  0.7071f,  0.9239f};
  const std::uint32_t i = hash >> 28;
  return 1.4f * (kC[i] * dx + kC[(i + 12) & 15] * dy);
}

// The twelve directions to the edges of a cube, four of them twice.
float Gradient3(std::uint32_t hash, float dx, float dy, float dz) {
  const std::uint32_t h = hash >> 28;
  const float u = h < 8 ? dx : dy;
  const float v = h < 4 ? dy : (h == 12 || h == 14 ? dx : dz);
  return ((h & 1) != 0 ? -u : u) + ((h & 2) != 0 ? -v : v);
}

}  // namespace

float GradientNoise(float x, float y, std::uint32_t seed) {
  const float fx = std::floor(x);
  const float fy = std::floor(y);
  const float dx = x - fx;
  const float dy = y - fy;
  const auto corner = [&](int i, int j) {
    const std::uint32_t hash = Hash(static_cast<std::uint32_t>(static_cast<int>(fx) + i),
                                    static_cast<std::uint32_t>(static_cast<int>(fy) + j), seed);
    return Gradient2(hash, dx - static_cast<float>(i), dy - static_cast<float>(j));
  };
  const float u = Fade(dx);
  return Lerp(Lerp(corner(0, 0), corner(1, 0), u), Lerp(corner(0, 1), corner(1, 1), u), Fade(dy));
}

TiledNoise::TiledNoise(int period, int size, std::uint32_t seed) : period_(period), size_(size) {
  gradients_.reserve(static_cast<std::size_t>(period + 1) * (period + 1));
  for (int y = 0; y <= period; ++y) {
    for (int x = 0; x <= period; ++x) {
      const std::uint32_t hash = Hash(static_cast<std::uint32_t>(x % period),
                                      static_cast<std::uint32_t>(y % period), seed);
      gradients_.push_back({Gradient2(hash, 1.0f, 0.0f), Gradient2(hash, 0.0f, 1.0f)});
    }
  }
}

void TiledNoise::AddRow(int y, float weight, float* row) const {
  const int per_cell = size_ / period_;
  const float step = 1.0f / static_cast<float>(per_cell);
  const float dy = (static_cast<float>(y % per_cell) + 0.5f) * step;
  const float v = Fade(dy);
  const Gradient* above = &gradients_[static_cast<std::size_t>(y / per_cell) * (period_ + 1)];
  const Gradient* below = above + period_ + 1;
  for (int cell = 0; cell < period_; ++cell) {
    // Along a row each corner's ramp is a line in dx, and the blend downwards does not depend on x.
    const float left = Lerp(above[cell].y * dy, below[cell].y * (dy - 1.0f), v);
    const float left_slope = Lerp(above[cell].x, below[cell].x, v);
    const float right = Lerp(above[cell + 1].y * dy, below[cell + 1].y * (dy - 1.0f), v);
    const float right_slope = Lerp(above[cell + 1].x, below[cell + 1].x, v);
    float* values = row + static_cast<std::size_t>(cell) * per_cell;
    for (int i = 0; i < per_cell; ++i) {
      const float dx = (static_cast<float>(i) + 0.5f) * step;
      values[i] +=
          weight * Lerp(left + left_slope * dx, right + right_slope * (dx - 1.0f), Fade(dx));
    }
  }
}

float GradientNoise(float x, float y, float z, std::uint32_t seed) {
  const float fx = std::floor(x);
  const float fy = std::floor(y);
  const float fz = std::floor(z);
  const float d[3] = {x - fx, y - fy, z - fz};
  const auto corner = [&](int i, int j, int k) {
    const std::uint32_t hash =
        Hash(static_cast<std::uint32_t>(static_cast<int>(fx) + i),
             static_cast<std::uint32_t>(static_cast<int>(fy) + j),
             Hash(static_cast<std::uint32_t>(static_cast<int>(fz) + k), seed));
    return Gradient3(hash, d[0] - static_cast<float>(i), d[1] - static_cast<float>(j),
                     d[2] - static_cast<float>(k));
  };
  const float u = Fade(d[0]);
  const float v = Fade(d[1]);
  const float near =
      Lerp(Lerp(corner(0, 0, 0), corner(1, 0, 0), u), Lerp(corner(0, 1, 0), corner(1, 1, 0), u), v);
  const float far =
      Lerp(Lerp(corner(0, 0, 1), corner(1, 0, 1), u), Lerp(corner(0, 1, 1), corner(1, 1, 1), u), v);
  return Lerp(near, far, Fade(d[2]));
}

float FractalNoise(float x, float y, int octaves, float gain, std::uint32_t seed) {
  float sum = 0.0f;
  float amplitude = 1.0f;
  for (int i = 0; i < octaves; ++i) {
    sum += amplitude * GradientNoise(x, y, Hash(seed, static_cast<std::uint32_t>(i)));
    amplitude *= gain;
    x *= 2.0f;
    y *= 2.0f;
  }
  return sum;
}

}  // namespace rsfm::simulator
