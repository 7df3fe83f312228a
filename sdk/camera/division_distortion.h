// The division model, k: the undistorted radius is r = r_d / (1 + k r_d^2); solved for the
// distorted one,
//   r_d = 2 r / (1 + sqrt(1 - 4 k r^2)).   [Fitzgibbon 2001, CVPR, eq. (1)]
#pragma once

#include <algorithm>
#include <cmath>

#include "rsfm/base/linear.h"

namespace rsfm {

struct DivisionDistortion {
  static constexpr int kNumParams = 1;
  static constexpr bool kIsRadial = true;
  using ParamsJacobian = Eigen::Matrix<double, 2, kNumParams>;

  template <class T>
  static void Apply(const T* k, const Vec2T<T>& p, Vec2T<T>* q) {
    using std::sqrt;
    const T r2 = p.x() * p.x() + p.y() * p.y();
    const T factor = T(2.0) / (T(1.0) + sqrt(T(1.0) - T(4.0) * k[0] * r2));
    *q = Vec2T<T>(factor * p.x(), factor * p.y());
  }

  static void Apply(const double* k, const Vec2& p, Vec2* q, Mat2* d_q_d_p,
                    ParamsJacobian* d_q_d_k) {
    const double r2 = p.squaredNorm();
    const double root = std::sqrt(std::max(0.0, 1.0 - 4.0 * k[0] * r2));
    const double factor = 2.0 / (1.0 + root);
    const double per_product = factor * factor / root;  // d factor / d (k r^2)
    *q = factor * p;
    *d_q_d_p = factor * Mat2::Identity() + (2.0 * per_product * k[0]) * p * p.transpose();
    if (d_q_d_k != nullptr) d_q_d_k->col(0) = per_product * r2 * p;
  }

  static bool Undistort(const double* k, const Vec2& q, Vec2* p) {
    const double denominator = 1.0 + k[0] * q.squaredNorm();
    if (!(denominator > 0.0) || !(k[0] * q.squaredNorm() < 1.0)) return false;  // beyond the fold
    *p = q / denominator;
    return true;
  }

  // Just short of the fold at 4 k r^2 = 1, where the slope is infinite.
  static double MaxRadius(const double* k, double upper) {
    return k[0] > 0.0 ? std::min(upper, std::sqrt((1.0 - 1e-9) / (4.0 * k[0]))) : upper;
  }
};

}  // namespace rsfm
