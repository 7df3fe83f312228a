// Relative pose of two cameras without a single centre from eight rays, by an eigenvalue over
// rotations.
#pragma once

#include <span>

#include "rsfm/base/ray3.h"
#include "rsfm/base/rigid3.h"

namespace rsfm {

inline constexpr int kGeneralisedEightPointSampleSize = 8;

// b_from_a, length included: the rotation that minimises the smallest eigenvalue of
//   G(R) = sum g g',   g = (R d_a x d_b, d_b . R m_a + m_b . R d_a),   m = o x d,
// whose eigenvector is proportional to (t, 1).   [Kneip & Li 2014, CVPR, "Efficient Computation of
// Relative Pose for Multi-Camera Systems", eqs. (9)-(12); "GR6P" in She 2024] Levenberg-Marquardt
// over the rotation from the given start, at most 30 steps; the moments are first brought to the
// directions' size. False for rays through one centre (the last component of g vanishes, and with
// it the smallest eigenvalue for every rotation), without convergence, or for input that is not
// finite; the output is then untouched.
//   Behind one port the last component is millimetres against metres and the same happens nearly:
// usable for next to no noise only. It is here because the literature's evaluations name it.
bool SolveGeneralisedEightPoint(std::span<const Ray3, kGeneralisedEightPointSampleSize> rays_in_a,
                                std::span<const Ray3, kGeneralisedEightPointSampleSize> rays_in_b,
                                const Mat3& rotation_start, Rigid3* b_from_a) noexcept;

}  // namespace rsfm
