// Pose of a camera with or without a single centre from N >= 4 points, without a start and without
// robustness: where a refinement may begin.
#pragma once

#include <span>

#include "rsfm/base/error.h"
#include "rsfm/base/ray3.h"
#include "rsfm/base/rigid3.h"

namespace rsfm {

inline constexpr int kMinGeneralisedPnpPoints = 4;

struct GeneralisedPnpReport {
  Rigid3 camera_from_world;
  double rms_distance_m = 0.0;  // of the points from their rays
  int num_behind = 0;           // points behind their ray's origin
};

// The pose that minimises the squared distances of the points from their rays,
//   sum |(I - d d') (R X + t - o)|^2,
// over all rotations. t is eliminated; what is left is a quadratic in the nine entries of R, which
// Gauss-Newton minimises over SO(3) from the rotations nearest to the three lowest eigenvectors of
// its matrix and their opposites, at most 15 steps each; the lowest minimum with the points in
// front is taken. Planes and cameras with a single centre are no exceptions, and the work is linear
// in N.
//   [Terzakis & Lourakis 2020, ECCV, "A Consistently Fast and Globally Optimal Solution to the
//   Perspective-n-Point Problem", with the linear term of rays that have origins of their own; the
//   object-space error of Schweighofer & Pinz 2008, BMVC]
//   kInvalidArgument  the spans differ in length, or something is not finite
//   kNotEnoughData    fewer than four points; `detail` is how many
//   kDegenerate       the points do not determine the pose: coincident, collinear, on parallel rays
Expected<GeneralisedPnpReport> SolveGeneralisedPnp(std::span<const Ray3> rays_in_camera,
                                                   std::span<const Vec3> points_in_world) noexcept;

}  // namespace rsfm
