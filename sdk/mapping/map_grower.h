// What a newly placed keyframe adds to the map, and what the map loses: observations, landmarks
// from new pairs of rays, duplicates merged, what does not fit or is oldest dropped.
#pragma once

#include <span>

#include "rsfm/mapping/frame_placer.h"

namespace rsfm {

struct GrowReport {
  int num_observed = 0;
  int num_merged = 0;
  int num_triangulated = 0;
};

class MapGrower {
 public:
  // The only place that allocates.
  MapGrower(const MapperOptions& options, const AnyCamera& camera);

  // The same camera in other water; allocates nothing.
  void SetCamera(const AnyCamera& camera) noexcept { camera_ = camera; }

  // `keyframe` is placed; `landmark_of` its features' landmarks (inliers), `matches` its matches
  // with other keyframes, of which those not placed are passed over. Makes room first when the
  // landmarks are near their capacity.
  GrowReport Grow(Map* map, SlotId keyframe, std::span<const SlotId> landmark_of,
                  std::span<const KeyframeMatches> matches) noexcept;

  // Drops observations that miss their landmark by more than max_error_px in the given keyframes,
  // and landmarks that are left with one observation outside the newest keyframe.
  int Cull(Map* map, std::span<const SlotId> keyframes) noexcept;

  std::size_t bytes() const { return views_.bytes(); }

 private:
  static constexpr int kMaxViews = 8;
  using Views = StaticVector<Observation, kMaxViews>;

  bool Fits(const Map& map, SlotId landmark, SlotId keyframe, int feature) const noexcept;
  bool IsDuplicate(const Map& map, SlotId a, SlotId b) const noexcept;
  // A feature and its match in another keyframe: one of them, both or none may have a landmark.
  void Link(Map* map, SlotId keyframe, int feature, const Observation& other,
            GrowReport* report) noexcept;
  bool Triangulate(Map* map, SlotId keyframe, int feature) noexcept;
  void MakeRoom(Map* map) noexcept;

  MapperOptions options_;
  AnyCamera camera_;
  FixedVector<Views> views_;  // per feature: matches that have no landmark either
};

}  // namespace rsfm
