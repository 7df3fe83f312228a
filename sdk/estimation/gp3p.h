// Generalised perspective three-point: the pose of a camera without a single centre from three
// world points.
#pragma once

#include <span>

#include "rsfm/base/ray3.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/base/static_vector.h"

namespace rsfm {

inline constexpr int kGp3pSampleSize = 3;
using Gp3pSolutions = StaticVector<Rigid3, 8>;

// camera_from_world such that each world point lies on its own ray,
//   rays[i].origin + lambda_i rays[i].direction = R X_i + t,  lambda_i > 0.
// No solution for collinear or coincident points or when an input is not finite.
//   The three distance equations |P_i - P_j|^2 = |X_i - X_j|^2 are quadrics in the ranges. [Nister
//   & Stewenius 2007,
// JMIV 27(1); Lee 2016, ISRR] Two paths share the closing Newton iteration on them:
//   - rays that nearly meet (every housing port): the central problem about the point nearest to
//   the three rays gives the
//     starts; exact and well conditioned down to a perfectly central camera, where it is P3P;
//   - any other rays (a rig of cameras): elimination to the octic in the first range.
Gp3pSolutions SolveGp3p(std::span<const Ray3, kGp3pSampleSize> rays_in_camera,
                        std::span<const Vec3, kGp3pSampleSize> points_in_world) noexcept;

}  // namespace rsfm
