#include "rsfm/base/so3.h"

#include <cmath>

namespace rsfm {

Mat3 Hat(const Vec3& v) noexcept {
  Mat3 m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

Quat ExpSo3(const Vec3& rotation_vector) noexcept {
  const double angle_squared = rotation_vector.squaredNorm();
  const double half = 0.5 * std::sqrt(angle_squared);
  // sin(x / 2) / x, by its series where the quotient would lose digits.
  const double scale =
      angle_squared < 1e-8 ? 0.5 - angle_squared / 48.0 : 0.5 * std::sin(half) / half;
  Quat q;
  q.w() = std::cos(half);
  q.vec() = scale * rotation_vector;
  return q;
}

Vec3 LogSo3(const Quat& rotation) noexcept {
  const double sign =
      rotation.w() < 0.0 ? -1.0 : 1.0;  // q and -q are the same rotation: take the short way
  const double w = sign * rotation.w();
  const Vec3 v = sign * rotation.vec();
  const double norm = v.norm();
  const double scale = norm < 1e-8 ? 2.0 / w * (1.0 - norm * norm / (3.0 * w * w))
                                   : 2.0 * std::atan2(norm, w) / norm;
  return scale * v;
}

Mat3 LeftJacobianSo3(const Vec3& a) noexcept {
  const double t2 = a.squaredNorm();
  const Mat3 hat = Hat(a);
  double b, c;  // (1 - cos t) / t^2, (t - sin t) / t^3
  if (t2 < 1e-4) {
    b = 0.5 - t2 / 24.0 + t2 * t2 / 720.0;
    c = 1.0 / 6.0 - t2 / 120.0 + t2 * t2 / 5040.0;
  } else {
    const double t = std::sqrt(t2);
    b = (1.0 - std::cos(t)) / t2;
    c = (t - std::sin(t)) / (t2 * t);
  }
  return Mat3::Identity() + b * hat + c * hat * hat;
}

Mat3 LeftJacobianInverseSo3(const Vec3& a) noexcept {
  const double t2 = a.squaredNorm();
  const Mat3 hat = Hat(a);
  double c;  // 1/t^2 - (1 + cos t) / (2 t sin t)
  if (t2 < 1e-4) {
    c = 1.0 / 12.0 + t2 / 720.0 + t2 * t2 / 30240.0;
  } else {
    const double t = std::sqrt(t2);
    // cot(t/2) keeps its digits near pi, where (1 + cos t) / sin t does not.
    c = (1.0 - 0.5 * t / std::tan(0.5 * t)) / t2;
  }
  return Mat3::Identity() - 0.5 * hat + c * hat * hat;
}

double AngleBetween(const Quat& a, const Quat& b) noexcept {
  return LogSo3(a.conjugate() * b).norm();
}

}  // namespace rsfm
