// What the daemon takes from the heap when it starts, on top of the mapper's own plan.
#pragma once

#include <cstddef>

#include "rsfm/io/rig.h"
#include "tools/onboard/nav_arrival.h"

namespace rsfm {

// Images between camera, mapper and disk: those that wait, and one in each thread's hands.
inline int NumFrames(const OnboardOptions& onboard) {
  return onboard.frame_queue + onboard.record_queue + 3;
}

// Programs, libraries, threads' stacks and OpenCV's own buffers: resident on top of the plan.
inline constexpr int kLibrariesMiB = 64;

struct DaemonMemory {
  std::size_t frame_bytes = 0;  // all images
  std::size_t queue_bytes = 0;  // messages for bus and log, navigation for the mapper
};

inline DaemonMemory PlanDaemon(const Rig& rig) {
  const auto count = [](auto value) { return static_cast<std::size_t>(value); };
  const OnboardOptions& onboard = rig.onboard;
  return {count(NumFrames(onboard)) * count(rig.camera.width) * count(rig.camera.height),
          (count(onboard.bus_queue_mb + onboard.log_queue_mb) << 20) +
              count(onboard.nav_queue) * sizeof(NavArrival)};
}

}  // namespace rsfm
