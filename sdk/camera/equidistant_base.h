// The equidistant (fisheye) projection: the radius is the angle from the optical axis.   [Kannala &
// Brandt 2006, PAMI]
#pragma once

#include <cmath>
#include <numbers>

#include "rsfm/base/linear.h"

namespace rsfm {

struct EquidistantBase {
  static constexpr bool kIsPerspective = false;
  static constexpr double kMaxRadius = std::numbers::pi;  // straight back
  // Directions nearer to the axis than this are on it.
  static constexpr double kAxisSineSquared = 1e-24;

  // p = theta (x, y) / |(x, y)|, theta = atan2(|(x, y)|, z). False for the null vector and straight
  // back.
  template <class T>
  static bool FromDirection(const Vec3T<T>& d, Vec2T<T>* p) {
    using std::atan2;
    using std::sqrt;
    const T rho_squared = d.x() * d.x() + d.y() * d.y();
    if (rho_squared <= T(kAxisSineSquared) * (rho_squared + d.z() * d.z())) {
      if (!(d.z() > T(0.0))) return false;
      *p = Vec2T<T>(d.x() / d.z(), d.y() / d.z());
      return true;
    }
    const T rho = sqrt(rho_squared);
    const T scale = atan2(rho, d.z()) / rho;
    *p = Vec2T<T>(scale * d.x(), scale * d.y());
    return true;
  }
  static bool FromDirection(const Vec3& d, Vec2* p, Mat23* d_p_d_direction) {
    const double rho_squared = d.x() * d.x() + d.y() * d.y();
    const double norm_squared = rho_squared + d.z() * d.z();
    double scale, slope;  // theta / rho and (d theta / d rho - theta / rho) / rho^2
    if (rho_squared <= kAxisSineSquared * norm_squared) {
      if (!(d.z() > 0.0)) return false;
      scale = 1.0 / d.z();
      slope = 0.0;
    } else {
      const double rho = std::sqrt(rho_squared);
      scale = std::atan2(rho, d.z()) / rho;
      slope = (d.z() / norm_squared - scale) / rho_squared;
    }
    *p = scale * d.head<2>();
    const double xy = slope * d.x() * d.y();
    *d_p_d_direction << scale + slope * d.x() * d.x(), xy, -d.x() / norm_squared, xy,
        scale + slope * d.y() * d.y(), -d.y() / norm_squared;
    return true;
  }
  static bool ToDirection(const Vec2& p, Vec3* direction) {
    const double theta = p.norm();
    if (!(theta <= kMaxRadius)) return false;
    const double scale = theta < 1e-8 ? 1.0 - theta * theta / 6.0 : std::sin(theta) / theta;
    *direction = Vec3(scale * p.x(), scale * p.y(), std::cos(theta));
    return true;
  }
};

}  // namespace rsfm
