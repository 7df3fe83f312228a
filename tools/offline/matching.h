// Correspondences between images of a scene: which pairs to try, descriptor matching, verification
// by two-view geometry.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "tools/offline/scene.h"

namespace rsfm {

struct MatchOptions {
  double max_ratio = 0.8;     // best to second-best descriptor distance
  double max_error_px = 3.0;  // of the epipolar geometry
  // Fewer verified matches, or a smaller part of the matches, are no pair: repeated patterns
  // (tiles, chains) give false pairs of that size.
  int min_inliers = 20;
  double min_inlier_ratio = 0.3;
  // Pairs farther apart in the sequence than this are first tried with their largest features only.
  // [Wu 2013, 3DV, "Towards Linear-time Incremental Structure from Motion", sec. 3.1]
  int always_neighbours = 3;
  int preview_features = 400;
  int preview_matches = 8;
  int sequence_neighbours = 10;  // images before and after, in the scene's order
  int all_pairs_up_to = 60;      // placed images: with no more, every pair is tried
  int all_unplaced_up_to = 60;   // the same for pairs with an unplaced image
  double min_overlap = 0.15;     // of one image's points, that fall into the other
  int num_threads = 2;
  std::uint64_t seed = 1;
  // Pairs done, pairs in all; false stops.
  std::function<bool(int, int)> progress;
};

struct ImagePair {
  int a = 0, b = 0;  // images, a < b
  bool operator==(const ImagePair&) const = default;
  auto operator<=>(const ImagePair&) const = default;
};

struct VerifiedPair {
  ImagePair images;
  std::vector<std::pair<std::int32_t, std::int32_t>> matches;  // features of a and b
  Rigid3 b_from_a;                // of the central approximation; the translation has unit length
  double median_angle_rad = 0.0;  // between the two rays of a match
};

// Sorted, without repetition.
std::vector<ImagePair> SelectPairs(const Scene& scene, const MatchOptions& options);

// In the order of `pairs`; those that fail are left out. The result does not depend on the number
// of threads. Empty when the progress said stop.
std::vector<VerifiedPair> MatchPairs(const Scene& scene, const std::vector<ImagePair>& pairs,
                                     const MatchOptions& options);

}  // namespace rsfm
