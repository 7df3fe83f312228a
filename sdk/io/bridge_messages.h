// What sensors and autopilots without LCM say, as rsfm's messages, and back: for the bridge on the
// vehicle that has read it from a socket, a serial line or another middleware. The daemon hears
// only what a bridge publishes.
//
// Of frames nothing is guessed: how an instrument sits in the body is an argument. Invalid values,
// whatever marks them, clear the VALID_ bit; velocities are those of the instrument's own place,
// whose lever arm rig.yaml states.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "rsfm/base/linear.h"
#include "rsfm/base/time.h"
#include "rsfm/io/messages.h"

namespace rsfm {

// A ping of Teledyne RDI's output formats PD4 and PD5, in metres and seconds; also what ACFR's
// senlcm.rdi_pd5_t holds.
struct RdiPing {
  Utime utime = 0;
  std::uint8_t system_config = 0;  // bits 7 and 6: the frame; bit 5: tilts are taken out
  // Of the vehicle over ground: x, y, z, error. -32.768: bad.
  std::array<double, 4> bottom_velocity_mps{};
  double altitude_m = 0.0;  // 0: no bottom
  double temperature_c = 0.0;
  double salinity_psu = 0.0;
};
// The frame is what the ping's own bits say:
//   instrument  body_from_instrument turns it (x from beam 1 to 2, y from beam 4 to 3, z from the
//               water into the instrument)
//   ship        starboard, forward, up; with tilts taken out these are level, and the attitude at
//               the ping's time turns them back
//   earth       east, north, up: needs the attitude, too
//   beam        not turned into a velocity
// False: neither velocity nor altitude is valid; the message says so, too.
bool DvlFromRdi(const RdiPing& ping, const Quat& body_from_instrument,
                const std::optional<Quat>& ned_from_body, dvl_t* message);
// Temperature and salinity, of which the index of water is made. The salinity of many instruments
// is a setting: whether it is the water's is for the bridge to know.
ctd_t CtdFromRdi(const RdiPing& ping);

// A velocity report of Water Linked's A50.
struct WaterLinkedBeam {
  int id = 0;  // 0 to 3, as on the wire; the manual's figure counts from 1
  double velocity_mps = 0.0;
  double distance_m = 0.0;
  bool is_valid = false;
};
struct WaterLinkedReport {
  Utime utime = 0;  // time_of_validity, not the time of receipt
  Vec3 velocity_mps = Vec3::Zero();
  double fom_mps = 0.0;     // its standard deviation
  double altitude_m = 0.0;  // 0 or less: none
  bool is_velocity_valid = false;
  std::array<WaterLinkedBeam, 4> beams{};
};
// Beams are in the order of their ids. False, and *message untouched, where the ids are not 0 to 3
// once each; false as above where nothing is valid.
bool DvlFromWaterLinked(const WaterLinkedReport& report, const Quat& body_from_instrument,
                        dvl_t* message);

// The DVL message of the UUV simulator and of SMaRC, by its values.
struct UuvDvl {
  Utime utime = 0;
  Vec3 velocity_mps = Vec3::Zero();
  std::array<double, 9> velocity_covariance{};  // row-major; all zero: unknown; -1: invalid
  double altitude_m = 0.0;                      // 0 or less: none
};
// False as above.
bool DvlFromUuv(const UuvDvl& dvl, const Quat& body_from_instrument, dvl_t* message);

// MAVLink's ODOMETRY (331), without the fields that are not known here (rates of rotation,
// covariance of the velocity: set them to NaN).
struct MavlinkOdometry {
  static constexpr std::uint8_t kLocalNed = 1;  // MAV_FRAME_LOCAL_NED
  static constexpr std::uint8_t kBodyFrd = 12;  // MAV_FRAME_BODY_FRD

  std::uint64_t time_usec = 0;
  std::uint8_t frame_id = kLocalNed, child_frame_id = kBodyFrd;
  std::array<float, 3> position_m{};
  std::array<float, 4> q{};                 // w x y z
  std::array<float, 3> velocity_mps{};      // NaN: not estimated
  std::array<float, 21> pose_covariance{};  // upper triangle, row by row; [0] NaN: not estimated
  std::uint8_t reset_counter = 0;           // pose_t's, modulo 256: it says that, not how often
  std::int8_t quality = 0;                  // 1 to 100; -1: lost. 0 would mean "not known" there
};
// Angles of the covariance are about the axes of frame_id, as in pose_t. False, and *odometry
// untouched, where an autopilot cannot use the pose: not in "ned", without scale, no pose yet.
bool ToMavlinkOdometry(const pose_t& pose, MavlinkOdometry* odometry);

}  // namespace rsfm
