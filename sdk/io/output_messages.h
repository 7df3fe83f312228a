// What the mapper says, as messages for the bus and the log.
#pragma once

#include <optional>
#include <string>

#include "rsfm/base/linear.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/base/time.h"
#include "rsfm/io/messages.h"
#include "rsfm/io/rig.h"

namespace rsfm {

struct PoseOutput {
  Utime utime = 0;
  Rigid3 world_from_body;
  std::optional<Vec3> velocity_body_mps;
  std::optional<Mat6> covariance;  // of (position, small rotation), both along the world's axes
  std::int32_t state = pose_t::STATE_WAITING;
  std::int32_t quality = -1;
  std::int32_t reset_counter = 0;
  std::int32_t num_inliers = 0;
};

// "ned" or "first_camera", the frame_id of messages. A world whose frame is not decided is the
// first camera's until it is.
std::string FrameId(const World& world);

pose_t MakePose(const PoseOutput& output, const World& world);

// Fills frame, origin and scale of a status from the world.
void SetWorld(const World& world, status_t* status);

}  // namespace rsfm
