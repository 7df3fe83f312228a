// The rotation group SO(3): exponential, logarithm and Jacobians of unit quaternions.
// Angles in radians; perturbations are on the left (see rigid3.h).
#pragma once

#include "rsfm/base/linear.h"

namespace rsfm {

// [v]x: Hat(v) * w == v.cross(w).
Mat3 Hat(const Vec3& v) noexcept;

// Rotation vector to unit quaternion; exact to double precision for every angle, small ones
// included.
Quat ExpSo3(const Vec3& rotation_vector) noexcept;

// Unit quaternion to the rotation vector of length <= pi. Inverse of ExpSo3.
Vec3 LogSo3(const Quat& rotation) noexcept;

// d Exp(a + h) = Exp(J h) Exp(a) to first order.   [Sola 2018, arXiv:1812.01537, eq. (145)]
Mat3 LeftJacobianSo3(const Vec3& rotation_vector) noexcept;
Mat3 LeftJacobianInverseSo3(
    const Vec3& rotation_vector) noexcept;  // [ibid., eq. (146)]; |a| < 2 pi

// The angle of the rotation between two attitudes, in [0, pi].
double AngleBetween(const Quat& a, const Quat& b) noexcept;

}  // namespace rsfm
