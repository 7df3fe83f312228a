// The daemon's threads, one function each. All return when what feeds them has ended.
#pragma once

#include "rsfm/io/mission.h"
#include "rsfm_drivers/lcm/bus.h"
#include "tools/feed/mapper_feed.h"
#include "tools/feed/mission_publisher.h"
#include "tools/onboard/frame_source.h"
#include "tools/onboard/recorder.h"
#include "tools/onboard/shared.h"

namespace rsfm {

inline constexpr int kWaitMs = 100;  // for what feeds a thread, before it looks round

struct WorkerOptions {
  Rig rig;
  bool is_replay = false;            // log times are those of the measurements
  bool loses_nothing = false;        // a replay that waits for the mapper
  bool nav_comes_from_file = false;  // then it is logged by the mapper's thread
};

// Images from the source to the mapper and, where recorded, to the recorder. Ends with the source,
// or when `shared->stop` is set.
void RunCapture(const WorkerOptions& options, FrameSource* source, Shared* shared);
// Images and navigation through the mapper, what it finds to bus and log. Ends when the frames'
// queue is closed and empty, with the last word on every keyframe.
void RunMapper(const WorkerOptions& options, MapperFeed* feed, Shared* shared);
// From the queue to the bus. Ends when the queue is closed and empty.
void RunBus(const WorkerOptions& options, LcmBus* bus, Shared* shared);
// From the bus to the navigation queue and the log. Where the bus does not let it listen, it says
// so and tries again after 1 s, then twice as long each time, at most 30 s. Ends when
// `shared->stop` is set.
void RunReceive(const WorkerOptions& options, LcmBus* bus, Shared* shared);
// From the queue to the mission's log, and to the disk each half second; the rig file again when it
// is known what the poses refer to. Ends when the queue is closed and empty.
void RunLog(const WorkerOptions& options, MissionWriter* writer, Shared* shared);
// From the queue to the mission's images. Ends when the queue is closed and empty.
void RunRecorder(Recorder* recorder, Shared* shared);

}  // namespace rsfm
