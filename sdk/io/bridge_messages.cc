#include "rsfm/io/bridge_messages.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "rsfm/io/tables.h"
#include "rsfm/navigation/nav_sample.h"

namespace rsfm {
namespace {

enum class RdiFrame : std::uint8_t { kBeam, kInstrument, kShip, kEarth };
constexpr std::uint8_t kRdiTiltsUsed = 0x20;

dvl_t EmptyDvl(Utime utime) {
  dvl_t message = {};
  message.utime = utime;
  return message;
}

void SetVelocity(const Vec3& velocity_body_mps, dvl_t* message) {
  for (int i = 0; i < 3; ++i) message->velocity_body_mps[i] = velocity_body_mps[i];
  message->valid |= dvl_t::VALID_VELOCITY;
}

void SetVelocityCovariance(const Mat3& covariance_in_instrument, const Quat& body_from_instrument,
                           dvl_t* message) {
  const Mat3 r = body_from_instrument.toRotationMatrix();
  const Mat3 covariance = r * covariance_in_instrument * r.transpose();
  for (int i = 0; i < 9; ++i) message->velocity_cov_m2ps2[i] = covariance(i / 3, i % 3);
}

void SetAltitude(double altitude_m, dvl_t* message) {
  if (!std::isfinite(altitude_m) || altitude_m <= 0.0) return;
  message->altitude_m = altitude_m;
  message->valid |= dvl_t::VALID_ALTITUDE;
}

std::optional<Vec3> BodyVelocityOfRdi(const RdiPing& ping, const Quat& body_from_instrument,
                                      const std::optional<Quat>& ned_from_body) {
  const auto& v = ping.bottom_velocity_mps;
  const Vec3 measured(v[0], v[1], v[2]);
  if (!measured.allFinite() || IsVelocitySentinel(measured)) return std::nullopt;
  const auto frame = static_cast<RdiFrame>(ping.system_config >> 6);
  if (frame == RdiFrame::kBeam) return std::nullopt;
  if (frame == RdiFrame::kInstrument) return body_from_instrument * measured;
  // Starboard, forward, up or east, north, up: as forward, right, down or north, east, down.
  const Vec3 turned(measured.y(), measured.x(), -measured.z());
  const bool is_ship = frame == RdiFrame::kShip;
  if (is_ship && (ping.system_config & kRdiTiltsUsed) == 0) return turned;
  if (!ned_from_body) return std::nullopt;
  const Quat ned_from_measured =
      is_ship ? QuatFromRollPitchHeading(0.0, 0.0, RollPitchHeading(*ned_from_body).z())
              : Quat::Identity();
  return ned_from_body->conjugate() * (ned_from_measured * turned);
}

bool HasEachIdOnce(const std::array<WaterLinkedBeam, 4>& beams) {
  unsigned int ids = 0;
  for (const WaterLinkedBeam& beam : beams) {
    if (beam.id < 0 || beam.id > 3) return false;
    ids |= 1u << beam.id;
  }
  return ids == 0xf;
}

}  // namespace

bool DvlFromRdi(const RdiPing& ping, const Quat& body_from_instrument,
                const std::optional<Quat>& ned_from_body, dvl_t* message) {
  *message = EmptyDvl(ping.utime);
  if (const auto v = BodyVelocityOfRdi(ping, body_from_instrument, ned_from_body))
    SetVelocity(*v, message);
  SetAltitude(ping.altitude_m, message);
  return message->valid != 0;
}

ctd_t CtdFromRdi(const RdiPing& ping) {
  ctd_t message = {};
  message.utime = ping.utime;
  message.valid = int{ctd_t::VALID_TEMPERATURE} | int{ctd_t::VALID_SALINITY};
  message.temperature_c = ping.temperature_c;
  message.salinity_psu = ping.salinity_psu;
  return message;
}

bool DvlFromWaterLinked(const WaterLinkedReport& report, const Quat& body_from_instrument,
                        dvl_t* message) {
  if (!HasEachIdOnce(report.beams)) return false;
  *message = EmptyDvl(report.utime);
  if (report.is_velocity_valid && report.velocity_mps.allFinite()) {
    SetVelocity(body_from_instrument * report.velocity_mps, message);
    if (std::isfinite(report.fom_mps) && report.fom_mps > 0.0)
      SetVelocityCovariance(Mat3::Identity() * report.fom_mps * report.fom_mps,
                            body_from_instrument, message);
  }
  SetAltitude(report.altitude_m, message);
  message->num_beams = 4;
  message->beam_range_m.resize(4);
  message->beam_velocity_mps.resize(4);
  message->beam_valid.resize(4);
  for (const WaterLinkedBeam& beam : report.beams) {
    const auto i = static_cast<std::size_t>(beam.id);
    const bool is_valid = beam.is_valid && beam.distance_m > 0.0 &&
                          std::isfinite(beam.distance_m) && std::isfinite(beam.velocity_mps);
    message->beam_range_m[i] = is_valid ? beam.distance_m : 0.0;
    message->beam_velocity_mps[i] = is_valid ? beam.velocity_mps : 0.0;
    message->beam_valid[i] = is_valid;
  }
  return message->valid != 0;
}

bool DvlFromUuv(const UuvDvl& dvl, const Quat& body_from_instrument, dvl_t* message) {
  *message = EmptyDvl(dvl.utime);
  const Mat3 covariance = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(
      dvl.velocity_covariance.data());
  const bool is_valid = dvl.velocity_mps.allFinite() && covariance.allFinite() &&
                        (covariance.diagonal().array() >= 0.0).all();
  if (is_valid) {
    SetVelocity(body_from_instrument * dvl.velocity_mps, message);
    SetVelocityCovariance(covariance, body_from_instrument, message);
  }
  SetAltitude(dvl.altitude_m, message);
  return message->valid != 0;
}

bool ToMavlinkOdometry(const pose_t& pose, MavlinkOdometry* odometry) {
  const bool is_lost = pose.state == pose_t::STATE_LOST || pose.quality < 0;
  const bool has_pose =
      pose.state != pose_t::STATE_WAITING && pose.state != pose_t::STATE_INITIALISING;
  if (!has_pose || pose.frame_id != "ned" || pose.child_frame_id != "body" || pose.utime < 0 ||
      !pose.scale_is_metric) {
    return false;
  }
  const auto narrow = [](double value) { return static_cast<float>(value); };
  MavlinkOdometry o;
  o.time_usec = static_cast<std::uint64_t>(pose.utime);
  std::transform(pose.position_m, pose.position_m + 3, o.position_m.begin(), narrow);
  std::transform(pose.frame_from_body_q, pose.frame_from_body_q + 4, o.q.begin(), narrow);
  std::transform(pose.velocity_body_mps, pose.velocity_body_mps + 3, o.velocity_mps.begin(),
                 narrow);
  std::size_t next = 0;
  for (int row = 0; row < 6; ++row)
    for (int column = row; column < 6; ++column)
      o.pose_covariance[next++] = narrow(pose.covariance[6 * row + column]);
  if (!(pose.covariance[0] >= 0.0)) o.pose_covariance[0] = std::numeric_limits<float>::quiet_NaN();
  o.reset_counter = static_cast<std::uint8_t>(pose.reset_counter & 0xff);
  o.quality = static_cast<std::int8_t>(is_lost ? -1 : std::clamp(pose.quality, 1, 100));
  *odometry = o;
  return true;
}

}  // namespace rsfm
