// The identity, as a distortion.
#pragma once

#include <limits>

#include "rsfm/base/linear.h"

namespace rsfm {

struct NoDistortion {
  static constexpr int kNumParams = 0;
  static constexpr bool kIsRadial = true;
  using ParamsJacobian = Eigen::Matrix<double, 2, 0>;

  template <class T>
  static void Apply(const T*, const Vec2T<T>& p, Vec2T<T>* q) {
    *q = p;
  }
  static void Apply(const double*, const Vec2& p, Vec2* q, Mat2* d_q_d_p, ParamsJacobian*) {
    *q = p;
    d_q_d_p->setIdentity();
  }
  static double MaxRadius(const double*, double upper) { return upper; }
};

}  // namespace rsfm
