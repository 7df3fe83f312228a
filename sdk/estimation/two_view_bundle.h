// Two-view refractive bundle adjustment: a relative pose and the points, by the true image error in
// both images. Part of two_view.
#pragma once

#include <array>
#include <span>

#include "rsfm/estimation/ray_pair.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

struct TwoViewImages {
  const AnyCamera* camera_a = nullptr;
  const AnyCamera* camera_b = nullptr;
  std::span<const Vec2> pixels_a, pixels_b;  // RayPair::index counts in these
};

// Memory of one correspondence.
struct BundlePair {
  struct State {
    Vec3 point_in_a = Vec3::Zero();
    Vec3 step = Vec3::Zero();             // of the point towards its optimum ...
    Mat36 step_per_pose = Mat36::Zero();  // ... and what a step of the pose adds to it
  };
  std::array<State, 2> states;  // the best so far and the trial
  bool has_point = false;       // else its parallax is below the noise: no point can be had
};

// Levenberg-Marquardt from a pose that a refinement of the epipolar cost has left. Each point is
// eliminated with the left null vector of its 4 x 3 Jacobian, which leaves one residual a point
// [Triggs 1999, "Bundle Adjustment: A Modern Synthesis", sec. 6.1, in its square-root form]; pairs
// without a parallax above four sigmas of the noise keep their first-order distance, which is the
// same to first order. The loss acts on the squared error in both images together; priors and
// bounds of the baseline are those of the epipolar refinement. Returns the iterations, at most
// options.max_iterations; the pose is left at the lowest cost found.
// Precondition: memory.size() >= active.size(); memory[k] belongs to pairs[active[k]], and its
// states[0] holds the point afterwards.
int RefineTwoViewBundle(const TwoViewImages& images, std::span<const RayPair> pairs,
                        std::span<const int> active, const EpipolarRefineOptions& options,
                        std::span<BundlePair> memory, RelativePose* pose) noexcept;

}  // namespace rsfm
