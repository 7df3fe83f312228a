// Radial, then tangential and thin-prism distortion of the radially distorted point, k = k0..k5 p0
// p1 s0..s3:
//   m = p (1 + k0 r^2 + ... + k5 r^12),  R^2 = |m|^2
//   q = m + (p0 (2 mx^2 + R^2) + 2 p1 mx my, p1 (2 my^2 + R^2) + 2 p0 mx my) + (s0 R^2 + s1 R^4, s2
//   R^2 + s3 R^4)
// [Project Aria tools documentation, "Camera intrinsic models", FisheyeRadTanThinPrism]
#pragma once

#include <array>
#include <cmath>

#include "rsfm/base/linear.h"
#include "rsfm/camera/polynomial.h"

namespace rsfm {

struct RadTanThinPrismDistortion {
  static constexpr int kNumParams = 12;
  static constexpr bool kIsRadial = false;
  using ParamsJacobian = Eigen::Matrix<double, 2, kNumParams>;

  template <class T>
  static void Apply(const T* k, const Vec2T<T>& p, Vec2T<T>* q) {
    const T r2 = p.x() * p.x() + p.y() * p.y();
    T radial(1.0), power(1.0);
    for (int i = 0; i < 6; ++i) {
      power = power * r2;
      radial += k[i] * power;
    }
    const T x = radial * p.x(), y = radial * p.y(), s = x * x + y * y;
    *q = Vec2T<T>(
        x + k[6] * (T(2.0) * x * x + s) + T(2.0) * k[7] * x * y + k[8] * s + k[9] * s * s,
        y + k[7] * (T(2.0) * y * y + s) + T(2.0) * k[6] * x * y + k[10] * s + k[11] * s * s);
  }

  static void Apply(const double* k, const Vec2& p, Vec2* q, Mat2* d_q_d_p,
                    ParamsJacobian* d_q_d_k) {
    const double r2 = p.squaredNorm();
    double radial = 0.0, slope = 0.0;
    for (int i = 5; i >= 0; --i) {
      slope = slope * r2 + (i + 1) * k[i];
      radial = (radial + k[i]) * r2;
    }
    radial += 1.0;
    const Vec2 m = radial * p;
    const double x = m.x(), y = m.y(), s = m.squaredNorm();
    *q = Vec2(x + k[6] * (2.0 * x * x + s) + 2.0 * k[7] * x * y + k[8] * s + k[9] * s * s,
              y + k[7] * (2.0 * y * y + s) + 2.0 * k[6] * x * y + k[10] * s + k[11] * s * s);
    const double prism_x = 2.0 * k[8] + 4.0 * k[9] * s, prism_y = 2.0 * k[10] + 4.0 * k[11] * s;
    Mat2 d_q_d_m;
    d_q_d_m << 1.0 + 6.0 * k[6] * x + 2.0 * k[7] * y + prism_x * x,
        2.0 * k[6] * y + 2.0 * k[7] * x + prism_x * y,
        2.0 * k[7] * x + 2.0 * k[6] * y + prism_y * x,
        1.0 + 6.0 * k[7] * y + 2.0 * k[6] * x + prism_y * y;
    const Mat2 d_m_d_p = radial * Mat2::Identity() + (2.0 * slope) * p * p.transpose();
    d_q_d_p->noalias() = d_q_d_m.lazyProduct(d_m_d_p);
    if (d_q_d_k == nullptr) return;
    const Vec2 along = d_q_d_m * p;
    double power = 1.0;
    for (int i = 0; i < 6; ++i) {
      power *= r2;
      d_q_d_k->col(i) = power * along;
    }
    d_q_d_k->col(6) << 2.0 * x * x + s, 2.0 * x * y;
    d_q_d_k->col(7) << 2.0 * x * y, 2.0 * y * y + s;
    d_q_d_k->col(8) << s, 0.0;
    d_q_d_k->col(9) << s * s, 0.0;
    d_q_d_k->col(10) << 0.0, s;
    d_q_d_k->col(11) << 0.0, s * s;
  }

  static double MaxRadius(const double* k, double upper) {
    std::array<double, 7> derivative{1.0};
    for (int i = 0; i < 6; ++i) derivative[i + 1] = (2 * i + 3) * k[i];
    return std::sqrt(FirstPositiveRoot(derivative, upper * upper));
  }
};

}  // namespace rsfm
