// What the mapper finds, as messages: on the bus and in the mission's log.
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "rsfm/io/mission.h"
#include "rsfm_drivers/lcm/bus.h"
#include "tools/feed/mapper_feed.h"

namespace rsfm {

enum class Audience : std::uint8_t { kLog, kBusAndLog };

// Where encoded messages go. `utime` is that of the measurement.
class MessageSink {
 public:
  virtual ~MessageSink() = default;
  virtual IoStatus Take(Audience audience, const std::string& channel, Utime utime,
                        std::span<const std::uint8_t> data) = 0;
};

// At once, to a bus (a failure is counted by it) and a mission's log, either of which may be null.
class DirectSink final : public MessageSink {
 public:
  DirectSink(LcmBus* bus, MissionWriter* writer) : bus_(bus), writer_(writer) {}
  IoStatus Take(Audience audience, const std::string& channel, Utime utime,
                std::span<const std::uint8_t> data) override;

 private:
  LcmBus* bus_;
  MissionWriter* writer_;
};

// The status's counters of refused navigation, in the order of NavReject.
std::array<std::int64_t*, kNumNavRejects> NavReasons(status_t* status);

// Navigation of a table is logged as nav_t: an input of that type, where the rig has none.
void AddNavInput(BusOptions* bus);

struct PublisherOptions {
  // A status each second of the images' time. The daemon makes its own, by the clock.
  bool publish_status = true;
};

// Returns what the sink does, after its first failure without going on. Does not allocate after
// construction, as long as image names are not longer than kMaxImageName.
class MissionPublisher {
 public:
  static constexpr std::size_t kMaxImageName = 63;
  // Keyframes that a loop has moved, 60 bytes each; never less than the map has.
  static constexpr int kMovedPerImage = 200;

  MissionPublisher(const Rig& rig, MessageSink* sink, const PublisherOptions& options = {});

  // Where the rig has not said it, and a fix has.
  void SetOrigin(const Geodetic& origin) { rig_.world.origin = origin; }
  IoStatus PublishNav(const NavSample& sample);
  // The frame's pose; what has become of the map; the water's index at the start and when it has
  // changed; the status once a second.
  IoStatus PublishStep(const std::string& image, Utime utime, const StepReport& report,
                       const FeedCounters& counters, IncrementalMapper* mapper);
  // Of the map alone: a keyframe where the frame became one, again without descriptors where one
  // left the window or was placed late; where those are that a loop has moved, kMovedPerImage of
  // them; landmarks that are new or have moved.
  IoStatus PublishMap(const std::string& image, Utime utime, const StepReport& report,
                      IncrementalMapper* mapper);
  // The last word on every keyframe that a loop has moved or that is still in the window, every
  // landmark that has moved, a status.
  IoStatus PublishEnd(Utime utime, const StepReport& report, const FeedCounters& counters,
                      IncrementalMapper* mapper);
  // What feed and mapper know of a status; the rest is 0, and disk_free_bytes -1.
  void FillStatus(Utime utime, const StepReport& report, const FeedCounters& counters,
                  const IncrementalMapper& mapper, status_t* status) const;

 private:
  template <class Message>
  IoStatus Publish(const std::string& channel, Utime utime, const Message& message,
                   Audience audience = Audience::kBusAndLog);
  IoStatus PublishWater(Utime utime, const WaterInUse& water);
  IoStatus PublishPose(Utime utime, const StepReport& report);
  IoStatus PublishKeyframe(const Map& map, SlotId id, bool with_descriptors, MapperState state,
                           Utime utime);
  // `has_moved`: at least one was published.
  IoStatus PublishMoved(Utime utime, IncrementalMapper* mapper, bool* has_moved);
  IoStatus PublishLandmarks(Utime utime, Map* map);
  IoStatus PublishStatus(Utime utime, const StepReport& report, const FeedCounters& counters,
                         const IncrementalMapper& mapper);

  Rig rig_;
  MessageSink* sink_;
  PublisherOptions options_;
  // Reused from message to message.
  std::vector<std::uint8_t> encoded_;
  pose_t pose_{};
  keyframe_t keyframe_{};
  int moved_per_image_;
  keyframe_poses_t moved_{};
  landmarks_t landmarks_{};
  std::vector<std::string> image_of_keyframe_;  // by the map's slot
  std::int32_t last_left_window_ = -1;
  double last_index_water_ = 0.0;  // 0: none has been published
  Utime last_status_utime_ = 0;
  bool has_status_ = false;
};

}  // namespace rsfm
