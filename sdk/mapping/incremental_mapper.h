// The mapper: one frame at a time, in fixed memory and bounded time.
//
//   auto mapper = IncrementalMapper::Create(options, camera, body_from_camera);  // allocates
//   (*mapper)->nav().buffer().Insert(sample);  // as navigation comes
//   auto report = (*mapper)->Step(frame);      // as the front end hands out frames
//   (*mapper)->AdjustWindow();                 // once the pose is out; on any thread
//
// A frame is placed by the landmarks it shows (frame_placer.h); if it carries descriptors it
// becomes a keyframe, adds to the map (map_grower.h), and a window of keyframes is adjusted
// (window_adjuster.h): after its pose is handed out, and before the next frame is placed. Whoever
// adjusts, and when in between, the result is the same to the bit. What has left the window is a
// place that may be seen again (loop_closer.h): then the way between is corrected, and with it the
// map; a frame that is lost is looked for there. The first map comes from two views
// (initialiser.h), with scale from navigation where it spans them. A frame that shows too little is
// looked for among older keyframes; keyframes that could not be placed wait, and are tried again as
// the map grows.
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <string_view>

#include "rsfm/mapping/body_pose.h"
#include "rsfm/mapping/frame_placer.h"
#include "rsfm/mapping/initialiser.h"
#include "rsfm/mapping/jump_watch.h"
#include "rsfm/mapping/loop_closer.h"
#include "rsfm/mapping/map_grower.h"
#include "rsfm/mapping/nav_aid.h"
#include "rsfm/mapping/water_in_use.h"
#include "rsfm/mapping/window_adjuster.h"

namespace rsfm {

enum class MapperState : std::uint8_t {  // values as in pose_t
  kWaiting,                              // no image yet that shows anything
  kInitialising,                         // looking for a first pair with parallax
  kTracking,                             // placed by vision
  kDeadReckoning,  // the frame was not placed: the pose is navigation's since the last that was
  kRelocalising,   // not placed and no navigation: looking for known landmarks
  kLost,           // the same, for lost_frames_before_restart frames or more: a new map may begin
};
std::string_view ToString(MapperState state) noexcept;

struct StepReport {
  MapperState state = MapperState::kWaiting;
  bool has_pose = false;
  Rigid3 camera_from_world;
  Mat6 covariance = Mat6::Zero();  // of the left perturbation (rotation [rad], translation [m])
  int num_inliers = 0;
  SlotId keyframe;                      // the frame's, where it became one, placed or not
  SlotId left_window;                   // a keyframe that adjustment will not move again, or none
  StaticVector<SlotId, 4> placed_late;  // keyframes of earlier frames that now have a pose
  // The number of the keyframe, long gone from the map, by whose place this frame was found, or -1.
  std::int32_t recognised_keyframe = -1;
  // Goes up at every jump: of the world's frame, and of a pose that is farther from where the one
  // before and navigation put it than three sigmas (of place or of rotation).
  int reset_counter = 0;
  int world = 0;  // reset_counter when this world began; Keyframe::world alike
  bool scale_is_metric = false;
  bool world_is_ned = false;  // else the first keyframe's camera
  int num_observed = 0, num_merged = 0, num_triangulated = 0, num_culled = 0;
  double window_error_px = 0.0;  // mean, after the adjustment that the keyframe before began
};

// Bytes by component, all taken by Create.
struct MemoryPlan {
  struct Item {
    const char* name;
    std::size_t bytes;
  };
  StaticVector<Item, 12> items;
  std::size_t total() const;
};

class IncrementalMapper {
 public:
  // kInvalidArgument; `where` is the option. The only place that allocates.
  static Expected<std::unique_ptr<IncrementalMapper>> Create(const MapperOptions& options,
                                                             const AnyCamera& camera,
                                                             const Rigid3& body_from_camera);

  // Takes one frame: first what the frame before has left to be adjusted, then its own pose, which
  // is that of the map before its own adjustment. Never allocates, throws or logs; on error the map
  // is as it was.
  //   kOutOfOrder       not newer than the frame before
  //   kInvalidArgument  "descriptors": not of the options' type, or not one per feature;
  //                     "features": one is not finite
  Expected<StepReport> Step(const FrameObservations& frame) noexcept;

  // The frame of the last Step again, which came without descriptors and was placed: it becomes a
  // keyframe, and its pose that which the descriptors give. The report is like Step's, of what
  // happened since.
  //   kOutOfOrder       "utime": not the last frame, or it was not placed, or is a keyframe
  //   kInvalidArgument  "descriptors", "features" as for Step
  Expected<StepReport> AddKeyframe(const FrameObservations& frame) noexcept;

  // The longest part of what a keyframe costs, where the last call left one; the next Step, or
  // Finish, does it where nobody did. It may run on another thread while this one reads the mapper
  // and inserts navigation, and must have ended before Step, Finish or SetClockBack.
  void AdjustWindow() noexcept { adjuster_.Solve(); }
  bool needs_adjustment() const { return adjuster_.needs_solution(); }
  // After the last frame: takes its adjustment over. The report is that frame's, with its pose
  // after adjustment, and what the adjustment did.
  StepReport Finish() noexcept;

  // The clock was set back to about `utime`: the next frame may be older than the last. Frames and
  // map are forgotten, and navigation that reaches beyond it; the next world is announced by
  // reset_counter.
  void SetClockBack(Utime utime) noexcept;

  NavAid& nav() { return nav_; }
  const NavAid& nav() const { return nav_; }
  const Map& map() const { return map_; }
  Map& map() { return map_; }  // for the owner to clear Landmark::is_changed
  // What is known of the navigation sensors' errors, and how well.
  const WindowAdjuster& adjuster() const { return adjuster_; }
  // The way since the world began, and the loops in it.
  const LoopCloser& loops() const { return loops_; }
  // Keyframes that loops have moved since they were told of, see LoopCloser::TellMoved.
  template <class F>
  void TellMoved(int budget, F&& f) noexcept {
    loops_.TellMoved(budget, f);
  }
  MapperState state() const { return report_.state; }
  // After Step: the water that this frame was seen through.
  const WaterInUse& water() const { return water_; }
  // The next frame should carry descriptors whatever the front end's rhythm.
  bool wants_descriptors() const { return report_.state != MapperState::kTracking; }
  MemoryPlan memory_plan() const;

 private:
  IncrementalMapper(const MapperOptions& options, const AnyCamera& camera, NavAid nav,
                    WindowAdjuster adjuster);

  Status Check(const FrameObservations& frame) const noexcept;
  Status CheckContent(const FrameObservations& frame) const noexcept;
  void BeginReport(Utime utime) noexcept;
  StepReport HandOutReport() noexcept;
  void ForgetEvents() noexcept;
  void SetCamera(const AnyCamera& camera) noexcept;
  SlotId StoreKeyframe(const FrameObservations& frame) noexcept;
  int FramesBeforeRestart() const noexcept;
  void Continue(const FrameObservations& frame, SlotId keyframe) noexcept;
  bool Initialise(SlotId keyframe) noexcept;
  void BeginWorld() noexcept;
  void PlacePair(const InitialPair& pair) noexcept;
  void ForgetPlaced() noexcept;
  bool IsPlausible(const Placement& placement) const noexcept;
  bool LeadsHere(const Placement& placement, Utime utime) const noexcept;
  bool AgreesWithAttitude(const Placement& placement) const noexcept;
  Expected<Placement> PlaceFrame(const FrameView& frame, SlotId keyframe) noexcept;
  Expected<Placement> Relocalise(const FrameView& frame, SlotId keyframe) noexcept;
  void Accept(const Placement& placement, SlotId keyframe) noexcept;
  void KeepPlaced() noexcept;
  void Grow(SlotId keyframe) noexcept;
  void Extend(SlotId keyframe) noexcept;
  void PlaceWaiting(SlotId newest) noexcept;
  void BeginAdjustment(SlotId keyframe) noexcept;
  void TakeAdjustment() noexcept;
  void CloseLoop(SlotId left) noexcept;
  void FindWorld(SlotId keyframe) noexcept;
  void TakeNewest(SlotId keyframe) noexcept;
  void CoastOn(Utime utime) noexcept;
  void Evict(SlotId except) noexcept;
  NavErrors nav_errors() const {
    return {adjuster_.nav_states(), adjuster_.nav_state_covariance()};
  }
  std::optional<KnownPose> Predict(Utime utime) const noexcept;
  std::optional<KnownPose> PredictMotion() const noexcept;
  std::optional<KnownPose> PredictReach() const noexcept;
  void CollectKeyframes(bool placed, int count, SlotId except) noexcept;
  bool has_world() const { return has_world_; }

  static constexpr Utime kNoFrame = std::numeric_limits<Utime>::min();

  MapperOptions options_;
  AnyCamera camera_;
  WaterInUse water_;
  NavAid nav_;
  Map map_;
  FramePlacer placer_;
  Initialiser initialiser_;
  MapGrower grower_;
  WindowAdjuster adjuster_;
  LoopCloser loops_;
  FixedVector<SlotId> candidates_;

  StepReport report_;      // of the last frame; after Step without what happened during it
  SlotId to_be_adjusted_;  // the last frame's keyframe, until it is
  std::int32_t next_keyframe_id_ = 0;
  Utime last_utime_ = kNoFrame;
  bool has_world_ = false;
  bool has_position_ = false;            // a fix says where the world is
  struct Way {                           // as far as it was placed
    KnownPose placed{kNoFrame, {}, {}};  // the last placed frame, and the one before it; kNoFrame:
    KnownPose placed_before{kNoFrame, {}, {}};  // none in this world
    KnownPose base;                             // the last placed frame; navigation is added to it
    KnownPose next_base;  // of a long outage: takes base's place before navigation forgets that
  };
  Way way_, way_before_;  // that before the last frame
  Placement placement_;   // of the last frame, where it was placed
  JumpWatch jumps_;
  bool has_seen_ = false;  // an image with features
  int frames_lost_ = 0;
  std::uint64_t frame_count_ = 0;
};

}  // namespace rsfm
