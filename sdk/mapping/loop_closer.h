// Revisits: what keyframes showed is kept long after they have left the map, a few features each,
// and where a keyframe comes near such a place it is looked for there. A match that generalised P3P
// confirms closes a loop of the pose graph.
//
// A place's points are in its own camera's frame: corrections of the way move it as a whole.
#pragma once

#include <cstdint>
#include <span>

#include "rsfm/estimation/absolute_pose.h"
#include "rsfm/mapping/descriptor_matcher.h"
#include "rsfm/mapping/map.h"
#include "rsfm/mapping/pose_graph.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

class LoopCloser {
 public:
  // The only place that allocates.
  LoopCloser(const MapperOptions& options, const AnyCamera& camera);

  // The same camera in other water; allocates nothing.
  void SetCamera(const AnyCamera& camera) noexcept { camera_ = camera; }

  // A new world begins.
  void Clear() noexcept;

  // The next keyframe of the way, with its last pose; `is_ned`: the world's third axis is down.
  // Looks for an earlier place in it. True where a loop was closed: the poses of all keyframes have
  // moved, see Correction(). Without places (max_places is 0) never.
  bool Add(const Map& map, SlotId keyframe, bool is_ned) noexcept;

  // By the last loop: new_world_from_world of that keyframe, of the newest one where it is unknown.
  Rigid3 Correction(std::int32_t keyframe_id) const noexcept;

  int num_closed() const { return num_closed_; }
  int num_places() const { return static_cast<int>(places_.size()); }
  int num_refused() const { return num_refused_; }  // matches that contradict the way
  const PoseGraph& graph() const { return graph_; }
  std::size_t bytes() const;

 private:
  static constexpr int kFeatures = 160;  // of a place
  struct Place {
    int node = 0;
    std::size_t slot = 0;  // of the pools
    int num_features = 0;
  };
  struct Known {  // of a node
    std::int32_t keyframe_id = -1;
    Rigid3 world_from_camera;  // before the last loop
  };

  Vec6 LinkVariance(const Keyframe& keyframe, const Rigid3& world_from_camera) noexcept;
  void MakeRoom() noexcept;
  void ThinOut() noexcept;
  void Keep(const Map& map, SlotId keyframe) noexcept;
  void FindNear(double reach_m) noexcept;
  bool Match(const Map& map, SlotId keyframe, const Place& place, PoseGraph::Loop* loop) noexcept;
  std::span<Vec3> points(const Place& place) {
    return points_.span().subspan(place.slot * kFeatures, kFeatures);
  }

  MapperOptions options_;
  AnyCamera camera_;
  PoseGraph graph_;
  DescriptorMatcher matcher_;
  AbsolutePoseEstimator estimator_;
  FixedVector<Known> known_;   // of each node
  FixedVector<Place> places_;  // in the order of their nodes
  FixedVector<std::size_t> free_slots_;
  FixedVector<Vec3> points_;               // in the place's camera
  FixedVector<std::uint8_t> descriptors_;  // of the slots, DescriptorStride apart
  FixedVector<DescriptorMatch> matches_;
  FixedVector<Vec2> pixels_;
  FixedVector<Vec3> matched_points_;
  StaticVector<Place, 3> near_;
  double spacing_m_ = 0.0;               // between places
  Mat6 last_covariance_ = Mat6::Zero();  // of the newest node, along the world's axes
  bool is_ned_ = false;
  int num_closed_ = 0, num_refused_ = 0;
};

}  // namespace rsfm
