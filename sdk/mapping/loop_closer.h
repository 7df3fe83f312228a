// Revisits: where a keyframe comes near a place that it has been at before (place_archive.h), it is
// looked for there. A match that generalised P3P confirms closes a loop of the pose graph. A frame
// that the map does not place is looked for among the places, too.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "rsfm/mapping/map.h"
#include "rsfm/mapping/nav_reckoning.h"
#include "rsfm/mapping/place_archive.h"
#include "rsfm/mapping/pose_graph.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

class LoopCloser {
 public:
  // The only place that allocates.
  LoopCloser(const MapperOptions& options, const AnyCamera& camera);

  // The same camera in other water; allocates nothing.
  void SetCamera(const AnyCamera& camera) noexcept { places_.SetCamera(camera); }

  // A new world begins.
  void Clear() noexcept;

  // What sensors say of the world at each keyframe by itself, so that it does not drift along the
  // way and no loop may change it.
  struct Held {
    bool level = false;  // the world's third axis is down: a compass or an inclinometer
    bool depth = false;  // and a depth sensor says how far
  };
  // The next keyframe of the way, with its last pose. Looks for an earlier place in it. True where
  // a loop was closed: the poses of all keyframes have moved, see Correction(). Without places
  // (max_places is 0) never.
  bool Add(const Map& map, SlotId keyframe, const Held& held) noexcept;

  // The place that the frame shows, which is not in the map: among those that may be seen from
  // where it is expected, by what is not known of the way since and of the motion since the last
  // placed frame (`expected`'s covariance); null: among all. By `min_inliers` at least. Takes as
  // long as kPlacesPerLook first looks and kCandidates searches by RANSAC.
  struct Recognised {
    PlaceArchive::Place place;
    Rigid3 place_from_world;
    PlaceArchive::Sighting sighting;
    Vec6 way_variance = Vec6::Zero();  // from there to the end of the way: turns, shifts
  };
  std::optional<Recognised> Recognise(const Map& map, const FrameView& frame,
                                      const KnownPose* expected, int min_inliers,
                                      std::uint64_t seed) noexcept;
  // The place as a keyframe of the map again, the one before the newest.
  std::optional<SlotId> Restore(const Recognised& recognised, int world, Map* map) const noexcept {
    return places_.Restore(recognised.place, recognised.place_from_world, world, map);
  }
  // A keyframe was put where a place says it is, and not where navigation expected it (nullptr:
  // nothing did): a loop, closed when the keyframe comes to be the newest of the way. The way
  // before it takes its part of the difference then.
  void Anchor(const Map& map, SlotId keyframe, const Recognised& recognised,
              const KnownPose* expected) noexcept;

  // By the last loop: new_world_from_world of that keyframe, of the newest one where it is unknown.
  Rigid3 Correction(std::int32_t keyframe_id) const noexcept;

  // What loops have moved by more than kToldShift_m or kToldTurn_rad since it was told last (or
  // since its keyframe left the window), newest first and at most `budget` of them:
  // f(keyframe_id, camera_from_world).
  template <class F>
  void TellMoved(int budget, F&& f) noexcept {
    if (!has_moved_) return;
    for (std::size_t i = known_.size(); i-- > 0;) {
      const Rigid3& pose = graph_.world_from_camera(static_cast<int>(i));
      if (!IsFarFrom(pose, known_[i].told)) continue;
      if (budget-- <= 0) return;
      known_[i].told = pose;
      f(known_[i].keyframe_id, pose.Inverse());
    }
    has_moved_ = false;
  }

  int num_closed() const { return num_closed_; }
  int num_places() const { return static_cast<int>(places_.places().size()); }
  int num_refused() const { return num_refused_; }  // matches that contradict the way
  const PoseGraph& graph() const { return graph_; }
  std::size_t bytes() const;

 private:
  static constexpr std::size_t kCandidates = 3;
  static constexpr std::size_t kPlacesPerLook = 400;
  struct Known {  // of a node
    std::int32_t keyframe_id = -1;
    Rigid3 world_from_camera;  // before the last loop
    Rigid3 told;               // world_from_camera that the others know
  };
  static constexpr double kToldShift_m = 0.005, kToldTurn_rad = 1e-3;
  static bool IsFarFrom(const Rigid3& pose, const Rigid3& told) noexcept;

  Vec6 WayVariance(int node) const noexcept;
  void SumWays() noexcept;
  Vec6 LinkVariance(const Keyframe& keyframe, const Rigid3& world_from_camera) noexcept;
  struct Anchored {
    std::int32_t keyframe_id = -1;  // none
    PoseGraph::Loop loop;
    Rigid3 unmoved_from_world;     // undoes what the place moved
    Vec6 variance = Vec6::Zero();  // of the link to the node before
  };

  void AddNode(const Keyframe& keyframe) noexcept;
  template <class Predicate>
  void ForgetAnchored(Predicate is_over) noexcept {
    while (!anchored_.empty() && is_over(anchored_[0])) {
      std::move(anchored_.begin() + 1, anchored_.end(), anchored_.begin());
      anchored_.pop_back();
    }
  }
  void MakeRoom() noexcept;
  void Keep(const Map& map, SlotId keyframe) noexcept;
  void FindNear(double reach_m) noexcept;
  bool Match(const Map& map, SlotId keyframe, const PlaceArchive::Place& place,
             PoseGraph::Loop* loop) noexcept;
  bool Close(PoseGraph::Loop loop) noexcept;
  std::span<const PlaceArchive::Place> LookAt(const Map& map, const FrameView& frame,
                                              const KnownPose* expected) noexcept;

  MapperOptions options_;
  PoseGraph graph_;
  PlaceArchive places_;
  FixedVector<Known> known_;             // of each node
  FixedVector<double> shift_variances_;  // of the way since each place, m2; of the last look
  StaticVector<PlaceArchive::Place, kCandidates> near_;
  std::size_t next_look_ = 0;            // at that place the next search begins
  StaticVector<Anchored, 4> anchored_;   // that have not come to be nodes yet
  double spacing_m_ = 0.0;               // between places
  Mat6 last_covariance_ = Mat6::Zero();  // of the newest node, along the world's axes
  Held held_;                            // of the newest node
  bool has_moved_ = false;               // and not all of it is told
  int num_closed_ = 0, num_refused_ = 0;
};

}  // namespace rsfm
