// Real roots of small polynomials on the stack. Coefficients are in ascending order: c[0] + c[1] x
// + ...
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "rsfm/base/static_vector.h"

namespace rsfm {

// Both real roots of a x^2 + b x + c, without cancellation; false when they are complex or a = b =
// 0. A linear equation (a = 0) gives its root twice.
inline bool SolveQuadratic(double a, double b, double c, double* root_1, double* root_2) noexcept {
  const double discriminant = b * b - 4.0 * a * c;
  if (!(discriminant >= 0.0)) return false;
  const double q = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
  if (q == 0.0) {
    if (a == 0.0) return false;
    *root_1 = *root_2 = 0.0;
    return true;
  }
  *root_2 = c / q;
  *root_1 = a != 0.0 ? q / a : *root_2;
  return true;
}

// Real roots of x^3 + c2 x^2 + c1 x + c0: 1 or 3, each polished by two Newton steps.
// [Press 2007, Numerical Recipes, sec. 5.6]
inline int SolveMonicCubic(double c2, double c1, double c0, std::array<double, 3>* roots) noexcept {
  const double q = (c2 * c2 - 3.0 * c1) / 9.0;
  const double r = (2.0 * c2 * c2 * c2 - 9.0 * c2 * c1 + 27.0 * c0) / 54.0;
  const double q3 = q * q * q;
  int count = 1;
  if (r * r < q3) {
    const double theta = std::acos(r / std::sqrt(q3)) / 3.0;
    const double cos_theta = std::cos(theta);
    const double sin_theta = std::sin(theta) * std::sqrt(3.0);
    const double m = std::sqrt(q);
    *roots = {-2.0 * m * cos_theta, m * (cos_theta + sin_theta), m * (cos_theta - sin_theta)};
    count = 3;
  } else {
    const double a = -std::copysign(std::cbrt(std::abs(r) + std::sqrt(r * r - q3)), r);
    (*roots)[0] = a != 0.0 ? a + q / a : 0.0;
  }
  for (int i = 0; i < count; ++i) {
    double x = (*roots)[i] - c2 / 3.0;
    for (int step = 0; step < 2; ++step) {
      const double value = ((x + c2) * x + c1) * x + c0;
      const double slope = (3.0 * x + 2.0 * c2) * x + c1;
      if (slope == 0.0) break;
      x -= value / slope;
    }
    (*roots)[i] = x;
  }
  return count;
}

namespace internal {

template <int kDegree>
inline double EvaluatePolynomial(const double* c, double x) noexcept {
  double value = c[kDegree];
  for (int i = kDegree - 1; i >= 0; --i) value = value * x + c[i];
  return value;
}

// The root of a polynomial in a bracket with a sign change: a secant, then Newton steps, halved
// brackets where Newton leaves them; at most 60 steps.
template <int kDegree>
inline double BracketedRoot(const double* c, const double* derivative, double low, double high,
                            double value_low, double value_high, double tolerance) noexcept {
  double x = low - value_low * (high - low) / (value_high - value_low);
  if (!(x > low && x < high)) x = 0.5 * (low + high);
  for (int step = 0; step < 60; ++step) {
    const double value = EvaluatePolynomial<kDegree>(c, x);
    if (value == 0.0) return x;
    if ((value < 0.0) == (value_low < 0.0)) {
      low = x;
    } else {
      high = x;
    }
    const double slope = EvaluatePolynomial<kDegree - 1>(derivative, x);
    double next = x - value / slope;
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    const double change = std::abs(next - x);
    x = next;
    if (change <= tolerance || high - low <= tolerance) break;
  }
  return x;
}

// Roots of derivatives[kDegree] in [-1, 1], where derivatives[k - 1] is the derivative of
// derivatives[k]: between two neighbouring roots of its derivative a polynomial is monotone, so
// each sign change brackets one root. [Yuksel 2022, Proc. ACM CGIT 5(1), doi:10.1145/3543865]
template <int kLevel, int kMax>
inline int RootsInUnitInterval(
    const std::array<std::array<double, kMax + 1>, kMax + 1>& derivatives,
    std::array<double, kMax>* roots) noexcept {
  if constexpr (kLevel == 1) {
    const auto& c = derivatives[1];
    if (c[1] == 0.0) return 0;
    const double x = -c[0] / c[1];
    if (!(std::abs(x) <= 1.0)) return 0;
    (*roots)[0] = x;
    return 1;
  } else if constexpr (kLevel == 2 && kMax > 2) {
    const auto& c = derivatives[2];
    double first = 0.0, second = 0.0;
    if (!SolveQuadratic(c[2], c[1], c[0], &first, &second)) return 0;
    int count = 0;
    if (std::abs(std::min(first, second)) < 1.0) (*roots)[count++] = std::min(first, second);
    if (std::abs(std::max(first, second)) < 1.0) (*roots)[count++] = std::max(first, second);
    return count;
  } else {
    std::array<double, kMax> knots;
    const int num_knots = RootsInUnitInterval<kLevel - 1, kMax>(derivatives, &knots);
    const double* c = derivatives[kLevel].data();
    const double* slope = derivatives[kLevel - 1].data();
    // Of the last step; what is left is of the order of its square, and knots need only separate.
    constexpr double kTolerance = kLevel == kMax ? 1e-13 : 1e-4;
    int count = 0;
    double low = -1.0;
    double value_low = EvaluatePolynomial<kLevel>(c, low);
    for (int i = 0; i <= num_knots; ++i) {
      const double high = i < num_knots ? knots[i] : 1.0;
      const double value_high = EvaluatePolynomial<kLevel>(c, high);
      if ((value_low < 0.0) != (value_high < 0.0) && count < kMax) {
        (*roots)[count++] =
            BracketedRoot<kLevel>(c, slope, low, high, value_low, value_high, kTolerance);
      }
      low = high;
      value_low = value_high;
    }
    return count;
  }
}

}  // namespace internal

// The real roots of odd multiplicity of a polynomial of degree <= kDegree, unordered. Those outside
// [-1, 1] are found as the reciprocals of the roots of the reversed polynomial, so that no
// magnitude is favoured. Not finite or all zero coefficients give no root.
template <int kDegree>
inline StaticVector<double, 2 * kDegree> RealRoots(
    const std::array<double, kDegree + 1>& coefficients) noexcept {
  StaticVector<double, 2 * kDegree> result;
  double largest = 0.0;
  for (const double c : coefficients) largest = std::max(largest, std::abs(c));
  if (!(largest > 0.0) || !std::isfinite(largest)) return result;
  std::array<std::array<double, kDegree + 1>, kDegree + 1> derivatives;
  std::array<double, kDegree> roots;
  for (const bool reversed : {false, true}) {
    for (int i = 0; i <= kDegree; ++i)
      derivatives[kDegree][i] = coefficients[reversed ? kDegree - i : i] / largest;
    for (int k = kDegree; k > 1; --k) {
      for (int i = 1; i <= k; ++i) derivatives[k - 1][i - 1] = i * derivatives[k][i];
    }
    const int count = internal::RootsInUnitInterval<kDegree, kDegree>(derivatives, &roots);
    for (int i = 0; i < count; ++i) {
      if (!reversed) {
        result.TryPushBack(roots[i]);
      } else if (roots[i] != 0.0 && std::abs(roots[i]) < 1.0) {
        result.TryPushBack(1.0 / roots[i]);
      }
    }
  }
  return result;
}

}  // namespace rsfm
