#include "tools/simulator/noise.h"

#include <cmath>

namespace rsfm {
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

std::uint32_t Wrap(int i, int period) {
  const int m = i % period;
  return static_cast<std::uint32_t>(m < 0 ? m + period : m);
}

template <class CornerHash>
float Blend2(float x, float y, CornerHash&& hash) {
  const float fx = std::floor(x);
  const float fy = std::floor(y);
  const int ix = static_cast<int>(fx);
  const int iy = static_cast<int>(fy);
  const float dx = x - fx;
  const float dy = y - fy;
  const float u = Fade(dx);
  const float n0 =
      Lerp(Gradient2(hash(ix, iy), dx, dy), Gradient2(hash(ix + 1, iy), dx - 1.0f, dy), u);
  const float n1 = Lerp(Gradient2(hash(ix, iy + 1), dx, dy - 1.0f),
                        Gradient2(hash(ix + 1, iy + 1), dx - 1.0f, dy - 1.0f), u);
  return Lerp(n0, n1, Fade(dy));
}

}  // namespace

float GradientNoise(float x, float y, std::uint32_t seed) {
  return Blend2(x, y, [seed](int ix, int iy) {
    return Hash(static_cast<std::uint32_t>(ix), static_cast<std::uint32_t>(iy), seed);
  });
}

float TiledNoise(float x, float y, int period, std::uint32_t seed) {
  return Blend2(x, y, [seed, period](int ix, int iy) {
    return Hash(Wrap(ix, period), Wrap(iy, period), seed);
  });
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

}  // namespace rsfm
