// The field-of-view model, k = omega [rad]: r_d = atan(2 r tan(omega / 2)) / omega.
// [Devernay & Faugeras 2001, MVA 13(1), eq. (13)]
#pragma once

#include <cmath>
#include <numbers>

#include "rsfm/base/linear.h"

namespace rsfm {

struct FovDistortion {
  static constexpr int kNumParams = 1;
  static constexpr bool kIsRadial = true;
  using ParamsJacobian = Eigen::Matrix<double, 2, kNumParams>;

  // r_d / r as a function of r^2 and omega; by series where omega or r is too small for the
  // quotient.
  template <class T>
  static T Factor(const T& omega, const T& r2) {
    using std::atan;
    using std::sqrt;
    using std::tan;
    if (omega * omega < T(1e-8)) return T(1.0) + omega * omega * (T(1.0) / T(12.0) - r2 / T(3.0));
    const T m = T(2.0) * tan(omega / T(2.0));
    if (m * m * r2 < T(1e-8)) return m / omega * (T(1.0) - m * m * r2 / T(3.0));
    const T r = sqrt(r2);
    return atan(m * r) / (omega * r);
  }

  template <class T>
  static void Apply(const T* k, const Vec2T<T>& p, Vec2T<T>* q) {
    const T factor = Factor(k[0], T(p.x() * p.x() + p.y() * p.y()));
    *q = Vec2T<T>(factor * p.x(), factor * p.y());
  }

  static void Apply(const double* k, const Vec2& p, Vec2* q, Mat2* d_q_d_p,
                    ParamsJacobian* d_q_d_k) {
    const double omega = k[0], r2 = p.squaredNorm();
    const double m = 2.0 * std::tan(0.5 * omega), d_m = 1.0 + 0.25 * m * m;  // dm / d omega
    const double factor = Factor(omega, r2);
    double slope, d_omega;  // derivatives of the factor to r^2 and omega
    if (omega * omega < 1e-8) {
      slope = -omega * omega / 3.0;
      d_omega = 2.0 * omega * (1.0 / 12.0 - r2 / 3.0);
    } else if (m * m * r2 < 1e-8) {
      slope = -m * m * m / (3.0 * omega);
      d_omega = d_m / omega * (1.0 - m * m * r2) - factor / omega;
    } else {
      const double cosine_squared = 1.0 / (1.0 + m * m * r2);  // of the distorted angle
      slope = (m * cosine_squared / omega - factor) / (2.0 * r2);
      d_omega = d_m * cosine_squared / omega - factor / omega;
    }
    *q = factor * p;
    *d_q_d_p = factor * Mat2::Identity() + 2.0 * slope * p * p.transpose();
    if (d_q_d_k != nullptr) d_q_d_k->col(0) = d_omega * p;
  }

  static bool Undistort(const double* k, const Vec2& q, Vec2* p) {
    const double omega = k[0], r = q.norm();
    if (omega * omega < 1e-8) {  // the series of Factor, inverted to its order
      *p = q * (1.0 - omega * omega * (1.0 / 12.0 - r * r / 3.0));
      return true;
    }
    const double angle = r * omega, m = 2.0 * std::tan(0.5 * omega);
    if (!(std::abs(angle) < 0.5 * std::numbers::pi)) return false;
    *p = q * (r < 1e-8 ? omega / m : std::tan(angle) / (m * r));
    return true;
  }

  // Grows for ever, for an angle of view that exists.
  static double MaxRadius(const double* k, double upper) {
    return std::abs(k[0]) < std::numbers::pi ? upper : 0.0;
  }
};

}  // namespace rsfm
