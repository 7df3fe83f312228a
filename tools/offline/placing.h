// Placing images: the first two of a reconstruction, and each further one by its absolute pose.
#pragma once

#include <functional>
#include <vector>

#include "tools/offline/matching.h"
#include "tools/offline/scene.h"
#include "tools/offline/tracks.h"

namespace rsfm {

struct PlacingOptions {
  double max_error_px = 6.0;  // of an observation in the absolute pose: the map may have drifted
  int min_inliers = 20;
  int min_pair_matches = 40;  // of a pair that places an image by its relative pose
  int min_scale_points = 6;
  int min_start_matches = 80;          // of the first pair
  double min_start_angle_rad = 0.035;  // its median angle between the rays of a match
  double start_baseline_m = 1.0;       // its length: the scale, which images do not give
  TrackOptions tracks;
  FilterOptions filter;
  int window = 8;  // images that a window adjustment moves after each new one
  std::uint64_t seed = 1;
};

// Global adjustment of the little that a start is, then the filter. False when the solver fails;
// the scene is then as it was.
bool AdjustAndFilter(const PlacingOptions& options, Scene* scene);

// Places the best first pair: world is the first image's camera. False when none is good enough.
// Precondition: no image is placed, no point is there.
bool PlaceFirstPair(const CorrespondenceGraph& graph, const std::vector<VerifiedPair>& pairs,
                    const PlacingOptions& options, Scene* scene);

// The unplaced image that matches the most features with points, or -1 when none has min_inliers of
// them. `tried` (as many as images) marks those to leave out.
int NextToPlace(const CorrespondenceGraph& graph, const PlacingOptions& options,
                const std::vector<std::uint8_t>& tried, const Scene& scene);

// By absolute pose of its matches with points; then its tracks. False when it cannot be placed; the
// scene is then as it was.
bool PlaceImage(int image, const CorrespondenceGraph& graph, const PlacingOptions& options,
                Scene* scene);

// Where too few of an image's matches are points yet: by the relative pose of a verified pair with
// one placed image, whose baseline's length comes from the few points that there are. At least
// `min_scale_points` of them must agree. False when there is no such pair; the scene is then as it
// was, else `placed` is the image.
bool PlaceByPair(const std::vector<VerifiedPair>& pairs, const CorrespondenceGraph& graph,
                 const PlacingOptions& options, std::vector<std::uint8_t>* tried, Scene* scene,
                 int* placed);

// Window bundle adjustment of an image and those that share the most points with it; the others
// that see these points are held.
void AdjustAround(int image, const PlacingOptions& options, Scene* scene);

}  // namespace rsfm
