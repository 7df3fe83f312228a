// Relative pose of two cameras without a single centre from seventeen rays, linearly.
#pragma once

#include <span>

#include "rsfm/base/ray3.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/base/static_vector.h"

namespace rsfm {

inline constexpr int kSeventeenPointSampleSize = 17;
using SeventeenPointSolutions = StaticVector<Rigid3, 2>;

// b_from_a, length included, from corresponding rays in water. The generalised epipolar constraint
//   d_b' E d_a + d_b' R m_a + m_b' R d_a = 0,   E = [t]x R,  m = o x d,
// is linear in the 18 entries of E and R.   [Pless 2003, CVPR] A camera behind one port is axial:
// its rays all meet one axis v, R + mu v v' then satisfies the same equations, and R is left to
// E alone: the equations are projected off the column space of R's coefficients and solved for
// |E| = 1.   [Li 2008, CVPR, "A Linear Approach to Motion Estimation Using Generalized Camera
// Models", secs. 4-5; used for refractive cameras by Hu 2023]
//   One pose for each of the two rotations of E, where most points lie in front of both cameras.
// None for rays through one centre (the length would be invented), for degenerate or not finite
// input.
//   Linear in quantities that are millimetres against metres: usable for next to no noise only. It
// is here because the literature's evaluations name it.
SeventeenPointSolutions SolveSeventeenPoint(
    std::span<const Ray3, kSeventeenPointSampleSize> rays_in_a,
    std::span<const Ray3, kSeventeenPointSampleSize> rays_in_b) noexcept;

}  // namespace rsfm
