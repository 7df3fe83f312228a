// The central (rectilinear) projection onto the plane z = 1.
#pragma once

#include <cmath>

#include "rsfm/base/linear.h"

namespace rsfm {

struct PerspectiveBase {
  static constexpr bool kIsPerspective = true;
  // Of the plane's points: a microradian from the horizon. Beyond, pixels are no longer numbers one
  // can work with.
  static constexpr double kMaxRadius = 1e6;

  // p = (x / z, y / z). False at or behind the plane of the centre.
  template <class T>
  static bool FromDirection(const Vec3T<T>& d, Vec2T<T>* p) {
    if (!(d.z() > T(0.0))) return false;
    const T inverse_z = T(1.0) / d.z();
    *p = Vec2T<T>(d.x() * inverse_z, d.y() * inverse_z);
    return true;
  }
  static bool FromDirection(const Vec3& d, Vec2* p, Mat23* d_p_d_direction) {
    if (!(d.z() > 0.0)) return false;
    const double inverse_z = 1.0 / d.z();
    *p = Vec2(d.x() * inverse_z, d.y() * inverse_z);
    *d_p_d_direction << inverse_z, 0.0, -p->x() * inverse_z, 0.0, inverse_z, -p->y() * inverse_z;
    return true;
  }
  static bool ToDirection(const Vec2& p, Vec3* direction) {
    const double scale = 1.0 / std::sqrt(1.0 + p.squaredNorm());
    *direction = Vec3(p.x() * scale, p.y() * scale, scale);
    return true;
  }
};

}  // namespace rsfm
