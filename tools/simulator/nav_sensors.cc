#include "tools/simulator/nav_sensors.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "rsfm/base/rng.h"

namespace rsfm::simulator {
namespace {

constexpr double kRad = std::numbers::pi / 180.0;

class Simulation {
 public:
  Simulation(const Trajectory& trajectory, Utime start_utime, double lead_s,
             const AltitudeAt& altitude_at, const NavSensorOptions& options)
      : trajectory_(trajectory),
        start_utime_(start_utime),
        lead_s_(lead_s),
        altitude_at_(altitude_at),
        options_(options) {}

  std::vector<NavMeasurement> Run() {
    Attitude();
    Dvl();
    Depth();
    Altimeter();
    Position();
    std::stable_sort(measurements_.begin(), measurements_.end(),
                     [](const NavMeasurement& a, const NavMeasurement& b) {
                       return a.sample.utime < b.sample.utime;
                     });
    return std::move(measurements_);
  }

 private:
  // Calls measure(motion, rng, &measurement) at the sensor's times. Every sensor has its own stream
  // of random numbers, so that switching one off leaves the others as they are.
  template <class Measure>
  void Sample(NavSource source, const SensorTiming& timing, Measure&& measure) {
    if (!timing.enabled) return;
    Rng rng(options_.seed * 1000003u + static_cast<std::uint64_t>(source));
    const double period = 1.0 / timing.rate_hz;
    const auto count =
        static_cast<std::int64_t>((trajectory_.duration_s() + 2.0 * lead_s_) / period);
    for (std::int64_t i = 0; i <= count; ++i) {
      const double time = static_cast<double>(i) * period - lead_s_;
      NavMeasurement measurement;
      measurement.source = source;
      measurement.sample.utime = start_utime_ + UsFromSeconds(time + timing.delay_s);
      measure(trajectory_.MotionAt(time), &rng, &measurement);
      const bool is_lost = rng.Uniform() < timing.dropout;
      if (!is_lost && measurement.sample.valid != 0) measurements_.push_back(measurement);
    }
  }

  void Attitude() {
    const auto& o = options_.attitude;
    const double decay = std::exp(-1.0 / (o.timing.rate_hz * o.heading_bias_time_s));
    double bias = 0.0;
    bool is_first = true;
    Sample(
        NavSource::kAttitude, o.timing, [&](const BodyMotion& motion, Rng* rng, NavMeasurement* m) {
          const double kick = is_first ? 1.0 : std::sqrt(1.0 - decay * decay);
          bias =
              (is_first ? 0.0 : decay * bias) + kick * rng->Gaussian(0.0, o.heading_bias_sigma_deg);
          is_first = false;
          const double tilt = o.roll_pitch_sigma_deg;
          const Vec3 error_deg(rng->Gaussian(0.0, tilt), rng->Gaussian(0.0, tilt),
                               bias + rng->Gaussian(0.0, o.heading_sigma_deg));
          const Vec3 mounting_deg(o.roll_bias_deg, o.pitch_bias_deg, o.heading_offset_deg);
          m->sample.ned_from_body = (ExpSo3(kRad * error_deg) * motion.world_from_body.rotation *
                                     ExpSo3(kRad * mounting_deg))
                                        .normalized();
          m->sample.sigma_attitude_rad =
              kRad * Vec3(tilt, tilt, std::hypot(o.heading_sigma_deg, o.heading_bias_sigma_deg));
          m->rate_radps = motion.rate_in_body_radps;
          m->sample.Set(NavField::kAttitude);
        });
  }

  void Dvl() {
    const auto& o = options_.dvl;
    Sample(NavSource::kDvl, o.timing, [&](const BodyMotion& motion, Rng* rng, NavMeasurement* m) {
      const Vec3 swing = motion.rate_in_body_radps.cross(o.dvl_in_body_m);
      const Vec3 noise(rng->Gaussian(), rng->Gaussian(), rng->Gaussian());
      const Quat misaligned = ExpSo3(Vec3(0.0, 0.0, kRad * o.heading_misalignment_deg));
      m->velocity_at_dvl_mps =
          (1.0 + o.scale_error) * (misaligned * (motion.velocity_in_body_mps + swing)) +
          o.bias_mps + o.sigma_mps * noise;
      m->rate_radps = motion.rate_in_body_radps;
      m->sample.velocity_body_mps = m->velocity_at_dvl_mps - swing;
      m->sample.sigma_velocity_mps = Vec3::Constant(o.sigma_mps);
      m->sample.Set(NavField::kVelocity);
      const Vec3 arm = motion.world_from_body.rotation * o.dvl_in_body_m;
      m->altitude_at_dvl_m =
          MeasureAltitude(motion.world_from_body.translation + arm, o.altitude_sigma_m, rng);
      SetAltitude(m->altitude_at_dvl_m, arm.z(), o.altitude_sigma_m, &m->sample);
    });
  }

  void Depth() {
    const auto& o = options_.depth;
    Sample(NavSource::kDepth, o.timing, [&](const BodyMotion& motion, Rng* rng, NavMeasurement* m) {
      const double arm_m = (motion.world_from_body.rotation * o.depth_in_body_m).z();
      m->sample.depth_m =
          motion.world_from_body.translation.z() + o.bias_m + rng->Gaussian(0.0, o.sigma_m);
      m->depth_at_sensor_m = m->sample.depth_m + arm_m;
      m->sample.sigma_depth_m = o.sigma_m;
      m->sample.Set(NavField::kDepth);
    });
  }

  void Altimeter() {
    const auto& o = options_.altimeter;
    Sample(NavSource::kAltimeter, o.timing,
           [&](const BodyMotion& motion, Rng* rng, NavMeasurement* m) {
             const double altitude_m =
                 MeasureAltitude(motion.world_from_body.translation, o.sigma_m, rng);
             if (altitude_m > 0.0) {
               SetAltitude(altitude_m + o.bias_m, 0.0, o.sigma_m, &m->sample);
             }
           });
  }

  void Position() {
    const auto& o = options_.position;
    const double decay = std::exp(-1.0 / (o.timing.rate_hz * o.drift_time_s));
    Vec3 drift = Vec3::Zero();
    bool is_first = true;
    Sample(NavSource::kPosition, o.timing,
           [&](const BodyMotion& motion, Rng* rng, NavMeasurement* m) {
             const Vec3 sigma(o.horizontal_sigma_m, o.horizontal_sigma_m, o.vertical_sigma_m);
             const Vec3 noise(rng->Gaussian(), rng->Gaussian(), rng->Gaussian());
             if (o.drift_sigma_m > 0.0) {
               const double kick = is_first ? 1.0 : std::sqrt(1.0 - decay * decay);
               const Vec3 step(rng->Gaussian(), rng->Gaussian(), 0.0);
               drift = decay * drift + kick * o.drift_sigma_m * step;
               is_first = false;
             }
             const Vec3 arm = motion.world_from_body.rotation * o.position_in_body_m;
             m->sample.position_ned_m =
                 motion.world_from_body.translation + drift + sigma.cwiseProduct(noise);
             m->position_of_transponder_ned_m = m->sample.position_ned_m + arm;
             m->sample.sigma_position_m =
                 (sigma.array().square() +
                  Eigen::Array3d(1.0, 1.0, 0.0) * o.drift_sigma_m * o.drift_sigma_m)
                     .sqrt();
             m->sample.Set(NavField::kPosition);
           });
  }

  // Above the bottom straight below a place; not positive where there is none.
  double MeasureAltitude(const Vec3& place_in_world, double sigma_m, Rng* rng) const {
    const double noise = rng->Gaussian(0.0, sigma_m);
    const double altitude = altitude_at_(place_in_world);
    return altitude < 0.0 ? -1.0 : altitude + noise;
  }

  // `lower_m`: how far the instrument lies below the body's origin.
  static void SetAltitude(double measured_m, double lower_m, double sigma_m, NavSample* sample) {
    if (measured_m <= 0.0) return;
    sample->altitude_m = measured_m + lower_m;
    sample->sigma_altitude_m = sigma_m;
    sample->Set(NavField::kAltitude);
  }

  const Trajectory& trajectory_;
  Utime start_utime_;
  double lead_s_;
  const AltitudeAt& altitude_at_;
  const NavSensorOptions& options_;
  std::vector<NavMeasurement> measurements_;
};

void Unite(const NavSample& from, NavSample* into) {
  if (from.Has(NavField::kAttitude)) {
    into->ned_from_body = from.ned_from_body;
    into->sigma_attitude_rad = from.sigma_attitude_rad;
  }
  if (from.Has(NavField::kVelocity)) {
    into->velocity_body_mps = from.velocity_body_mps;
    into->sigma_velocity_mps = from.sigma_velocity_mps;
  }
  if (from.Has(NavField::kPosition)) {
    into->position_ned_m = from.position_ned_m;
    into->sigma_position_m = from.sigma_position_m;
  }
  if (from.Has(NavField::kDepth)) {
    into->depth_m = from.depth_m;
    into->sigma_depth_m = from.sigma_depth_m;
  }
  if (from.Has(NavField::kAltitude)) {
    into->altitude_m = from.altitude_m;
    into->sigma_altitude_m = from.sigma_altitude_m;
  }
  into->valid |= from.valid;
}

}  // namespace

std::vector<NavMeasurement> SimulateNavigation(const Trajectory& trajectory, Utime start_utime,
                                               double lead_s, const AltitudeAt& altitude_at,
                                               const NavSensorOptions& options) {
  return Simulation(trajectory, start_utime, lead_s, altitude_at, options).Run();
}

std::vector<NavSample> MergeSamples(const std::vector<NavMeasurement>& measurements) {
  std::vector<NavSample> samples;
  for (const NavMeasurement& measurement : measurements) {
    if (samples.empty() || samples.back().utime != measurement.sample.utime) {
      samples.emplace_back().utime = measurement.sample.utime;
    }
    Unite(measurement.sample, &samples.back());
  }
  return samples;
}

}  // namespace rsfm::simulator
