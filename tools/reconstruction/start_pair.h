// The two images that a reconstruction begins with.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "tools/offline/image_navigation.h"
#include "tools/offline/placing.h"

namespace rsfm {

struct StartOptions {
  PlacingOptions placing;
  int max_trials = 24;
  double range_m = 2.0;  // of the scene, roughly: the scale where nothing tells it
  // Between two images, where navigation knows it.
  std::function<std::optional<KnownBaseline>(int a, int b)> baseline;
};

struct StartPair {
  ImagePair images;
  double baseline_m = 0.0;
  bool baseline_from_navigation = false;
  bool baseline_from_refraction = false;  // the bent rays told the length
};

// Places the best pair of open images (`closed` marks the others) and makes its points: many
// matches under a wide angle, relative pose by TwoViewEstimator, adjusted; the world is the first
// image's camera. Pairs in `tried` (as many as `pairs`) are left out; those tried are marked.
// Nothing when no pair is good enough; the scene is then as it was.
std::optional<StartPair> PlaceStartPair(const CorrespondenceGraph& graph,
                                        const std::vector<VerifiedPair>& pairs,
                                        const std::vector<std::uint8_t>& closed,
                                        const StartOptions& options,
                                        std::vector<std::uint8_t>* tried, Scene* scene);

}  // namespace rsfm
