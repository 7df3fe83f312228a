// Snell's law in vector form.
#pragma once

#include <cmath>

#include "rsfm/base/linear.h"

namespace rsfm {

// Refracts a unit direction at a surface whose unit normal points the way the light goes:
//   v' = r v + (sqrt(1 - r^2 (1 - c^2)) - r c) n,  c = n . v,  r = index_from / index_to
// [She 2024, arXiv:2403.08640, eq. (1)]. False on total internal reflection; the output is then
// untouched. Preconditions: n . v >= 0.
inline bool Refract(const Vec3& direction, const Vec3& normal, double index_ratio,
                    Vec3* refracted) noexcept {
  const double cosine = normal.dot(direction);
  const double radicand = 1.0 - index_ratio * index_ratio * (1.0 - cosine * cosine);
  if (!(radicand >= 0.0)) return false;
  *refracted = index_ratio * direction + (std::sqrt(radicand) - index_ratio * cosine) * normal;
  return true;
}

}  // namespace rsfm
