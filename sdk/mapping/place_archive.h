// What keyframes showed, kept long after they have left the map: a few features each, and the pose
// in which another frame sees them. A place's points are in its own camera's frame: corrections of
// the way move it as a whole.
#pragma once

#include <optional>
#include <span>

#include "rsfm/estimation/absolute_pose.h"
#include "rsfm/mapping/descriptor_matcher.h"
#include "rsfm/mapping/frame_placer.h"
#include "rsfm/mapping/map.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

class PlaceArchive {
 public:
  static constexpr int kFeatures = 160;  // of a place, at most

  struct Place {
    int node = 0;  // of the way
    std::int32_t keyframe_id = -1;
    Utime utime = 0;
    double range_m = 0.0;            // median distance of its points
    Mat6 covariance = Mat6::Zero();  // the keyframe's
    int num_features = 0;
    std::size_t slot = 0;  // of the pools
  };
  struct Sighting {
    Rigid3 frame_from_place;
    Mat6 covariance = Mat6::Zero();  // of the left perturbation, the points taken as exact
    int num_inliers = 0;
  };

  // The only place that allocates.
  PlaceArchive(const MapperOptions& options, const AnyCamera& camera);

  void SetCamera(const AnyCamera& camera) noexcept { camera_ = camera; }
  void Clear() noexcept;
  // Every other place goes.
  void ThinOut() noexcept;
  // Nodes are counted from that one on; places before it go.
  void DropNodesBefore(int node) noexcept;
  // The keyframe becomes the place of that node, which is newer than all before. False where it
  // shows too little, or there is no room.
  bool Keep(const Map& map, SlotId keyframe, int node) noexcept;

  // A frame that shows the place: generalised P3P over matched descriptors.
  std::optional<Sighting> Match(const FrameView& frame, const Place& place,
                                std::uint64_t seed) noexcept;
  // How much the frame looks like it: matches of the place's strongest features.
  int Similarity(const FrameView& frame, const Place& place) noexcept;
  // The place as a keyframe of the map again, with a landmark for each feature, as the one before
  // the newest. Nothing where there is no room.
  std::optional<SlotId> Restore(const Place& place, const Rigid3& camera_from_world, int world,
                                Map* map) const noexcept;

  std::span<const Place> places() const { return places_.span(); }  // in the order of their nodes
  bool full() const { return free_slots_.empty(); }
  std::size_t bytes() const;

 private:
  DescriptorView Descriptors(const Place& place) const;

  MapperOptions options_;
  AnyCamera camera_;
  DescriptorMatcher matcher_;
  AbsolutePoseEstimator estimator_;
  FixedVector<Place> places_;
  FixedVector<std::size_t> free_slots_;
  FixedVector<Vec3> points_;  // of the slots, kFeatures apart; in the place's camera
  FixedVector<Feature> features_;
  FixedVector<std::uint8_t> descriptors_;  // DescriptorStride apart
  FixedVector<DescriptorMatch> matches_;
  FixedVector<Vec2> pixels_;
  FixedVector<Vec3> matched_points_;
};

// The median distance of the landmarks of a keyframe, or 0.
double RangeOf(const Map& map, SlotId keyframe);

}  // namespace rsfm
