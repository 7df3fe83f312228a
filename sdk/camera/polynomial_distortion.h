// Brown's polynomial distortion in the plane of a base projection:
//   q = p (1 + k1 r^2 + k2 r^4 + ...)                                   radial
//     + (2 p1 x y + p2 (r^2 + 2 x^2), 2 p2 x y + p1 (r^2 + 2 y^2))      tangential
//     + (sx r^2, sy r^2)                                                thin prism
// with r^2 = x^2 + y^2.   [Brown 1971, Photogrammetric Engineering 37(8); Weng 1992, PAMI 14(10)
// for the thin prism]
#pragma once

#include <array>
#include <cmath>

#include "rsfm/base/linear.h"
#include "rsfm/camera/inverse_series.h"
#include "rsfm/camera/lens_block.h"
#include "rsfm/camera/polynomial.h"

namespace rsfm {

// Where each coefficient stands among a model's distortion parameters; -1: the model has not got
// it.
struct PolynomialLayout {
  int num_params = 0;
  int num_radial = 0;
  std::array<int, 6> radial = {-1, -1, -1, -1, -1, -1};
  int tangential = -1;              // of p1; p2 follows
  bool tangential_swapped = false;  // p2 comes first
  int prism = -1;                   // of sx; sy follows
};

template <PolynomialLayout kLayout>
struct PolynomialDistortion {
  static constexpr int kNumParams = kLayout.num_params;
  static constexpr bool kIsRadial = kLayout.tangential < 0 && kLayout.prism < 0;
  static constexpr int kP1 = kLayout.tangential + (kLayout.tangential_swapped ? 1 : 0);
  static constexpr int kP2 = kLayout.tangential + (kLayout.tangential_swapped ? 0 : 1);
  using ParamsJacobian = Eigen::Matrix<double, 2, kNumParams>;

  template <class T>
  static void Apply(const T* k, const Vec2T<T>& p, Vec2T<T>* q) {
    const T x = p.x(), y = p.y();
    const T r2 = x * x + y * y;
    T radial(0.0);
    for (int i = kLayout.num_radial - 1; i >= 0; --i) radial = (radial + k[kLayout.radial[i]]) * r2;
    T u = x + x * radial, v = y + y * radial;
    if constexpr (kLayout.tangential >= 0) {
      const T p1 = k[kP1], p2 = k[kP2];
      u += T(2.0) * p1 * x * y + p2 * (r2 + T(2.0) * x * x);
      v += T(2.0) * p2 * x * y + p1 * (r2 + T(2.0) * y * y);
    }
    if constexpr (kLayout.prism >= 0) {
      u += k[kLayout.prism] * r2;
      v += k[kLayout.prism + 1] * r2;
    }
    *q = Vec2T<T>(u, v);
  }

  static void Apply(const double* k, const Vec2& p, Vec2* q, Mat2* d_q_d_p,
                    ParamsJacobian* d_q_d_k) {
    const double x = p.x(), y = p.y();
    const double xx = x * x, yy = y * y, xy = x * y, r2 = xx + yy;
    double radial = 0.0, slope = 0.0;  // sum k_i r^2i and its derivative to r^2
    for (int i = kLayout.num_radial - 1; i >= 0; --i) {
      slope = slope * r2 + (i + 1) * k[kLayout.radial[i]];
      radial = (radial + k[kLayout.radial[i]]) * r2;
    }
    double u = x + x * radial, v = y + y * radial;
    double uu = 1.0 + radial + 2.0 * xx * slope, uv = 2.0 * xy * slope, vu = uv,
           vv = 1.0 + radial + 2.0 * yy * slope;
    if constexpr (kLayout.tangential >= 0) {
      const double p1 = k[kP1], p2 = k[kP2];
      u += 2.0 * p1 * xy + p2 * (r2 + 2.0 * xx);
      v += 2.0 * p2 * xy + p1 * (r2 + 2.0 * yy);
      uu += 2.0 * p1 * y + 6.0 * p2 * x;
      uv += 2.0 * p1 * x + 2.0 * p2 * y;
      vu += 2.0 * p2 * y + 2.0 * p1 * x;
      vv += 2.0 * p2 * x + 6.0 * p1 * y;
    }
    if constexpr (kLayout.prism >= 0) {
      const double sx = k[kLayout.prism], sy = k[kLayout.prism + 1];
      u += sx * r2;
      v += sy * r2;
      uu += 2.0 * sx * x;
      uv += 2.0 * sx * y;
      vu += 2.0 * sy * x;
      vv += 2.0 * sy * y;
    }
    *q = Vec2(u, v);
    *d_q_d_p << uu, uv, vu, vv;
    if (d_q_d_k == nullptr) return;
    double power = 1.0;
    for (int i = 0; i < kLayout.num_radial; ++i) {
      power *= r2;
      d_q_d_k->col(kLayout.radial[i]) = power * p;
    }
    if constexpr (kLayout.tangential >= 0) {
      d_q_d_k->col(kP1) << 2.0 * xy, r2 + 2.0 * yy;
      d_q_d_k->col(kP2) << r2 + 2.0 * xx, 2.0 * xy;
    }
    if constexpr (kLayout.prism >= 0) {
      d_q_d_k->col(kLayout.prism) << r2, 0.0;
      d_q_d_k->col(kLayout.prism + 1) << 0.0, r2;
    }
  }

  static InverseSeries MakeInverseSeries(const double* k) {
    std::array<double, InverseSeries::kTerms> a{};
    for (int i = 0; i < kLayout.num_radial; ++i) a[i] = k[kLayout.radial[i]];
    return RevertRadialSeries(a);
  }

  // Where to start the search for the undistorted point: the reverted radial series, then the
  // tangential and prism terms taken off to first order.
  static Vec2 UndistortStart(const double* k, const InverseSeries& series, const Vec2& q) {
    const double factor = series.Factor(q.x() * q.x() + q.y() * q.y());
    if (!(std::abs(factor) < kMaxSeriesFactor)) return q;  // too strong for a series
    double x = q.x() + factor * q.x(), y = q.y() + factor * q.y();
    if constexpr (!kIsRadial) {
      const double xx = x * x, yy = y * y, r2 = xx + yy;
      double u = 0.0, v = 0.0;
      if constexpr (kLayout.tangential >= 0) {
        u += 2.0 * k[kP1] * x * y + k[kP2] * (r2 + 2.0 * xx);
        v += 2.0 * k[kP2] * x * y + k[kP1] * (r2 + 2.0 * yy);
      }
      if constexpr (kLayout.prism >= 0) {
        u += k[kLayout.prism] * r2;
        v += k[kLayout.prism + 1] * r2;
      }
      x -= u;
      y -= v;
    }
    return {x, y};
  }

  // Within this radius the distortion is monotone in every direction: where even the sum of all
  // that could turn its Jacobian stays below one, the identity wins.
  static double SafeRadius(const double* k) {
    double linear = 0.0;  // bounds the Jacobian of the tangential and prism terms, per radius
    if constexpr (kLayout.tangential >= 0) linear += 8.0 * (std::abs(k[kP1]) + std::abs(k[kP2]));
    if constexpr (kLayout.prism >= 0)
      linear += 2.0 * (std::abs(k[kLayout.prism]) + std::abs(k[kLayout.prism + 1]));
    double safe = 0.0;
    for (double step = 4.0; step > 1e-3; step *= 0.5) {
      const double r = safe + step, r2 = r * r;
      double sum = 0.0;  // of the radial terms' slopes
      for (int i = kLayout.num_radial - 1; i >= 0; --i)
        sum = (sum + (2 * i + 3) * std::abs(k[kLayout.radial[i]])) * r2;
      if (sum + linear * r < 0.99) safe = r;
    }
    return safe;
  }

  static void FillBlockParams(const double* k, const InverseSeries& series,
                              LensBlockParams* params) {
    params->series = series;
    for (int i = 0; i < kLayout.num_radial; ++i) params->radial[i] = k[kLayout.radial[i]];
    if constexpr (kLayout.tangential >= 0) {
      params->p1 = k[kP1];
      params->p2 = k[kP2];
    }
    if constexpr (kLayout.prism >= 0) {
      params->sx = k[kLayout.prism];
      params->sy = k[kLayout.prism + 1];
    }
  }

  // Where r (1 + k1 r^2 + ...) stops growing: the root of 1 + 3 k1 r^2 + 5 k2 r^4 + ...
  static double MaxRadius(const double* k, double upper) {
    std::array<double, kLayout.num_radial + 1> derivative{1.0};
    for (int i = 0; i < kLayout.num_radial; ++i)
      derivative[i + 1] = (2 * i + 3) * k[kLayout.radial[i]];
    return std::sqrt(FirstPositiveRoot(derivative, upper * upper));
  }
};

}  // namespace rsfm
