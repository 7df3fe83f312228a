// Which times a clock may show. Messages and tables hold any number; sums and differences of those
// beyond would overflow.
#pragma once

#include <limits>

#include "rsfm/base/time.h"

namespace rsfm {

inline constexpr Utime kMaxUtime = std::numeric_limits<Utime>::max() / 4;  // 73,000 years
constexpr bool IsTime(Utime utime) { return utime >= -kMaxUtime && utime <= kMaxUtime; }

}  // namespace rsfm
