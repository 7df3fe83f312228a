// Time: microseconds since the Unix epoch, at the moment of measurement (mid-exposure for images).
#pragma once

#include <cstdint>

namespace rsfm {

using Utime = std::int64_t;

constexpr double SecondsFromUs(Utime microseconds) {
  return static_cast<double>(microseconds) * 1e-6;
}

// Rounds to the nearest microsecond. Precondition: |seconds| < 9e12.
constexpr Utime UsFromSeconds(double seconds) {
  return static_cast<Utime>(seconds * 1e6 + (seconds >= 0.0 ? 0.5 : -0.5));
}

}  // namespace rsfm
