// The enhanced unified camera model in front of the camera, k = alpha beta:
//   q = p / (alpha sqrt(beta r^2 + 1) + 1 - alpha)   [Khomutenko 2016, RA-L 1(1), eq. (5), with z =
//   1]
#pragma once

#include <cmath>

#include "rsfm/base/linear.h"

namespace rsfm {

struct EucmDistortion {
  static constexpr int kNumParams = 2;
  static constexpr bool kIsRadial = true;
  using ParamsJacobian = Eigen::Matrix<double, 2, kNumParams>;

  template <class T>
  static void Apply(const T* k, const Vec2T<T>& p, Vec2T<T>* q) {
    using std::sqrt;
    const T r2 = p.x() * p.x() + p.y() * p.y();
    const T denominator = k[0] * sqrt(k[1] * r2 + T(1.0)) + T(1.0) - k[0];
    *q = Vec2T<T>(p.x() / denominator, p.y() / denominator);
  }

  static void Apply(const double* k, const Vec2& p, Vec2* q, Mat2* d_q_d_p,
                    ParamsJacobian* d_q_d_k) {
    const double r2 = p.squaredNorm(), alpha = k[0], beta = k[1];
    const double root = std::sqrt(beta * r2 + 1.0);
    const double factor = 1.0 / (alpha * (root - 1.0) + 1.0);
    const double per_denominator = -factor * factor;
    *q = factor * p;
    *d_q_d_p =
        factor * Mat2::Identity() + (per_denominator * alpha * beta / root) * p * p.transpose();
    if (d_q_d_k == nullptr) return;
    d_q_d_k->col(0) = (per_denominator * (root - 1.0)) * p;
    d_q_d_k->col(1) = (per_denominator * 0.5 * alpha * r2 / root) * p;
  }

  // [ibid., eq. (9)]
  static bool Undistort(const double* k, const Vec2& q, Vec2* p) {
    const double r2 = q.squaredNorm(), alpha = k[0], beta = k[1];
    const double radicand = 1.0 - (2.0 * alpha - 1.0) * beta * r2;
    if (!(radicand >= 0.0)) return false;
    const double z =
        (1.0 - beta * alpha * alpha * r2) / (alpha * std::sqrt(radicand) + 1.0 - alpha);
    if (!(z > 0.0)) return false;
    *p = q / z;
    return true;
  }

  // Grows for ever where the model is one: alpha in [0, 1], beta > 0.
  static double MaxRadius(const double* k, double upper) {
    return k[0] >= 0.0 && k[0] <= 1.0 && k[1] > 0.0 ? upper : 0.0;
  }
};

}  // namespace rsfm
