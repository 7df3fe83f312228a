// A lawn-mower survey with the sensors of a survey vehicle, without images: what the front end
// would hand over, and navigation with biases that drift. For tests and benchmarks of the
// estimator.
#pragma once

#include <memory>
#include <numbers>
#include <vector>

#include "rsfm/mapping/incremental_mapper.h"
#include "tests/mapping/feature_world.h"

namespace rsfm {

struct SimulatedMissionOptions {
  std::uint64_t seed = 1;
  TestPort port = TestPort::kFlat;
  int legs = 2;
  double leg_m = 20.0, spacing_m = 6.0;  // wider than an image: no revisits
  double speed_mps = 0.5;
  double frame_rate_hz = 2.0;
  int keyframe_every = 1;  // frames between are a video's: tracks alone
  double repeat_m = 0.0;   // > 0: the bottom looks the same again after so far north
  double altitude_m = 3.0, depth_m = 10.0;  // mean altitude; of the bottom
  double points_per_m2 = 12.0;
  int max_features = 160;
  double noise_px = 0.5;
  double missed = 0.0;  // of the points: not found for ten frames, although in sight

  // One standard deviation each.
  double attitude_deg = 0.1, heading_deg = 0.5;  // white
  double heading_bias_deg = 0.0;                 // at the start
  double heading_drift_deg = 1.0;                // random walk, in ten minutes
  double velocity_mps = 0.01, velocity_scale = 0.003;
  double depth_sigma_m = 0.02, altitude_sigma_m = 0.03;
  bool has_velocity = true, has_depth = true, has_altitude = false;
  double tide_m = 0.0;                          // the water rises by that until the end
  double fix_every_s = 0.0, fix_sigma_m = 0.5;  // 0: none
  double clock_offset_s = 0.0;                  // navigation's stamps run ahead of the camera's

  // Seconds from the start: begin, end.
  double blind_from_s = 0.0, blind_to_s = 0.0;
  double no_velocity_from_s = 0.0, no_velocity_to_s = 0.0;
  double frozen_depth_from_s = 0.0, frozen_depth_to_s = 0.0;
  double wrong_fixes_from_s = 0.0, wrong_fixes_to_s = 0.0;  // 20 m off, north and west
};

// Legs so near to each other that each sees the one before.
inline SimulatedMissionOptions PassesSideBySide(int legs) {
  SimulatedMissionOptions options;
  options.legs = legs;
  options.leg_m = 16.0;
  options.spacing_m = 1.0;
  return options;
}

class SimulatedMission {
 public:
  explicit SimulatedMission(const SimulatedMissionOptions& options)
      : options_(options), camera_(TestCamera(options.port)), world_(WorldOptions(options)) {}

  static constexpr double kStart_s = 1000.0;

  double length_m() const { return options_.legs * options_.leg_m + (options_.legs - 1) * Turn(); }
  double duration_s() const { return length_m() / options_.speed_mps; }
  int num_frames() const { return static_cast<int>(duration_s() * options_.frame_rate_hz); }
  bool IsKeyframe(int frame) const { return frame % options_.keyframe_every == 0; }
  double TimeOf(int frame) const { return frame / options_.frame_rate_hz; }
  const AnyCamera& camera() const { return camera_; }
  const FeatureWorld& world() const { return world_; }
  Utime UtimeOf(int frame) const { return UsFromSeconds(kStart_s + TimeOf(frame)); }

  // The depth sensor's reading goes up by it.
  double Tide(double seconds) const { return options_.tide_m * seconds / duration_s(); }

  // ned_from_body.
  Rigid3 Body(double seconds) const {
    const double along = seconds * options_.speed_mps;
    const double cycle = options_.leg_m + Turn();
    const double s = std::max(along, 0.0);
    const int leg = std::min(static_cast<int>(s / cycle), options_.legs - 1);
    const double on_leg = (along < 0.0 ? along : s - leg * cycle);
    const double radius = 0.5 * options_.spacing_m;
    const bool is_back = leg % 2 == 1;
    double north = on_leg, east = leg * options_.spacing_m, turned = 0.0;
    if (on_leg > options_.leg_m && leg + 1 < options_.legs) {
      turned = (on_leg - options_.leg_m) / radius;
      north = options_.leg_m + radius * std::sin(turned);
      east += radius * (1.0 - std::cos(turned));
    }
    if (is_back) north = options_.leg_m - north;
    const double yaw = is_back ? std::numbers::pi - turned : turned;
    const Quat attitude = ExpSo3(Vec3(0, 0, yaw + 0.03 * std::sin(0.5 * seconds))) *
                          ExpSo3(Vec3(0, 0.03 * std::sin(0.7 * seconds), 0)) *
                          ExpSo3(Vec3(0.03 * std::cos(0.9 * seconds), 0, 0));
    return {attitude.normalized(),
            Vec3(north + options_.spacing_m, east, MeanDepth() + 0.2 * std::sin(0.15 * seconds))};
  }
  Rigid3 TrueCamera(int frame) const { return (Body(TimeOf(frame)) * DownwardCamera()).Inverse(); }

  MapperOptions Mapper() const {
    MapperOptions mapper;
    if (options_.keyframe_every > 1) mapper.rhythm = Rhythm::kVideo;
    mapper.max_features = options_.max_features + 20;
    mapper.max_keyframes = 24;
    mapper.max_landmarks = 4000;
    mapper.nav_samples = 16384;  // all of it is fed at once
    mapper.window_landmarks = 1000;
    mapper.ransac_iterations = 200;
    mapper.min_inliers = 15;
    mapper.init_min_inliers = 30;
    mapper.pixel_sigma = options_.noise_px;
    mapper.heading_bias_sigma_deg = std::max(options_.heading_bias_deg, 0.1);
    mapper.velocity_scale_sigma = options_.velocity_scale;
    mapper.misalignment_sigma_deg = 0.01;  // the simulated log is mounted as it should be
    mapper.velocity_lever_sigma_m = 0.001;
    return mapper;
  }

  // All of navigation, before the first frame.
  void FeedNav(NavBuffer* buffer) const {
    Rng rng(options_.seed * 31 + 7);
    constexpr double kRad = std::numbers::pi / 180.0;
    double bias = options_.heading_bias_deg * kRad * rng.Gaussian();
    const double scale = options_.velocity_scale * rng.Gaussian();
    double frozen = 0.0;
    const auto noise = [&rng](double sigma) -> Vec3 {
      return sigma * Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian());
    };
    const auto within = [](double t, double from, double to) { return t >= from && t < to; };
    const int count = static_cast<int>(10.0 * (duration_s() + 4.0));
    for (int i = 0; i < count; ++i) {
      const double t = 0.1 * i - 2.0;
      const Rigid3 body = Body(t);
      bias += options_.heading_drift_deg * kRad * std::sqrt(0.1 / 600.0) * rng.Gaussian();
      NavSample sample;
      sample.utime = UsFromSeconds(kStart_s + t + options_.clock_offset_s);
      sample.Set(NavField::kAttitude);
      sample.sigma_attitude_rad =
          kRad * Vec3(options_.attitude_deg, options_.attitude_deg, options_.heading_deg);
      Vec3 error = noise(1.0).cwiseProduct(sample.sigma_attitude_rad);
      error.z() += bias;
      sample.ned_from_body = (ExpSo3(error) * body.rotation).normalized();
      const Vec3 velocity_noise = noise(options_.velocity_mps);
      if (i % 2 == 0 && options_.has_velocity &&
          !within(t, options_.no_velocity_from_s, options_.no_velocity_to_s)) {
        const double h = 1e-3;
        sample.Set(NavField::kVelocity);
        sample.sigma_velocity_mps = Vec3::Constant(options_.velocity_mps);
        sample.velocity_body_mps =
            (1.0 + scale) * (body.rotation.conjugate() *
                             ((Body(t + h).translation - Body(t - h).translation) / (2.0 * h))) +
            velocity_noise;
      }
      const double depth_noise = rng.Gaussian(0.0, options_.depth_sigma_m);
      if (i % 5 == 0 && options_.has_depth) {
        sample.Set(NavField::kDepth);
        const bool is_frozen = within(t, options_.frozen_depth_from_s, options_.frozen_depth_to_s);
        if (!is_frozen) frozen = body.translation.z() + Tide(t) + depth_noise;
        sample.depth_m = frozen;
        sample.sigma_depth_m = options_.depth_sigma_m;
      }
      const double altitude_noise = rng.Gaussian(0.0, options_.altitude_sigma_m);
      if (i % 5 == 0 && options_.has_altitude) {
        sample.Set(NavField::kAltitude);
        sample.altitude_m = options_.depth_m - body.translation.z() + altitude_noise;
        sample.sigma_altitude_m = options_.altitude_sigma_m;
      }
      const Vec3 fix_noise = noise(options_.fix_sigma_m);
      if (options_.fix_every_s > 0.0 &&
          i % std::max(1, static_cast<int>(10.0 * options_.fix_every_s)) == 0) {
        sample.Set(NavField::kPosition);
        sample.position_ned_m = body.translation + fix_noise;
        if (within(t, options_.wrong_fixes_from_s, options_.wrong_fixes_to_s))
          sample.position_ned_m += Vec3(20.0, -20.0, 0.0);
        sample.sigma_position_m = Vec3::Constant(options_.fix_sigma_m);
      }
      buffer->Insert(sample);
    }
  }

  FeatureFrame See(int frame) const {
    const double t = TimeOf(frame);
    const auto seed = static_cast<std::uint64_t>(frame) + 100000 * options_.seed;
    if (t >= options_.blind_from_s && t < options_.blind_to_s)
      return world_.SeeNothing(camera_, seed);
    return world_.See(camera_, TrueCamera(frame), seed);
  }

 private:
  double Turn() const { return 0.5 * std::numbers::pi * options_.spacing_m; }
  double MeanDepth() const { return options_.depth_m - options_.altitude_m; }
  static FeatureWorldOptions WorldOptions(const SimulatedMissionOptions& options) {
    FeatureWorldOptions world;
    world.seed = options.seed;
    world.length_m = options.leg_m + 2.0 * options.spacing_m;
    // The survey lies east of 0, the world about it.
    world.width_m = 2.0 * (options.legs * options.spacing_m + 3.0);
    world.depth_m = options.depth_m;
    world.noise_px = options.noise_px;
    world.clutter = 0.1;
    world.repeat_m = options.repeat_m;
    world.missed = options.missed;
    world.max_features = options.max_features;
    world.num_points =
        static_cast<int>(options.points_per_m2 * (world.length_m + 4.0) * world.width_m);
    return world;
  }

  SimulatedMissionOptions options_;
  AnyCamera camera_;
  FeatureWorld world_;
};

}  // namespace rsfm
