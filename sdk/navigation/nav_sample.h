// One moment's navigation, as the vehicle's sensors give it: any subset of the fields.
//
// Frames: NED is local north-east-down at the mission's origin (local_frame.h); body is FRD
// (forward, right, down). A sample describes the body's own origin: lever arms of its sensors have
// been removed before.
#pragma once

#include <cstdint>

#include "rsfm/base/linear.h"
#include "rsfm/base/time.h"

namespace rsfm {

// Bits of NavSample::valid.
enum class NavField : std::uint32_t {
  kPosition = 1u << 0,
  kAttitude = 1u << 1,
  kVelocity = 1u << 2,
  kDepth = 1u << 3,
  kAltitude = 1u << 4,
  kWater = 1u << 5,
};

struct NavSample {
  Utime utime = 0;
  std::uint32_t valid = 0;  // NavField bits; the other fields then mean nothing

  Vec3 position_ned_m = Vec3::Zero();
  Quat ned_from_body = Quat::Identity();
  Vec3 velocity_body_mps = Vec3::Zero();  // over ground, in body axes
  double depth_m = 0.0;                   // below the surface, positive down
  double altitude_m = 0.0;                // above the bottom, positive
  double temperature_c = 0.0;
  double salinity_psu = 0.0;

  // One standard deviation; 0 where the source does not state it.
  Vec3 sigma_position_m = Vec3::Zero();
  Vec3 sigma_attitude_rad = Vec3::Zero();  // about north, east, down
  Vec3 sigma_velocity_mps = Vec3::Zero();
  double sigma_depth_m = 0.0;
  double sigma_altitude_m = 0.0;

  bool Has(NavField field) const { return (valid & static_cast<std::uint32_t>(field)) != 0; }
  void Set(NavField field) { valid |= static_cast<std::uint32_t>(field); }
  void Clear(NavField field) { valid &= ~static_cast<std::uint32_t>(field); }
};

// RDI-style logs mark a missing velocity by the smallest 16-bit integer in mm/s.
inline bool IsVelocitySentinel(const Vec3& velocity_mps) {
  return ((velocity_mps.array() + 32.768).abs() < 1e-4).any();
}

}  // namespace rsfm
