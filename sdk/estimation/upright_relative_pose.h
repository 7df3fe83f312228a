// Relative pose of two central cameras that know which way is down, from three correspondences.
#pragma once

#include <span>

#include "rsfm/base/rigid3.h"
#include "rsfm/base/static_vector.h"

namespace rsfm {

inline constexpr int kUprightRelativeSampleSize = 3;
using UprightRelativeSolutions = StaticVector<Rigid3, 4>;

// b_from_a with a unit translation, R down_in_a = down_in_b exactly, from the bearings (any length)
// of three points. `down_in_a`, `down_in_b`: unit vectors, the same direction of the world seen in
// each camera (gravity by an attitude sensor).
//   With both cameras turned upright, R is a turn theta about the vertical and the three
// n_i = R a_i x b_i are orthogonal to t: det(n_1, n_2, n_3) = 0, in q = tan(theta / 2) a quartic
// after the factor 1 + q^2 is taken out.   [Fraundorfer 2010, ECCV, "A Minimal Case Solution to the
// Calibrated Relative Pose Problem for the Case of Two Known Orientation Angles"] Of the two signs
// of t that for which more points lie in front of both cameras. None when an input is not finite or
// the sample is degenerate.
UprightRelativeSolutions SolveUprightRelativePose(
    std::span<const Vec3, kUprightRelativeSampleSize> bearings_in_a,
    std::span<const Vec3, kUprightRelativeSampleSize> bearings_in_b, const Vec3& down_in_a,
    const Vec3& down_in_b) noexcept;

}  // namespace rsfm
