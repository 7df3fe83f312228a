// Whether the images of a map stand where their verified pairs say.
#pragma once

#include <vector>

#include "tools/offline/matching.h"
#include "tools/offline/scene.h"

namespace rsfm {

// The placed images that stand in contradiction to the largest consistent group. A pair agrees
// where most of its matches whose features both have points have the same point, and contradicts
// where few do: a pattern that repeats has put one of the two elsewhere. The pairs are followed
// from the strongest to the weakest: agreement joins two groups unless a stronger contradiction
// stands between them. Ascending; empty for a map without contradiction.
std::vector<int> ContradictedImages(const std::vector<VerifiedPair>& pairs, const Scene& scene);

}  // namespace rsfm
