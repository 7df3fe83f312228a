#include "rsfm/io/output_messages.h"

#include <limits>

namespace rsfm {

std::string FrameId(const World& world) {
  return world.frame == WorldFrame::kNed ? "ned" : "first_camera";
}

pose_t MakePose(const PoseOutput& output, const World& world) {
  pose_t m = {};
  m.utime = output.utime;
  m.frame_id = FrameId(world);
  m.child_frame_id = "body";
  const Quat& q = output.world_from_body.rotation;
  const double wxyz[4] = {q.w(), q.x(), q.y(), q.z()};
  for (int i = 0; i < 4; ++i) m.frame_from_body_q[i] = wxyz[i];
  for (int i = 0; i < 3; ++i) {
    m.position_m[i] = output.world_from_body.translation[i];
    m.velocity_body_mps[i] = output.velocity_body_mps ? (*output.velocity_body_mps)[i]
                                                      : std::numeric_limits<double>::quiet_NaN();
  }
  for (int i = 0; i < 36; ++i) {
    m.covariance[i] = output.covariance ? (*output.covariance)(i / 6, i % 6) : 0.0;
  }
  if (!output.covariance) m.covariance[0] = -1.0;
  m.state = output.state;
  m.quality = output.quality;
  m.reset_counter = output.reset_counter;
  m.num_inliers = output.num_inliers;
  m.scale_is_metric = world.scale_is_metric ? 1 : 0;
  return m;
}

void SetWorld(const World& world, status_t* status) {
  status->frame_id = FrameId(world);
  status->scale_is_metric = world.scale_is_metric ? 1 : 0;
  status->origin_is_known = world.origin ? 1 : 0;
  const Geodetic origin = world.origin.value_or(Geodetic());
  status->origin_latitude_deg = origin.latitude_deg;
  status->origin_longitude_deg = origin.longitude_deg;
  status->origin_height_m = origin.height_m;
}

}  // namespace rsfm
