// Navigation messages to samples of the body's origin, and back.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "rsfm/io/messages.h"
#include "rsfm/io/rig.h"
#include "rsfm/navigation/local_frame.h"
#include "rsfm/navigation/nav_buffer.h"
#include "rsfm/navigation/nav_sample.h"

namespace rsfm {

enum class NavDecode : std::uint8_t {
  kOk,
  kMalformed,  // not a message of that type: wrong fingerprint, truncated
  kRejected,   // a message without one usable field: not valid, not finite, not possible
};

// Reads the messages of one vehicle in the order in which they come. Lever arms of the rig's
// sensors are removed with the attitude and turn rate last heard of, where those are not older than
// kMaxAttitudeAgeUs; a position without a height takes the depth last heard of. Allocates nothing
// but what a message's own arrays need.
class NavConverter {
 public:
  static constexpr Utime kMaxAttitudeAgeUs = 2'000'000;

  explicit NavConverter(const Rig& rig);

  NavDecode Convert(const BusInput& input, std::span<const std::uint8_t> data, NavSample* sample);

  // False: no usable field; *sample is then untouched.
  bool Convert(const nav_t& message, NavSample* sample);
  bool Convert(const dvl_t& message, NavSample* sample);
  bool Convert(const ahrs_t& message, NavSample* sample);
  bool Convert(const depth_t& message, NavSample* sample);
  bool Convert(const ctd_t& message, NavSample* sample);
  bool Convert(const fix_t& message, NavSample* sample);
  bool Convert(const bot_core::pose_t& message, Convention convention, NavSample* sample);
  bool Convert(const acfrlcm::auv_acfr_nav_t& message, NavSample* sample);

  // Fields that were marked as valid and are not: not finite, a sentinel (a negative covariance, a
  // range of 0), no rotation, no place on earth, frozen (depth_t and dvl_t; what has no lever arm
  // is judged by NavBuffer).
  std::uint64_t rejected(NavReject reason) const {
    return rejected_[static_cast<std::size_t>(reason)];
  }

  // The origin of NED: the rig's, or else the first fix's.
  std::optional<Geodetic> origin() const;

 private:
  bool HasAttitude(Utime utime) const;
  // For the lever arms of what comes next. A rate that is none is zero.
  void HearAttitude(const NavSample& sample, const Vec3& rate_radps);
  bool Reject(NavReject reason);  // counts; false
  bool Take(const Vec3& value, const double (&covariance)[9], Vec3* sigma);
  bool Take(double value, double sigma);
  bool Take(const double (&wxyz)[4], const double (&covariance)[9], Quat* q, Vec3* sigma);
  bool TakeTime(Utime utime);
  bool TakeFinite(bool is_finite);
  bool TakeMeasured(const Vec3& value);
  bool TakeChanging(Utime utime, const Vec3& measured, RepeatWatch* repeats);

  SensorPlaces sensors_;
  std::array<std::uint64_t, kNumNavRejects> rejected_{};
  std::optional<LocalFrame> frame_;
  Utime attitude_utime_ = 0;
  bool has_attitude_ = false;
  // As measured: with its lever arm removed a value that has stopped moves with the attitude.
  RepeatWatch depth_repeats_, velocity_repeats_, altitude_repeats_;
  Quat ned_from_body_ = Quat::Identity();
  Vec3 rotation_rate_radps_ = Vec3::Zero();
  std::optional<double> depth_m_;
  double temperature_c_ = 0.0, salinity_psu_ = 0.0;
  bool has_temperature_ = false, has_salinity_ = false;
};

// Sigmas become diagonal covariances.
nav_t ToMessage(const NavSample& sample);

}  // namespace rsfm
