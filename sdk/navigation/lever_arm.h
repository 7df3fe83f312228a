// From the body's navigation to the camera's, through the rig's body_from_camera.
#pragma once

#include "rsfm/base/rigid3.h"
#include "rsfm/navigation/nav_buffer.h"

namespace rsfm {

// Where the camera is, given where the body is, and back.
inline Rigid3 CameraFromNed(const Rigid3& ned_from_body, const Rigid3& body_from_camera) {
  return (ned_from_body * body_from_camera).Inverse();
}
inline Rigid3 NedFromBody(const Rigid3& camera_from_ned, const Rigid3& body_from_camera) {
  return camera_from_ned.Inverse() * body_from_camera.Inverse();
}

// The camera centre's displacement in NED over a motion of the body: the lever arm swings along.
inline Vec3 CameraDisplacement(const NavMotion& motion, const Rigid3& body_from_camera) {
  const Vec3& lever = body_from_camera.translation;
  return motion.displacement_ned_m + motion.ned_from_body_end * lever -
         motion.ned_from_body_start * lever;
}

// Velocity of the body's origin from that of a sensor at `lever_m` (body frame, from the origin),
// both in body axes; rate is the body's turn rate in body axes.
inline Vec3 BodyVelocity(const Vec3& sensor_velocity_mps, const Vec3& rate_radps,
                         const Vec3& lever_m) {
  return sensor_velocity_mps - rate_radps.cross(lever_m);
}

}  // namespace rsfm
