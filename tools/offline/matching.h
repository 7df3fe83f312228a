// Correspondences between images of a scene: which pairs to try, descriptor matching, verification
// by two-view geometry.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "rsfm/estimation/ransac.h"
#include "rsfm/mapping/descriptor_matcher.h"
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

// How many of the points that `a` observes would be seen by `b` (or little beside its image), as a
// part. Precondition: both are placed.
double Overlap(const Scene& scene, const AnyCamera& camera, int a, int b);

// The camera as if all it sees lay at one range.
struct NominalCamera {
  AnyCamera camera;
  double range_m;   // from the camera, along the ray in water
  double focal_px;  // in water

  // kInvalidArgument or kDegenerate where no perspective camera comes near this one.
  static Expected<NominalCamera> Create(const CameraConfig& config, double range_m);
  // (x / z, y / z, 1). False for a pixel without a ray and for what does not lie ahead.
  bool Bearing(const Vec2& pixel, Vec3* bearing) const;
};

// Tells right matches from wrong ones by the essential matrix that most of them obey; one per
// thread.
class PairVerifier {
 public:
  // For at most `max_matches` matches of a pair.
  PairVerifier(const NominalCamera& camera, const MatchOptions& options, int max_matches);

  // `query` of a match is a feature of a, `train` one of b. Nothing where too few agree.
  std::optional<VerifiedPair> Verify(const ImagePair& pair, std::span<const Vec2> features_a,
                                     std::span<const Vec2> features_b,
                                     std::span<const DescriptorMatch> matches);

 private:
  NominalCamera camera_;
  const MatchOptions& options_;
  RansacWorkspace workspace_;
};

// Sorted, without repetition.
std::vector<ImagePair> SelectPairs(const Scene& scene, const MatchOptions& options);

// In the order of `pairs`; those that fail are left out. The result does not depend on the number
// of threads. Empty when the progress said stop.
std::vector<VerifiedPair> MatchPairs(const Scene& scene, const std::vector<ImagePair>& pairs,
                                     const MatchOptions& options);

}  // namespace rsfm
