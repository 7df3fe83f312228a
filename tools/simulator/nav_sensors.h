// The vehicle's navigation sensors: what they would report along a trajectory, each at its own
// rate, with noise, bias, drop-outs and delay.
#pragma once

#include <functional>
#include <vector>

#include "rsfm/navigation/nav_sample.h"
#include "tools/simulator/trajectory.h"

namespace rsfm::simulator {

struct SensorTiming {
  bool enabled = true;
  double rate_hz = 5.0;
  double dropout = 0.0;  // share of the measurements that never arrive
  double delay_s = 0.0;  // time stamps are this much late
};

struct NavSensorOptions {
  struct Attitude {
    SensorTiming timing = {true, 20.0, 0.0, 0.0};
    double roll_pitch_sigma_deg = 0.10;
    double heading_sigma_deg = 0.30;
    double heading_bias_sigma_deg = 0.5;  // a slow drift: Gauss-Markov
    double heading_bias_time_s = 300.0;
    double roll_bias_deg = 0.0;  // how the instrument is mounted, unknown to the vehicle
    double pitch_bias_deg = 0.0;
    double heading_offset_deg = 0.0;
  } attitude;
  struct Dvl {
    SensorTiming timing = {true, 5.0, 0.0, 0.0};
    double sigma_mps = 0.004;
    double scale_error = 0.003;             // velocity is reported this share too large
    double heading_misalignment_deg = 0.0;  // velocities are turned by this about the body's z
    Vec3 bias_mps = Vec3::Zero();
    double altitude_sigma_m = 0.03;
    Vec3 dvl_in_body_m = Vec3::Zero();  // lever arm
  } dvl;
  struct Depth {
    SensorTiming timing = {true, 10.0, 0.0, 0.0};
    double sigma_m = 0.01;
    double bias_m = 0.0;
    Vec3 depth_in_body_m = Vec3::Zero();  // lever arm
  } depth;
  struct Altimeter {
    SensorTiming timing = {false, 5.0, 0.0, 0.0};
    double sigma_m = 0.03;
    double bias_m = 0.0;
  } altimeter;
  struct Position {
    SensorTiming timing = {false, 0.2, 0.0, 0.0};
    double horizontal_sigma_m = 0.5;
    double vertical_sigma_m = 0.8;
    double drift_sigma_m = 0.0;  // a slow offset, north and east: Gauss-Markov
    double drift_time_s = 600.0;
    Vec3 position_in_body_m = Vec3::Zero();  // lever arm of the transponder or antenna
  } position;
  std::uint64_t seed = 1;
};

enum class NavSource : std::uint8_t { kAttitude, kDvl, kDepth, kAltimeter, kPosition };

struct NavMeasurement {
  NavSource source = NavSource::kAttitude;
  NavSample sample;  // reduced to the body's origin
  // What the instruments themselves report, in body axes.
  Vec3 velocity_at_dvl_mps = Vec3::Zero();
  double altitude_at_dvl_m = 0.0;
  double depth_at_sensor_m = 0.0;
  Vec3 position_of_transponder_ned_m = Vec3::Zero();
  Vec3 rate_radps = Vec3::Zero();
};

// Height above the bottom at a place in the world, straight down; negative where there is none.
using AltitudeAt = std::function<double(const Vec3& position_in_world)>;

// In order of time stamp; at equal ones in the order of NavSource. From `start_utime` on, from
// `lead_s` before the trajectory's start to as much after its end (the vehicle then rests).
std::vector<NavMeasurement> SimulateNavigation(const Trajectory& trajectory, Utime start_utime,
                                               double lead_s, const AltitudeAt& altitude_at,
                                               const NavSensorOptions& options);

// One sample per time stamp: the measurements' fields united. Strictly increasing.
std::vector<NavSample> MergeSamples(const std::vector<NavMeasurement>& measurements);

}  // namespace rsfm::simulator
