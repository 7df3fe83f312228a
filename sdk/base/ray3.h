// A half-line in space.
#pragma once

#include "rsfm/base/linear.h"

namespace rsfm {

struct Ray3 {
  Vec3 origin = Vec3::Zero();      // metres
  Vec3 direction = Vec3::UnitZ();  // unit

  Vec3 At(double range) const { return origin + range * direction; }

  // Signed distance along the ray to the foot of the perpendicular from `point`.
  double RangeTo(const Vec3& point) const { return direction.dot(point - origin); }

  // Perpendicular distance of `point` from the ray's line.
  double Distance(const Vec3& point) const { return direction.cross(point - origin).norm(); }
};

}  // namespace rsfm
