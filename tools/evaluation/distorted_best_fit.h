// The best-approximated perspective camera as the peer has it.
#pragma once

#include <optional>

#include "rsfm/refraction/any_camera.h"

namespace rsfm {

// With distortion, OPENCV's, fitted to points at that range: no pinhole comes within the inliers'
// 4 px of a wide view through a flat port. None where the fit fails.   [She 2024, arXiv:2403.08640,
// "Relative Pose Estimation"]
std::optional<AnyCamera> FitWithDistortion(const AnyCamera& camera, double range_m = 5.0);

}  // namespace rsfm
