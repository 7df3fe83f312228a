// Rigid transforms, named b_from_a: point_in_b = b_from_a * point_in_a.
//
// Perturbations are on the left: b_from_a is updated to Exp(delta) * b_from_a with
// delta = (rotation [rad], translation [m]). This is the project's only convention.
#pragma once

#include "rsfm/base/linear.h"
#include "rsfm/base/so3.h"

namespace rsfm {

struct Rigid3 {
  Quat rotation = Quat::Identity();  // unit
  Vec3 translation = Vec3::Zero();   // metres

  Rigid3() = default;
  Rigid3(const Quat& rotation_in, const Vec3& translation_in)
      : rotation(rotation_in), translation(translation_in) {}

  Vec3 operator*(const Vec3& point) const { return rotation * point + translation; }
  // Keeps the quaternion at unit length, however long the chain of products.
  Rigid3 operator*(const Rigid3& other) const {
    return {(rotation * other.rotation).normalized(), rotation * other.translation + translation};
  }
  Rigid3 Inverse() const {
    const Quat inverse = rotation.conjugate();
    return {inverse, -(inverse * translation)};
  }
  // The origin of a in b, for b_from_a, is `translation`; this is the origin of b in a.
  Vec3 OriginOfTarget() const { return -(rotation.conjugate() * translation); }
};

// (rotation, translation) tangent vector to transform and back.   [Sola 2018, arXiv:1812.01537,
// eqs. (172)-(174)]
Rigid3 ExpSe3(const Vec6& tangent) noexcept;
Vec6 LogSe3(const Rigid3& transform) noexcept;

// T Exp(x) = Exp(Adjoint(T) x) T.
Mat6 AdjointSe3(const Rigid3& transform) noexcept;

// Exp(delta) * transform, the update of every optimiser here.
inline Rigid3 Perturb(const Rigid3& transform, const Vec6& delta) noexcept {
  return ExpSe3(delta) * transform;
}

// Linear in translation, geodesic in rotation; fraction 0 gives `start`, 1 gives `end`.
Rigid3 Interpolate(const Rigid3& start, const Rigid3& end, double fraction) noexcept;

}  // namespace rsfm
