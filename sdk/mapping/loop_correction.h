// What a closed loop does to the map.
#pragma once

#include "rsfm/mapping/loop_closer.h"
#include "rsfm/mapping/map.h"
#include "rsfm/mapping/window_adjuster.h"

namespace rsfm {

// Keyframes and landmarks move as the way does, by loops.Correction(); the window as one with
// `left`, the keyframe that has just left it: in a NED world about the vertical alone. Returns what
// the window moved by, new_world_from_world.
Rigid3 CorrectMap(const LoopCloser& loops, SlotId left, bool is_ned, Map* map,
                  WindowAdjuster* adjuster) noexcept;

}  // namespace rsfm
