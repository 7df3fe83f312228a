// Matches along the curves where the known poses and the water say that they must be: what the
// search over whole images leaves out where few features look alike enough, as in quick turns.
#pragma once

#include <functional>
#include <vector>

#include "tools/offline/descriptor_rows.h"
#include "tools/offline/matching.h"

namespace rsfm {

struct GuidedMatchOptions {
  double band_px = 8.0;    // of a feature from its curve: the poses are those of an unfinished map
  double max_ratio = 0.9;  // best to second-best descriptor distance, among the candidates
  // A feature's curve is followed from the first to the last range: the image's nearest and
  // farthest points (without the outermost 2 %), less and more by this factor.
  double range_margin = 1.5;
  int min_matches = 20;      // fewer are no new pair
  double min_overlap = 0.1;  // of one image's points, that fall into the other
  // Of an image; where there is none, the scene's own. Called by several threads at once.
  std::function<DescriptorRows(int)> descriptors;
  int images_in_memory = 64;  // prepared for the search at a time
};

// Adds to `pairs` matches of the placed images among `candidates`, between features that have no
// match in that pair yet, and pairs that had none. Two features match that see each other within
// the band of the other's curve and prefer each other. The curve is the projection of a feature's
// refracted ray, in short straight pieces. Returns how many matches were added. Sorted like
// MatchPairs; the result does not depend on the number of threads.
int AddGuidedMatches(const Scene& scene, const std::vector<ImagePair>& candidates,
                     const MatchOptions& match, const GuidedMatchOptions& options,
                     std::vector<VerifiedPair>* pairs);

}  // namespace rsfm
