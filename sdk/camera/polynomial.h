// Real roots of small polynomials, for the validity domains of distortion models.
#pragma once

#include <span>

namespace rsfm {

inline constexpr int kMaxPolynomialDegree = 12;

// The smallest x in (0, upper] at which sum_i coefficients[i] x^i crosses or touches zero from its
// sign at 0; `upper` itself when there is none (upper may be infinity). Precondition: the value at
// 0 is positive, at most 13 coefficients. Exact to double precision: the roots of the derivatives
// bracket those of the polynomial. Bounded: at most degree^2 / 2 bisections of at most 200 steps
// each.
double FirstPositiveRoot(std::span<const double> coefficients, double upper) noexcept;

}  // namespace rsfm
