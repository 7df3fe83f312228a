// The generalised epipolar constraint of rays as lines: what the solvers for cameras without a
// single centre share.
#pragma once

#include <cmath>
#include <span>

#include "rsfm/base/ray3.h"
#include "rsfm/base/rigid3.h"

namespace rsfm::internal {

// A ray's line in Pluecker coordinates: unit direction and moment about the camera's centre.
struct Line {
  Vec3 direction;
  Vec3 moment;
};

inline Line ToLine(const Ray3& ray) { return {ray.direction, ray.origin.cross(ray.direction)}; }

// The baseline's length |t| for a rotation R and a unit direction u of t: least squares of
//   |t| u . (R d_a x d_b) + (d_b . R m_a + m_b . R d_a) = 0.   [Pless 2003, CVPR, eq. (7)]
// Of either sign; 0 where the rays do not tell it.
inline double FitBaseline(const Mat3& rotation, const Vec3& direction, std::span<const Line> a,
                          std::span<const Line> b) {
  double numerator = 0.0, denominator = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Vec3 turned = rotation * a[i].direction;
    const double slope = direction.dot(turned.cross(b[i].direction));
    const double constant = b[i].direction.dot(rotation * a[i].moment) + b[i].moment.dot(turned);
    numerator -= slope * constant;
    denominator += slope * slope;
  }
  return denominator > 0.0 ? numerator / denominator : 0.0;
}

}  // namespace rsfm::internal
