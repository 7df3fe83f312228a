// The camera, front end and mapper of a rig, and what they have taken so far. One of these is
// behind both feeds: the vehicle's camera and the desk's files.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "rsfm/io/rig.h"
#include "rsfm/mapping/frame_gate.h"
#include "rsfm/mapping/front_end.h"
#include "rsfm/mapping/incremental_mapper.h"
#include "rsfm/mapping/track_predictor.h"
#include "tools/feed/adjustment_thread.h"

namespace rsfm {

struct FeedCounters {
  std::int64_t frames_received = 0;
  std::int64_t frames_placed = 0;
  std::int64_t frames_dropped = 0;   // by their time or form: not used at all
  std::int64_t frames_unusable = 0;  // showed nothing of the scene: placed by navigation alone
  std::int64_t nav_received = 0;
  FrameVerdict last_frame = FrameVerdict::kGood;
  std::array<std::int64_t, kNumFrameVerdicts> verdicts{};  // of frames_received

  std::int64_t count(FrameVerdict verdict) const { return verdicts[static_cast<int>(verdict)]; }
};

class MapperFeed {
 public:
  // `file` names the rig in messages. The only place that allocates, OpenCV's buffers in the front
  // end excepted.
  static IoExpected<MapperFeed> Create(const Rig& rig, const std::string& file);

  void AddNav(const NavSample& sample) noexcept;
  // Images that lie ready, not live: up to the last of them none is from the future.
  void ExpectImagesUntil(Utime utime) noexcept { gate_.SeeTime(utime); }
  // One image through gate, front end and mapper. Errors are kOutOfOrder "utime" and
  // kInvalidArgument "size" or "image" of the gate, or those of front end and mapper; all three are
  // then as they were. An image that shows nothing (black, torn, …) goes to the mapper without
  // features, past the front end, whose tracks go on with the next.
  Expected<StepReport> Process(const ImageView& image, Utime utime);
  // After Process, when its pose is out, and while the image is there: where the image is a
  // keyframe of a video, what makes it one. None where it is not, or Process has done it.
  std::optional<StepReport> AddKeyframe();
  // After the last image: what that has left to be adjusted. last() then says what it did.
  void Finish();
  // From here on the window is adjusted by another thread, named and set up by `set_up`; what comes
  // out is the same. Else each image does what the one before has left.
  void AdjustOnThread(std::function<void()> set_up);

  IncrementalMapper& mapper() { return *mapper_; }
  const IncrementalMapper& mapper() const { return *mapper_; }
  const AnyCamera& camera() const { return camera_; }
  const FeedCounters& counters() const { return counters_; }
  const FrameGate& gate() const { return gate_; }
  const FrontEnd& front_end() const { return *front_end_; }
  const StepReport& last() const { return last_; }  // of the last image that was taken
  double front_end_s() const { return front_end_s_; }
  double mapper_s() const { return mapper_s_; }
  MemoryPlan memory_plan() const;

 private:
  MapperFeed(const Rig& rig, const AnyCamera& camera, std::unique_ptr<FrontEnd> front_end,
             std::unique_ptr<IncrementalMapper> mapper)
      : camera_(camera),
        gate_(camera.width(), camera.height()),
        front_end_(std::move(front_end)),
        mapper_(std::move(mapper)),
        predictor_(rig.mapper.rhythm == Rhythm::kVideo ? rig.mapper.max_features : 0) {}
  Expected<FrameObservations> Observe(const ImageView& image, Utime utime);
  void Remember(const FrameObservations& frame, const StepReport& report) noexcept;
  void BeginAdjustment() noexcept;
  void AwaitAdjustment() noexcept;
  std::span<const Vec2> ExpectPoints(Utime utime) noexcept;

  AnyCamera camera_;
  FrameGate gate_;
  std::unique_ptr<FrontEnd> front_end_;
  std::unique_ptr<IncrementalMapper> mapper_;
  TrackPredictor predictor_;
  FeedCounters counters_;
  StepReport last_;
  Utime last_utime_ = 0;
  bool may_add_keyframe_ = false;
  bool has_seen_ = false;   // the predictor has the features of an image that was placed
  Rigid3 seen_from_world_;  // that image's camera
  double front_end_s_ = 0.0, mapper_s_ = 0.0;
  std::unique_ptr<AdjustmentThread> adjustment_;  // the last: it ends before the mapper does
};

// What the gate refused or found empty, by reason: "2 black, 1 torn"; empty where all were good.
std::string DescribeLeftOut(const FrameGate& gate);

// An Error of the SDK as a message about `file`.
Diagnostic FromError(const Error& error, const std::string& file, const char* section);

}  // namespace rsfm
