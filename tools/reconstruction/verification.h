// Geometric verification of putative pairs by refracted two-view geometry.
#pragma once

#include <functional>
#include <vector>

#include "tools/offline/matching.h"
#include "tools/reconstruction/match_store.h"

namespace rsfm {

// The range [m] at which the essential matrix of refracted rays explains the strongest pairs best:
// the scene's distance, roughly, in the scale that the port gives. `fallback_m` where the camera
// has no port, as ranges then make no difference, or where there is no pair.
double ChooseRange(const Scene& scene, const std::vector<PutativePair>& pairs,
                   const MatchOptions& options, double fallback_m);

// In the order of `pairs`; those that fail are left out. Empty when the progress said stop.
std::vector<VerifiedPair> VerifyPairs(const Scene& scene, const std::vector<PutativePair>& pairs,
                                      double range_m, const MatchOptions& options);

}  // namespace rsfm
