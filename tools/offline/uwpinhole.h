// The usual approximation under water, as the baseline of every comparison: no port, and a lens
// that is made to absorb it.   [She 2024, arXiv:2403.08640, "UWPinhole"]
#pragma once

#include "rsfm/base/error.h"
#include "tools/offline/bundle.h"

namespace rsfm {

// The camera without its port, its lens replaced by the pinhole that fits the refractive camera
// best, from which the refinement starts. kDegenerate where none comes near it.
Expected<CameraConfig> DropPort(const CameraConfig& config);

// All of the lens, with priors wide enough for what it has to absorb.
RefineLens RefineUwPinhole();

}  // namespace rsfm
