// Points from verified matches: completing tracks, merging them, making new ones.
//
// [Schoenberger & Frahm 2016, CVPR, "Structure-from-Motion Revisited", sec. 4.3-4.4: completion,
// merging and re-triangulation of tracks between bundle adjustments]
#pragma once

#include <span>
#include <vector>

#include "tools/offline/matching.h"
#include "tools/offline/scene.h"

namespace rsfm {

// Which features of other images a feature was matched with.
class CorrespondenceGraph {
 public:
  CorrespondenceGraph(const Scene& scene, const std::vector<VerifiedPair>& pairs);

  std::span<const TrackElement> Neighbours(TrackElement element) const {
    const std::size_t node = Node(element);
    return {neighbours_.data() + first_[node], first_[node + 1] - first_[node]};
  }

 private:
  std::size_t Node(TrackElement e) const { return offset_[e.image] + e.feature; }

  std::vector<std::size_t> offset_;  // of each image's features
  std::vector<std::size_t> first_;   // of each feature in neighbours_, and the end
  std::vector<TrackElement> neighbours_;
};

struct TrackOptions {
  double max_error_px = 4.0;
  double min_angle_rad = 0.025;
  double max_range_m = 1000.0;
};
struct TrackReport {
  int completed = 0;  // observations added to existing points
  int merged = 0;     // points that became part of another
  int created = 0;    // new points
  int created_observations = 0;
};

// With the poses as they are; unplaced images are left alone.
TrackReport UpdateTracks(const CorrespondenceGraph& graph, const TrackOptions& options,
                         Scene* scene);
// Only what touches one image.
TrackReport UpdateTracksOf(int image, const CorrespondenceGraph& graph, const TrackOptions& options,
                           Scene* scene);

}  // namespace rsfm
