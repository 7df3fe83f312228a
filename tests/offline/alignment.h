// A found trajectory against the true one.
#pragma once

#include <Eigen/Dense>
#include <cmath>
#include <vector>

#include "rsfm/base/linear.h"

namespace rsfm {

// The scale of the found places against the true ones, and their RMS distance after the similarity
// that fits best.
struct Alignment {
  double scale = 1.0;
  double rms_m = 0.0;
};
inline Alignment AlignPlaces(const std::vector<Vec3>& found, const std::vector<Vec3>& truth) {
  const Eigen::Index count = static_cast<Eigen::Index>(found.size());
  Eigen::Matrix3Xd from(3, count), to(3, count);
  for (Eigen::Index k = 0; k < count; ++k) {
    from.col(k) = found[k];
    to.col(k) = truth[k];
  }
  const Eigen::Matrix4d to_from = Eigen::umeyama(from, to, true);
  const Vec3 shift = to_from.topRightCorner<3, 1>();
  const Eigen::Matrix3Xd moved = (to_from.topLeftCorner<3, 3>() * from).colwise() + shift;
  Alignment result;
  result.scale = 1.0 / std::cbrt(to_from.topLeftCorner<3, 3>().determinant());
  result.rms_m = std::sqrt((moved - to).squaredNorm() / static_cast<double>(count));
  return result;
}

}  // namespace rsfm
