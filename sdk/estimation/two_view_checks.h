// Questions about a set of corresponding rays whose answer makes a relative pose unsound. Part of
// two_view.
#pragma once

#include <span>

#include "rsfm/estimation/ray_pair.h"

namespace rsfm::internal {

// The smaller standard deviation of the bearings' spread, in pixels, of the thinner of the two
// images: near the noise, the points lie on a line.
double ThinnestSpreadPx(std::span<const RayPair> pairs, std::span<const int> active) noexcept;

// The share of the pairs whose bearings a rotation alone brings within max_error_px. The rotation
// starts at the given one; robust Gauss-Newton, at most 20 steps.
double RotationOnlyRatio(std::span<const RayPair> pairs, std::span<const int> active,
                         const Mat3& rotation, double max_error_px) noexcept;

// The plane n . X = 1 in camera a on which the most pairs meet: the share of pairs within
// max_error_px of their transfer through it. Starts from the points where the rays meet; robust
// Gauss-Newton, at most 20 steps. 0 when fewer than 4 meet in front.
double PlaneRatio(std::span<const RayPair> pairs, std::span<const int> active,
                  const RelativePose& pose, double max_error_px, Vec3* plane) noexcept;

// The other relative poses that move the points of a plane in the same way, with the given
// baseline's length, whether or not the points are in front of both cameras. None where they
// coincide with the given one.   [Ma 2004, An Invitation to 3-D Vision, theorem 5.19;
// Longuet-Higgins 1986, Proc. R. Soc. B 227]
StaticVector<RelativePose, 3> OtherPosesOfPlane(const RelativePose& pose,
                                                const Vec3& plane) noexcept;

}  // namespace rsfm::internal
