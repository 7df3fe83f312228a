#include "rsfm/camera/polynomial.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace rsfm {
namespace {

constexpr int kMaxCoefficients = kMaxPolynomialDegree + 1;
using Coefficients = std::array<double, kMaxCoefficients>;
using Roots = std::array<double, kMaxCoefficients>;

double Evaluate(const Coefficients& c, int degree, double x) {
  double value = c[degree];
  for (int i = degree - 1; i >= 0; --i) value = value * x + c[i];
  return value;
}

// A bracketed sign change, halved until the doubles at its ends are neighbours.
double Bisect(const Coefficients& c, int degree, double low, double high) {
  const bool rising = Evaluate(c, degree, low) < 0.0;
  for (int step = 0; step < 200; ++step) {
    const double middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) break;
    if ((Evaluate(c, degree, middle) < 0.0) == rising) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

}  // namespace

double FirstPositiveRoot(std::span<const double> coefficients, double upper) noexcept {
  int degree = std::min<int>(static_cast<int>(coefficients.size()) - 1, kMaxPolynomialDegree);
  while (degree > 0 && coefficients[degree] == 0.0) --degree;
  if (degree <= 0) return upper;

  // Cauchy's bound holds every root.
  double largest = 0.0;
  for (int i = 0; i < degree; ++i)
    largest = std::max(largest, std::abs(coefficients[i] / coefficients[degree]));
  const double bound = std::min(upper, 1.0 + largest);

  // Derivatives of every order; then, from the linear one up, the roots of each split the axis for
  // the next.
  std::array<Coefficients, kMaxCoefficients> derivatives{};
  for (int i = 0; i <= degree; ++i) derivatives[0][i] = coefficients[i];
  for (int k = 1; k < degree; ++k) {
    for (int i = 0; i <= degree - k; ++i) derivatives[k][i] = (i + 1) * derivatives[k - 1][i + 1];
  }
  Roots roots{};
  int num_roots = 0;
  for (int k = degree - 1; k >= 0; --k) {
    const int order = degree - k;
    Roots next{};
    int num_next = 0;
    double low = 0.0;
    for (int i = 0; i <= num_roots; ++i) {
      const double high = i < num_roots ? roots[i] : bound;
      const double at_low = Evaluate(derivatives[k], order, low);
      const double at_high = Evaluate(derivatives[k], order, high);
      if (high > low && at_low != 0.0 && (at_low < 0.0) != (at_high < 0.0)) {
        next[num_next++] = Bisect(derivatives[k], order, low, high);
      } else if (at_high == 0.0 && high > low) {
        next[num_next++] = high;
      }
      low = high;
    }
    roots = next;
    num_roots = num_next;
  }
  return num_roots > 0 ? roots[0] : upper;
}

}  // namespace rsfm
