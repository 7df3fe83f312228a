// Repeatable noise: integer hashes and gradient noise that depend on nothing but their arguments,
// so that a scene or an image is the same whatever thread computes it, and in whatever order.
#pragma once

#include <cstdint>
#include <vector>

namespace rsfm::simulator {

// A bijective 32-bit mix.   [Wellons, "Prospecting for Hash Functions", 2018: lowbias32]
constexpr std::uint32_t Hash(std::uint32_t x) {
  x ^= x >> 16;
  x *= 0x7FEB352Du;
  x ^= x >> 15;
  x *= 0x846CA68Bu;
  x ^= x >> 16;
  return x;
}
constexpr std::uint32_t Hash(std::uint32_t a, std::uint32_t b) {
  return Hash(a ^ (Hash(b) + 0x9E3779B9u));
}
constexpr std::uint32_t Hash(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  return Hash(a, Hash(b, c));
}

// [0, 1)
constexpr float UnitFloat(std::uint32_t hash) { return static_cast<float>(hash >> 8) * 0x1.0p-24f; }

// Gradient noise in about [-1, 1], with zero at every integer point; quintic fade.
// [Perlin 2002, SIGGRAPH, doi:10.1145/566654.566636]
float GradientNoise(float x, float y, std::uint32_t seed);
float GradientNoise(float x, float y, float z, std::uint32_t seed);

// The same, repeating every `period` cells in both directions, for whole rows of a grid of
// `size` x `size` points over the period: its gradients are computed once.
class TiledNoise {
 public:
  // Preconditions: 0 < period <= size, and size is a multiple of period.
  TiledNoise(int period, int size, std::uint32_t seed);

  // row[x] += weight * noise at the centre of grid point (x, y), for x in [0, size).
  void AddRow(int y, float weight, float* row) const;

 private:
  struct Gradient {
    float x, y;
  };
  int period_;
  int size_;
  std::vector<Gradient> gradients_;  // (period + 1)^2, the last row and column as the first
};

// Sum of octaves: each of twice the frequency and `gain` times the amplitude of the one before. Not
// normalised.
float FractalNoise(float x, float y, int octaves, float gain, std::uint32_t seed);

}  // namespace rsfm::simulator
