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
          m->sample.ned_from_body =
              (ExpSo3(kRad * error_deg) * motion.world_from_body.rotation).normalized();
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
      m->velocity_at_dvl_mps =
          (1.0 + o.scale_error) * (motion.velocity_in_body_mps + swing) + o.sigma_mps * noise;
      m->rate_radps = motion.rate_in_body_radps;
      m->sample.velocity_body_mps = m->velocity_at_dvl_mps - swing;
      m->sample.sigma_velocity_mps = Vec3::Constant(o.sigma_mps);
      m->sample.Set(NavField::kVelocity);
      MeasureAltitude(motion, o.altitude_sigma_m, rng, &m->sample);
    });
  }

  void Depth() {
    const auto& o = options_.depth;
    Sample(NavSource::kDepth, o.timing, [&](const BodyMotion& motion, Rng* rng, NavMeasurement* m) {
      m->sample.depth_m =
          motion.world_from_body.translation.z() + o.bias_m + rng->Gaussian(0.0, o.sigma_m);
      m->sample.sigma_depth_m = o.sigma_m;
      m->sample.Set(NavField::kDepth);
    });
  }

  void Altimeter() {
    const auto& o = options_.altimeter;
    Sample(NavSource::kAltimeter, o.timing,
           [&](const BodyMotion& motion, Rng* rng, NavMeasurement* m) {
             MeasureAltitude(motion, o.sigma_m, rng, &m->sample);
           });
  }

  void Position() {
    const auto& o = options_.position;
    Sample(
        NavSource::kPosition, o.timing, [&](const BodyMotion& motion, Rng* rng, NavMeasurement* m) {
          const Vec3 sigma(o.horizontal_sigma_m, o.horizontal_sigma_m, o.vertical_sigma_m);
          const Vec3 noise(rng->Gaussian(), rng->Gaussian(), rng->Gaussian());
          m->sample.position_ned_m = motion.world_from_body.translation + sigma.cwiseProduct(noise);
          m->sample.sigma_position_m = sigma;
          m->sample.Set(NavField::kPosition);
        });
  }

  void MeasureAltitude(const BodyMotion& motion, double sigma_m, Rng* rng,
                       NavSample* sample) const {
    const double noise = rng->Gaussian(0.0, sigma_m);
    const double altitude = altitude_at_(motion.world_from_body.translation);
    if (altitude < 0.0 || altitude + noise <= 0.0) return;
    sample->altitude_m = altitude + noise;
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
