// A seeded random number generator whose stream is the same on every platform and standard library.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace rsfm {

// xoshiro256++ seeded by splitmix64.   [Blackman & Vigna 2021, ACM TOMS 47(4), doi:10.1145/3460772]
class Rng {
 public:
  explicit Rng(std::uint64_t seed) noexcept {
    for (std::uint64_t& word : state_) {
      seed += 0x9E3779B97F4A7C15u;
      std::uint64_t z = seed;
      z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
      z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
      word = z ^ (z >> 31);
    }
  }

  std::uint64_t Next() noexcept {
    const std::uint64_t result = Rotl(state_[0] + state_[3], 23) + state_[0];
    const std::uint64_t t = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = Rotl(state_[3], 45);
    return result;
  }

  // Uniform in [0, 1), 53 bits.
  double Uniform() noexcept { return static_cast<double>(Next() >> 11) * 0x1.0p-53; }
  double Uniform(double low, double high) noexcept { return low + (high - low) * Uniform(); }

  // Uniform in [0, count). Precondition: count > 0. The bias is below count / 2^32.
  std::uint32_t Index(std::uint32_t count) noexcept {
    return static_cast<std::uint32_t>(((Next() >> 32) * count) >> 32);
  }

  // Standard normal, by Box and Muller's transform of two uniforms.
  double Gaussian() noexcept {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform()));
    return radius * std::cos(2.0 * std::numbers::pi * Uniform());
  }
  double Gaussian(double mean, double sigma) noexcept { return mean + sigma * Gaussian(); }

 private:
  static constexpr std::uint64_t Rotl(std::uint64_t x, int k) noexcept {
    return (x << k) | (x >> (64 - k));
  }

  std::uint64_t state_[4];
};

}  // namespace rsfm
