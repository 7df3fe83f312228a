// OpenCV's rational distortion, k = k1 k2 p1 p2 k3 k4 k5 k6:
//   q = p (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) + tangential   [OpenCV,
//   calib3d]
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "rsfm/base/linear.h"
#include "rsfm/camera/polynomial.h"

namespace rsfm {

struct RationalDistortion {
  static constexpr int kNumParams = 8;
  static constexpr bool kIsRadial = false;
  using ParamsJacobian = Eigen::Matrix<double, 2, kNumParams>;

  template <class T>
  static void Apply(const T* k, const Vec2T<T>& p, Vec2T<T>* q) {
    const T x = p.x(), y = p.y(), r2 = x * x + y * y;
    const T numerator = T(1.0) + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
    const T denominator = T(1.0) + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
    const T radial = numerator / denominator;
    *q = Vec2T<T>(x * radial + T(2.0) * k[2] * x * y + k[3] * (r2 + T(2.0) * x * x),
                  y * radial + T(2.0) * k[3] * x * y + k[2] * (r2 + T(2.0) * y * y));
  }

  static void Apply(const double* k, const Vec2& p, Vec2* q, Mat2* d_q_d_p,
                    ParamsJacobian* d_q_d_k) {
    const double x = p.x(), y = p.y(), xx = x * x, yy = y * y, xy = x * y, r2 = xx + yy;
    const double numerator = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
    const double denominator = 1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
    const double inverse = 1.0 / denominator, radial = numerator * inverse;
    const double d_numerator = k[0] + r2 * (2.0 * k[1] + r2 * 3.0 * k[4]);
    const double d_denominator = k[5] + r2 * (2.0 * k[6] + r2 * 3.0 * k[7]);
    const double slope = (d_numerator - radial * d_denominator) * inverse;  // to r^2
    const double p1 = k[2], p2 = k[3];
    *q = Vec2(x * radial + 2.0 * p1 * xy + p2 * (r2 + 2.0 * xx),
              y * radial + 2.0 * p2 * xy + p1 * (r2 + 2.0 * yy));
    const double mixed = 2.0 * xy * slope + 2.0 * p1 * x + 2.0 * p2 * y;
    *d_q_d_p << radial + 2.0 * xx * slope + 2.0 * p1 * y + 6.0 * p2 * x, mixed, mixed,
        radial + 2.0 * yy * slope + 2.0 * p2 * x + 6.0 * p1 * y;
    if (d_q_d_k == nullptr) return;
    const double up = inverse * r2, down = -radial * inverse * r2;
    d_q_d_k->col(0) = up * p;
    d_q_d_k->col(1) = up * r2 * p;
    d_q_d_k->col(2) << 2.0 * xy, r2 + 2.0 * yy;
    d_q_d_k->col(3) << r2 + 2.0 * xx, 2.0 * xy;
    d_q_d_k->col(4) = up * r2 * r2 * p;
    d_q_d_k->col(5) = down * p;
    d_q_d_k->col(6) = down * r2 * p;
    d_q_d_k->col(7) = down * r2 * r2 * p;
  }

  // Where r N(r^2) / D(r^2) stops growing: the first root of (N + 2 x N') D - 2 x N D' or of D, x =
  // r^2.
  static double MaxRadius(const double* k, double upper) {
    const std::array<double, 4> n = {1.0, k[0], k[1], k[4]}, d = {1.0, k[5], k[6], k[7]};
    std::array<double, 7> slope{};
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) slope[i + j] += (1 + 2 * i - 2 * j) * n[i] * d[j];
    }
    const double limit = upper * upper;
    return std::sqrt(std::min(FirstPositiveRoot(slope, limit), FirstPositiveRoot(d, limit)));
  }
};

}  // namespace rsfm
