// A mission's log through the mapper once more: what is published must be what was published.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "tools/map/map_images.h"

namespace rsfm {

struct ReplayDifference {
  std::int64_t event = 0;  // number in the log; that after the last where the replay goes on longer
  std::string channel;     // as recorded, or as replayed where nothing more was recorded
  Utime utime = 0;
  std::string what;
};

struct ReplayResult {
  int num_images = 0;           // mapped again
  int num_left_out = 0;         // without a pose in the log: refused then, or the mapper was busy
  std::int64_t num_poses = 0;   // compared
  std::int64_t num_events = 0;  // likewise: poses, keyframes, landmarks, water
  std::optional<ReplayDifference> difference;  // the first
  bool interrupted = false;
};

// Feeds navigation as the log has it, between the poses where it stands there, and the images, to
// the mapper of the mission's rig.yaml; compares poses, keyframes, landmarks and water with the
// recorded ones byte for byte, and ends at the first that differs. The status is not compared: on a
// vehicle it has clock times in it. Writes nothing.
IoExpected<ReplayResult> ReplayMission(const std::filesystem::path& mission,
                                       const MapHooks& hooks = {});

}  // namespace rsfm
