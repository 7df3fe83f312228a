#include "tools/simulator/nav_log.h"

#include <algorithm>
#include <string>

namespace rsfm::simulator {
namespace {

template <class Message>
IoStatus Log(const Rig& rig, InputType type, const char* fallback, const Message& message,
             MissionWriter* writer) {
  std::string channel = fallback;
  for (const BusInput& input : rig.bus.inputs) {
    if (input.type == type) channel = input.channel;
  }
  return writer->Log(channel, message.utime, message);
}

void SetDiagonal(const Vec3& sigma, double* covariance) {
  for (int i = 0; i < 3; ++i) covariance[4 * i] = sigma[i] * sigma[i];
}

}  // namespace

IoStatus LogMeasurement(const NavMeasurement& m, const Rig& rig, const LocalFrame* frame,
                        MissionWriter* writer) {
  const NavSample& s = m.sample;
  switch (m.source) {
    case NavSource::kAttitude: {
      ahrs_t message{};
      message.utime = s.utime;
      message.valid = ahrs_t::VALID_ATTITUDE;
      message.valid |= ahrs_t::VALID_ROTATION_RATE;
      const Quat& q = s.ned_from_body;
      const double wxyz[4] = {q.w(), q.x(), q.y(), q.z()};
      std::copy(wxyz, wxyz + 4, message.ned_from_body_q);
      SetDiagonal(s.sigma_attitude_rad, message.attitude_cov_rad2);
      for (int i = 0; i < 3; ++i) message.rotation_rate_radps[i] = m.rate_radps[i];
      return Log(rig, InputType::kAhrs, "RSFM_AHRS", message, writer);
    }
    case NavSource::kDvl: {
      dvl_t message{};
      message.utime = s.utime;
      message.valid = dvl_t::VALID_VELOCITY;
      for (int i = 0; i < 3; ++i) message.velocity_body_mps[i] = m.velocity_at_dvl_mps[i];
      SetDiagonal(s.sigma_velocity_mps, message.velocity_cov_m2ps2);
      if (s.Has(NavField::kAltitude)) {
        message.valid |= dvl_t::VALID_ALTITUDE;
        message.altitude_m = m.altitude_at_dvl_m;
        message.altitude_sigma_m = s.sigma_altitude_m;
      }
      return Log(rig, InputType::kDvl, "RSFM_DVL", message, writer);
    }
    case NavSource::kDepth: {
      depth_t message{};
      message.utime = s.utime;
      message.valid = 1;
      message.depth_m = m.depth_at_sensor_m;
      message.sigma_m = s.sigma_depth_m;
      return Log(rig, InputType::kDepth, "RSFM_DEPTH", message, writer);
    }
    case NavSource::kAltimeter:
    case NavSource::kPosition:
      break;
  }
  if (m.source == NavSource::kPosition && frame != nullptr) {
    fix_t message{};
    const Geodetic place = frame->GeodeticFromNed(m.position_of_transponder_ned_m);
    message.utime = s.utime;
    message.valid = fix_t::VALID_HORIZONTAL;
    message.valid |= fix_t::VALID_HEIGHT;
    message.source = fix_t::SOURCE_USBL;
    message.latitude_deg = place.latitude_deg;
    message.longitude_deg = place.longitude_deg;
    message.height_m = place.height_m;
    SetDiagonal(s.sigma_position_m, message.position_cov_m2);
    return Log(rig, InputType::kFix, "RSFM_FIX", message, writer);
  }
  // In the local frame already: a vehicle's own solution, as it would put it on the bus.
  nav_t message{};
  message.utime = s.utime;
  message.ned_from_body_q[0] = 1.0;
  if (s.Has(NavField::kPosition)) {
    message.valid |= nav_t::VALID_POSITION;
    for (int i = 0; i < 3; ++i) message.position_ned_m[i] = s.position_ned_m[i];
    SetDiagonal(s.sigma_position_m, message.position_cov_m2);
  }
  if (s.Has(NavField::kAltitude)) {
    message.valid |= nav_t::VALID_ALTITUDE;
    message.altitude_m = s.altitude_m;
    message.altitude_sigma_m = s.sigma_altitude_m;
  }
  return Log(rig, InputType::kNav, "RSFM_NAV", message, writer);
}

}  // namespace rsfm::simulator
