// The inverse of a radial distortion as a power series: where y = r (1 + a1 r^2 + a2 r^4 + ...),
//   r = y (1 + b1 y^2 + b2 y^4 + ...),   b_n = [x^n] (1 + a1 x + a2 x^2 + ...)^-(2n+1) / (2n + 1)
// by Lagrange's inversion theorem.   [Drap & Lefevre 2016, Sensors 16(6), writes b1..b9 out]
#pragma once

#include <array>

namespace rsfm {

// Beyond this the series is not trusted even as a start.
inline constexpr double kMaxSeriesFactor = 0.3;

struct InverseSeries {
  static constexpr int kTerms = 6;
  std::array<double, kTerms> b{};

  // r / y - 1 at y^2; Estrin's scheme, which is short for a pipeline.
  double Factor(double y2) const {
    const double y4 = y2 * y2;
    return y2 * ((b[0] + b[1] * y2) + y4 * ((b[2] + b[3] * y2) + y4 * (b[4] + b[5] * y2)));
  }
};

// a: the coefficients a1, a2, ... in order.
InverseSeries RevertRadialSeries(const std::array<double, InverseSeries::kTerms>& a) noexcept;

}  // namespace rsfm
