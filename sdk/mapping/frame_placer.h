// Where a frame was taken: its features matched with keyframes of the map, by track or descriptor,
// the pose by generalised P3P in RANSAC, then more landmarks found where that pose projects them.
#pragma once

#include <span>

#include "rsfm/base/error.h"
#include "rsfm/estimation/absolute_pose.h"
#include "rsfm/mapping/descriptor_matcher.h"
#include "rsfm/mapping/feature_grid.h"
#include "rsfm/mapping/map.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

// A frame under work: features, their descriptors where it has them, and the landmark of each.
struct FrameView {
  std::span<const Feature> features;
  DescriptorView descriptors;
};

// Matches of one frame with one keyframe: query is the frame's feature, train the keyframe's.
struct KeyframeMatches {
  SlotId keyframe;
  std::span<const DescriptorMatch> matches;
};

struct Placement {
  Rigid3 camera_from_world;
  Mat6 covariance = Mat6::Zero();  // with the map taken as exact
  int num_inliers = 0;
  SlotId reference;  // the keyframe that shares most landmarks with the frame
};

class FramePlacer {
 public:
  // The only place that allocates.
  FramePlacer(const MapperOptions& options, const AnyCamera& camera);

  // The same camera in other water; allocates nothing.
  void SetCamera(const AnyCamera& camera) noexcept { camera_ = camera; }

  // Matches the frame with each of these keyframes; the result stays until the next call.
  void MatchWith(const Map& map, const FrameView& frame, std::span<const SlotId> keyframes);
  std::span<const KeyframeMatches> matches() const { return keyframe_matches_.span(); }

  // The pose from the landmarks of the matched features. Afterwards landmark_of(feature) is set for
  // the inliers. kNotEnoughInliers with how many there were.
  Expected<Placement> Place(const Map& map, const FrameView& frame, std::uint64_t seed) noexcept;
  // The same where the pose is known roughly (0.1 rad, a part of the range): landmarks are looked
  // for within radius_px of where it projects them, first of all.
  Expected<Placement> PlaceNear(const Map& map, const FrameView& frame,
                                const Rigid3& camera_from_world, double radius_px,
                                std::uint64_t seed) noexcept;

  // Landmarks for the features of a frame whose pose is known.
  void Associate(const Map& map, const FrameView& frame, const Rigid3& camera_from_world) noexcept;
  // Forgets the associations of the frame before, not the matches.
  void ClearLandmarks() { landmark_of_.clear(); }
  std::span<const SlotId> landmark_of() const { return landmark_of_.span(); }

  // The `count` placed keyframes outside the newest `skip_newest` that look most like the frame,
  // judged by each one's strongest features.
  std::span<const SlotId> MostSimilar(const Map& map, const FrameView& frame, int count,
                                      std::span<const SlotId> candidates) noexcept;
  // Mutual matches among the strongest features of both.
  int Similarity(const DescriptorView& a, const DescriptorView& b) noexcept;

  std::size_t bytes() const;

 private:
  void MatchTracks(std::span<const Feature> frame, std::span<const Feature> keyframe,
                   std::span<DescriptorMatch> matches, int* count) const;
  void StartAssociations(std::size_t num_features);
  void AssociateByMatches(const Map& map, const FrameView& frame);
  int AssociateByProjection(const Map& map, const FrameView& frame, const Rigid3& camera_from_world,
                            double radius_px) noexcept;
  Expected<Placement> Estimate(const Map& map, const FrameView& frame, const Rigid3* start,
                               std::uint64_t seed) noexcept;
  Expected<Placement> Complete(const Map& map, const FrameView& frame,
                               const Placement& first) noexcept;
  SlotId MostShared(const Map& map) noexcept;

  MapperOptions options_;
  AnyCamera camera_;
  DescriptorMatcher matcher_;
  FeatureGrid grid_;
  AbsolutePoseEstimator estimator_;
  FixedVector<DescriptorMatch> match_pool_;
  FixedVector<KeyframeMatches> keyframe_matches_;
  FixedVector<SlotId> landmark_of_;        // of each feature of the frame
  FixedVector<std::int32_t> distance_of_;  // descriptor distance of that association
  FixedVector<std::uint8_t> is_taken_;     // per landmark slot
  FixedVector<int> shared_;                // per keyframe slot
  FixedVector<Vec2> pixels_;
  FixedVector<Vec3> points_;
  FixedVector<int> feature_of_pair_;
  FixedVector<SlotId> similar_;
  FixedVector<int> similarity_;
};

}  // namespace rsfm
