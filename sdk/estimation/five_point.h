// Relative pose of two calibrated central cameras from five correspondences.
#pragma once

#include <span>

#include "rsfm/base/rigid3.h"
#include "rsfm/base/static_vector.h"

namespace rsfm {

inline constexpr int kFivePointSampleSize = 5;
using EssentialMatrices = StaticVector<Mat3, 10>;

// Essential matrices E = [t]x R, of unit Frobenius norm, with  b_i' E a_i = 0  for the bearings
// (any length) of five points in cameras a and b, point_in_b = R point_in_a + t.   [Nister 2004,
// PAMI 26(6), "An Efficient Solution to the Five-Point Relative Pose Problem"] None when an input
// is not finite or the sample is degenerate.
EssentialMatrices SolveFivePoint(
    std::span<const Vec3, kFivePointSampleSize> bearings_in_a,
    std::span<const Vec3, kFivePointSampleSize> bearings_in_b) noexcept;

// The four poses b_from_a with a unit translation of an essential matrix.   [Horn 1990, "Recovering
// baseline and orientation from essential matrix"; Nister 2004, sec. 3.1]
StaticVector<Rigid3, 4> DecomposeEssential(const Mat3& essential) noexcept;

// Whether the rays from the two centres towards a point meet in front of both (cheirality): the
// signs of both depths of the midpoint.
bool IsInFront(const Rigid3& b_from_a, const Vec3& bearing_in_a, const Vec3& bearing_in_b) noexcept;

}  // namespace rsfm
