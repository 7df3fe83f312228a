// What the mapper finds, as messages: on the bus and in the mission's log.
#pragma once

#include <string>
#include <unordered_map>

#include "rsfm/io/mission.h"
#include "rsfm/mapping/incremental_mapper.h"
#include "rsfm_drivers/lcm/bus.h"

namespace rsfm {

struct FeedCounters {
  std::int64_t frames_received = 0;
  std::int64_t frames_placed = 0;
  std::int64_t frames_dropped = 0;
  std::int64_t nav_received = 0;
};

// The first failure to log is kept and returned by every later call. Log times are those of the
// measurements, so that the same input gives the same bytes.
class MissionPublisher {
 public:
  MissionPublisher(const Rig& rig, MissionWriter* writer, LcmBus* bus)
      : rig_(rig), writer_(writer), bus_(bus) {}

  IoStatus PublishNav(const NavSample& sample);
  // The frame's pose; a keyframe where it became one, again without descriptors where one left the
  // window or was placed late; the water's index at the start and when it has changed; landmarks
  // that are new or have moved; the status once a second.
  IoStatus PublishStep(const std::string& image, Utime utime, const StepReport& report,
                       const FeedCounters& counters, IncrementalMapper* mapper);
  // The last word on every keyframe still in the window, every landmark that has moved, a status.
  IoStatus PublishEnd(Utime utime, const StepReport& report, const FeedCounters& counters,
                      IncrementalMapper* mapper);

 private:
  template <class Message>
  IoStatus Publish(const std::string& channel, Utime utime, const Message& message);
  IoStatus PublishWater(Utime utime, const WaterInUse& water);
  IoStatus PublishPose(Utime utime, const StepReport& report);
  IoStatus PublishKeyframe(const Map& map, SlotId id, bool with_descriptors, MapperState state,
                           Utime utime);
  IoStatus PublishLandmarks(Utime utime, Map* map);
  IoStatus PublishStatus(Utime utime, const StepReport& report, const FeedCounters& counters,
                         const IncrementalMapper& mapper);

  Rig rig_;
  MissionWriter* writer_;
  LcmBus* bus_;
  std::unordered_map<std::int32_t, std::string> image_of_keyframe_;
  std::int32_t last_left_window_ = -1;
  double last_index_water_ = 0.0;  // 0: none has been published
  Utime last_status_utime_ = 0;
  bool has_status_ = false;
};

}  // namespace rsfm
