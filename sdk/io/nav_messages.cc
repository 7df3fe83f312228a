#include "rsfm/io/nav_messages.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>

#include "rsfm/base/plausible_time.h"
#include "rsfm/io/tables.h"
#include "rsfm/navigation/lever_arm.h"

namespace rsfm {
namespace {

// A vertical sigma that says "nothing is known".
constexpr double kUnknownSigma = 1e4;
// What a rotation or a lever arm could carry beyond the largest double is no measurement.
constexpr double kLargest = 1e100;

Vec3 ToVec3(const double (&values)[3]) { return {values[0], values[1], values[2]}; }

// False for NaN.
bool IsMeasurable(const Vec3& value) { return (value.array().abs() < kLargest).all(); }

bool IsFinite(const double (&values)[9]) {
  return std::all_of(std::begin(values), std::end(values),
                     [](double v) { return std::isfinite(v); });
}

// Roots of a row-major 3x3 covariance's diagonal; false when it is none.
bool Sigmas(const double (&covariance)[9], Vec3* sigma) {
  const Vec3 diagonal(covariance[0], covariance[4], covariance[8]);
  if ((diagonal.array() < 0.0).any()) return false;
  *sigma = diagonal.cwiseSqrt();
  return true;
}

void SetCovariance(const Vec3& sigma, double (&covariance)[9]) {
  for (int i = 0; i < 9; ++i) covariance[i] = i % 4 == 0 ? sigma[i / 4] * sigma[i / 4] : 0.0;
}

bool ToQuat(const double (&wxyz)[4], Quat* q) {
  const Quat value(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
  if (!(std::abs(value.norm() - 1.0) < 1e-3)) return false;  // false for NaN
  *q = value.normalized();
  return true;
}

template <class Message>
NavDecode DecodeAndConvert(NavConverter* converter, std::span<const std::uint8_t> data,
                           NavSample* sample) {
  Message message;
  if (!Decode(data, &message)) return NavDecode::kMalformed;
  return converter->Convert(message, sample) ? NavDecode::kOk : NavDecode::kRejected;
}

}  // namespace

NavConverter::NavConverter(const Rig& rig) : sensors_(rig.sensors) {
  if (!rig.world.origin) return;
  if (auto frame = LocalFrame::Create(*rig.world.origin)) frame_ = *frame;
}

std::optional<Geodetic> NavConverter::origin() const {
  return frame_ ? std::optional(frame_->origin()) : std::nullopt;
}

bool NavConverter::HasAttitude(Utime utime) const {
  return has_attitude_ && std::abs(utime - attitude_utime_) <= kMaxAttitudeAgeUs;
}

void NavConverter::HearAttitude(const NavSample& sample, const Vec3& rate_radps) {
  ned_from_body_ = sample.ned_from_body;
  rotation_rate_radps_ = IsMeasurable(rate_radps) ? rate_radps : Vec3::Zero();
  attitude_utime_ = sample.utime;
  has_attitude_ = true;
}

bool NavConverter::Reject(NavReject reason) {
  ++rejected_[static_cast<std::size_t>(reason)];
  return false;
}

bool NavConverter::TakeTime(Utime utime) { return IsTime(utime) || Reject(NavReject::kOutOfRange); }

bool NavConverter::TakeFinite(bool is_finite) { return is_finite || Reject(NavReject::kNotFinite); }

bool NavConverter::TakeMeasured(const Vec3& value) {
  return TakeFinite(value.allFinite()) && (IsMeasurable(value) || Reject(NavReject::kOutOfRange));
}

bool NavConverter::TakeChanging(Utime utime, const Vec3& measured, RepeatWatch* repeats) {
  return repeats->Take(utime, measured.homogeneous()) || Reject(NavReject::kFrozen);
}

bool NavConverter::Take(const Vec3& value, const double (&covariance)[9], Vec3* sigma) {
  return TakeMeasured(value) && TakeFinite(IsFinite(covariance)) &&
         (Sigmas(covariance, sigma) || Reject(NavReject::kSentinel));
}

bool NavConverter::Take(double value, double sigma) {
  return TakeMeasured(Vec3::Constant(value)) && TakeFinite(std::isfinite(sigma)) &&
         (sigma >= 0.0 || Reject(NavReject::kSentinel));
}

bool NavConverter::Take(const double (&wxyz)[4], const double (&covariance)[9], Quat* q,
                        Vec3* sigma) {
  return TakeFinite(Vec4::Map(wxyz).allFinite() && IsFinite(covariance)) &&
         (ToQuat(wxyz, q) || Reject(NavReject::kOutOfRange)) &&
         (Sigmas(covariance, sigma) || Reject(NavReject::kSentinel));
}

NavDecode NavConverter::Convert(const BusInput& input, std::span<const std::uint8_t> data,
                                NavSample* sample) {
  switch (input.type) {
    case InputType::kNav:
      return DecodeAndConvert<nav_t>(this, data, sample);
    case InputType::kDvl:
      return DecodeAndConvert<dvl_t>(this, data, sample);
    case InputType::kAhrs:
      return DecodeAndConvert<ahrs_t>(this, data, sample);
    case InputType::kDepth:
      return DecodeAndConvert<depth_t>(this, data, sample);
    case InputType::kCtd:
      return DecodeAndConvert<ctd_t>(this, data, sample);
    case InputType::kFix:
      return DecodeAndConvert<fix_t>(this, data, sample);
    case InputType::kBotCorePose: {
      bot_core::pose_t message;
      if (!Decode(data, &message)) return NavDecode::kMalformed;
      return Convert(message, input.convention, sample) ? NavDecode::kOk : NavDecode::kRejected;
    }
    case InputType::kAcfrNav:
      return DecodeAndConvert<acfrlcm::auv_acfr_nav_t>(this, data, sample);
  }
  return NavDecode::kMalformed;
}

bool NavConverter::Convert(const nav_t& m, NavSample* sample) {
  if (!TakeTime(m.utime)) return false;
  NavSample s;
  s.utime = m.utime;
  const auto has = [&](int bit) { return (m.valid & bit) != 0; };
  if (has(nav_t::VALID_POSITION) &&
      Take(ToVec3(m.position_ned_m), m.position_cov_m2, &s.sigma_position_m)) {
    s.position_ned_m = ToVec3(m.position_ned_m);
    s.Set(NavField::kPosition);
  }
  if (has(nav_t::VALID_ATTITUDE) &&
      Take(m.ned_from_body_q, m.attitude_cov_rad2, &s.ned_from_body, &s.sigma_attitude_rad)) {
    s.Set(NavField::kAttitude);
    HearAttitude(s, Vec3::Zero());
  }
  if (has(nav_t::VALID_VELOCITY) &&
      Take(ToVec3(m.velocity_body_mps), m.velocity_cov_m2ps2, &s.sigma_velocity_mps)) {
    s.velocity_body_mps = ToVec3(m.velocity_body_mps);
    s.Set(NavField::kVelocity);
  }
  if (has(nav_t::VALID_DEPTH) && Take(m.depth_m, m.depth_sigma_m)) {
    s.depth_m = m.depth_m;
    s.sigma_depth_m = m.depth_sigma_m;
    s.Set(NavField::kDepth);
    depth_m_ = s.depth_m;
  }
  if (has(nav_t::VALID_ALTITUDE) && Take(m.altitude_m, m.altitude_sigma_m)) {
    s.altitude_m = m.altitude_m;
    s.sigma_altitude_m = m.altitude_sigma_m;
    s.Set(NavField::kAltitude);
  }
  if (has(nav_t::VALID_WATER) && Take(m.temperature_c, 0.0) && Take(m.salinity_psu, 0.0)) {
    s.temperature_c = m.temperature_c;
    s.salinity_psu = m.salinity_psu;
    s.Set(NavField::kWater);
  }
  if (s.valid == 0) return false;
  *sample = s;
  return true;
}

bool NavConverter::Convert(const dvl_t& m, NavSample* sample) {
  if (!TakeTime(m.utime)) return false;
  NavSample s;
  s.utime = m.utime;
  if ((m.valid & dvl_t::VALID_VELOCITY) != 0 &&
      Take(ToVec3(m.velocity_body_mps), m.velocity_cov_m2ps2, &s.sigma_velocity_mps) &&
      (!IsVelocitySentinel(ToVec3(m.velocity_body_mps)) || Reject(NavReject::kSentinel)) &&
      TakeChanging(m.utime, ToVec3(m.velocity_body_mps), &velocity_repeats_)) {
    const Vec3 rate = HasAttitude(m.utime) ? rotation_rate_radps_ : Vec3::Zero();
    s.velocity_body_mps = BodyVelocity(ToVec3(m.velocity_body_mps), rate, sensors_.dvl_in_body_m);
    s.Set(NavField::kVelocity);
  }
  if ((m.valid & dvl_t::VALID_ALTITUDE) != 0 && Take(m.altitude_m, m.altitude_sigma_m) &&
      (m.altitude_m > 0.0 || Reject(NavReject::kSentinel)) &&
      TakeChanging(m.utime, Vec3(0.0, 0.0, m.altitude_m), &altitude_repeats_)) {
    const Quat attitude = HasAttitude(m.utime) ? ned_from_body_ : Quat::Identity();
    s.altitude_m = m.altitude_m + (attitude * sensors_.dvl_in_body_m).z();
    s.sigma_altitude_m = m.altitude_sigma_m;
    s.Set(NavField::kAltitude);
  }
  if (s.valid == 0) return false;
  *sample = s;
  return true;
}

bool NavConverter::Convert(const ahrs_t& m, NavSample* sample) {
  NavSample s;
  s.utime = m.utime;
  if ((m.valid & ahrs_t::VALID_ATTITUDE) == 0 || !TakeTime(m.utime) ||
      !Take(m.ned_from_body_q, m.attitude_cov_rad2, &s.ned_from_body, &s.sigma_attitude_rad)) {
    return false;
  }
  s.Set(NavField::kAttitude);
  const bool has_rate = (m.valid & ahrs_t::VALID_ROTATION_RATE) != 0;
  HearAttitude(s, has_rate ? ToVec3(m.rotation_rate_radps) : Vec3::Zero());
  *sample = s;
  return true;
}

bool NavConverter::Convert(const depth_t& m, NavSample* sample) {
  if (m.valid == 0 || !TakeTime(m.utime) || !Take(m.depth_m, m.sigma_m) ||
      !TakeChanging(m.utime, Vec3(0.0, 0.0, m.depth_m), &depth_repeats_)) {
    return false;
  }
  NavSample s;
  s.utime = m.utime;
  const Quat attitude = HasAttitude(m.utime) ? ned_from_body_ : Quat::Identity();
  s.depth_m = m.depth_m - (attitude * sensors_.depth_in_body_m).z();
  s.sigma_depth_m = m.sigma_m;
  s.Set(NavField::kDepth);
  depth_m_ = s.depth_m;
  *sample = s;
  return true;
}

bool NavConverter::Convert(const ctd_t& m, NavSample* sample) {
  if (!TakeTime(m.utime)) return false;
  if ((m.valid & ctd_t::VALID_TEMPERATURE) != 0 && Take(m.temperature_c, 0.0)) {
    temperature_c_ = m.temperature_c;
    has_temperature_ = true;
  }
  if ((m.valid & ctd_t::VALID_SALINITY) != 0 && Take(m.salinity_psu, 0.0)) {
    salinity_psu_ = m.salinity_psu;
    has_salinity_ = true;
  }
  if (!has_temperature_ || !has_salinity_) return false;
  NavSample s;
  s.utime = m.utime;
  s.temperature_c = temperature_c_;
  s.salinity_psu = salinity_psu_;
  s.Set(NavField::kWater);
  *sample = s;
  return true;
}

bool NavConverter::Convert(const fix_t& m, NavSample* sample) {
  NavSample s;
  s.utime = m.utime;
  if (!TakeTime(m.utime)) return false;
  const bool has_height = (m.valid & fix_t::VALID_HEIGHT) != 0 && Take(m.height_m, 0.0);
  if ((m.valid & fix_t::VALID_HORIZONTAL) == 0 ||
      !Take(Vec3(m.latitude_deg, m.longitude_deg, 0.0), m.position_cov_m2, &s.sigma_position_m)) {
    return false;
  }
  const double known_height = frame_ ? frame_->origin().height_m : 0.0;
  const Geodetic place{m.latitude_deg, m.longitude_deg, has_height ? m.height_m : known_height};
  if (!frame_) {
    auto frame = LocalFrame::Create(place);
    if (!frame) return Reject(NavReject::kOutOfRange);
    frame_ = *frame;
  } else if (!LocalFrame::Create(place)) {
    return Reject(NavReject::kOutOfRange);
  }
  const Quat attitude = HasAttitude(m.utime) ? ned_from_body_ : Quat::Identity();
  s.position_ned_m = frame_->NedFromGeodetic(place) - attitude * sensors_.position_in_body_m;
  if (!has_height) {
    s.position_ned_m.z() = depth_m_.value_or(0.0);
    s.sigma_position_m.z() = kUnknownSigma;
  }
  s.Set(NavField::kPosition);
  *sample = s;
  return true;
}

bool NavConverter::Convert(const bot_core::pose_t& m, Convention convention, NavSample* sample) {
  NavSample s;
  Quat local_from_body;
  const Vec3 position = ToVec3(m.pos), velocity = ToVec3(m.vel);
  if (convention == Convention::kRsfm || !TakeTime(m.utime) || !TakeMeasured(position) ||
      !TakeMeasured(velocity) || !TakeFinite(Vec4::Map(m.orientation).allFinite())) {
    return false;
  }
  if (!ToQuat(m.orientation, &local_from_body)) return Reject(NavReject::kOutOfRange);
  // East-north-up to north-east-down, and forward-left-up to forward-right-down: half turns.
  const double half = std::sqrt(0.5);
  const Quat ned_from_enu(0.0, half, half, 0.0);
  const Quat flu_from_frd(0.0, 1.0, 0.0, 0.0);
  s.utime = m.utime;
  s.position_ned_m = ned_from_enu * position;
  s.ned_from_body = ned_from_enu * local_from_body;
  if (convention == Convention::kLibbot) {
    s.ned_from_body = s.ned_from_body * flu_from_frd;
    s.velocity_body_mps = s.ned_from_body.conjugate() * (ned_from_enu * velocity);
  } else {
    s.velocity_body_mps = velocity;
  }
  s.Set(NavField::kPosition);
  s.Set(NavField::kAttitude);
  s.Set(NavField::kVelocity);
  const Vec3 rate = ToVec3(m.rotation_rate);
  const bool is_local = convention == Convention::kLibbot;
  HearAttitude(s, is_local ? s.ned_from_body.conjugate() * (ned_from_enu * rate) : rate);
  *sample = s;
  return true;
}

bool NavConverter::Convert(const acfrlcm::auv_acfr_nav_t& m, NavSample* sample) {
  NavSample s;
  const Vec3 position(m.x, m.y, m.depth), velocity(m.vx, m.vy, m.vz);
  if (!TakeTime(m.utime) || !TakeMeasured(position) || !TakeMeasured(velocity) ||
      !TakeMeasured(Vec3(m.roll, m.pitch, m.heading))) {
    return false;
  }
  s.utime = m.utime;
  s.position_ned_m = position;
  s.ned_from_body = QuatFromRollPitchHeading(m.roll, m.pitch, m.heading);
  s.velocity_body_mps = velocity;
  s.depth_m = m.depth;
  for (const NavField field :
       {NavField::kPosition, NavField::kAttitude, NavField::kVelocity, NavField::kDepth})
    s.Set(field);
  if (m.altitude > 0.0 && m.altitude < kLargest) {
    s.altitude_m = m.altitude;
    s.Set(NavField::kAltitude);
  }
  HearAttitude(s, Vec3(m.rollRate, m.pitchRate, m.headingRate));
  depth_m_ = m.depth;
  *sample = s;
  return true;
}

nav_t ToMessage(const NavSample& sample) {
  nav_t m = {};
  m.utime = sample.utime;
  m.valid = static_cast<std::int32_t>(sample.valid);  // the bits are the same
  const Quat& q = sample.ned_from_body;
  const double wxyz[4] = {q.w(), q.x(), q.y(), q.z()};
  for (int i = 0; i < 4; ++i) m.ned_from_body_q[i] = wxyz[i];
  for (int i = 0; i < 3; ++i) {
    m.position_ned_m[i] = sample.position_ned_m[i];
    m.velocity_body_mps[i] = sample.velocity_body_mps[i];
  }
  SetCovariance(sample.sigma_position_m, m.position_cov_m2);
  SetCovariance(sample.sigma_attitude_rad, m.attitude_cov_rad2);
  SetCovariance(sample.sigma_velocity_mps, m.velocity_cov_m2ps2);
  m.depth_m = sample.depth_m;
  m.depth_sigma_m = sample.sigma_depth_m;
  m.altitude_m = sample.altitude_m;
  m.altitude_sigma_m = sample.sigma_altitude_m;
  m.temperature_c = sample.temperature_c;
  m.salinity_psu = sample.salinity_psu;
  return m;
}

}  // namespace rsfm
