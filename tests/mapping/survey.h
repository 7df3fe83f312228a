// A survey flown by the mapper, for its tests: what the front end would hand over, and navigation.
#pragma once

#include <gtest/gtest.h>

#include <memory>

#include "rsfm/mapping/incremental_mapper.h"
#include "tests/mapping/feature_world.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {

inline constexpr double kFrameRate = 1.0;  // strobed stills: 0.3 m apart, two thirds of overlap

inline MapperOptions TestOptions() {
  MapperOptions options;
  options.max_features = 700;
  options.max_keyframes = 48;
  options.max_landmarks = 6000;
  options.ransac_iterations = 300;
  return options;
}

// A survey flown by the mapper.
class SurveyFlight {
 public:
  SurveyFlight(TestPort port, const MapperOptions& options, const FeatureWorldOptions& world = {})
      : camera_(TestCamera(port)), world_(world) {
    mapper_ = IncrementalMapper::Create(options, camera_, DownwardCamera()).value();
  }

  IncrementalMapper& mapper() { return *mapper_; }

  // Attitude at 10 Hz, velocity at 5 Hz, depth at 2 Hz, with typical noise.
  // From one time to another the log is that much too fast.
  void FeedNav(double end_s, double begin_s = -1.0, double off_mps = 0.0, double off_from_s = 0.0,
               double off_to_s = 0.0) {
    Feed(end_s, begin_s, true, off_mps, off_from_s, off_to_s);
  }
  // The same without a log: the scale is the altimeter's, above the flat bottom's mean.
  void FeedNavWithoutLog(double end_s) { Feed(end_s, -1.0, false, 0.0, 0.0, 0.0); }

  Rigid3 TrueCamera(int frame) const {
    return (SurveyBody(frame / kFrameRate) * DownwardCamera()).Inverse();
  }

  StepReport Fly(int frame, bool blind = false) {
    const FeatureFrame seen =
        blind ? world_.SeeNothing(camera_, frame) : world_.See(camera_, TrueCamera(frame), frame);
    const FrameObservations view = seen.View(UsFromSeconds(frame / kFrameRate + 100.0));
    MallocTrap trap;
    const auto report = mapper_->Step(view);
    heap_calls_ += trap.count();
    EXPECT_TRUE(report.has_value());
    return report.value_or(StepReport{});
  }
  std::size_t heap_calls() const { return heap_calls_; }

 private:
  void Feed(double end_s, double begin_s, bool has_log, double off_mps, double off_from_s,
            double off_to_s) {
    Rng rng(99);
    for (int i = 0; i <= static_cast<int>(10 * end_s) + 20; ++i) {
      const double t = 0.1 * i - 1.0;
      if (t < begin_s) continue;
      const Rigid3 body = SurveyBody(t);
      NavSample sample;
      sample.utime = UsFromSeconds(t + 100.0);
      sample.Set(NavField::kAttitude);
      sample.sigma_attitude_rad = Vec3(0.002, 0.002, 0.005);
      sample.ned_from_body =
          ExpSo3(0.002 * Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian())) * body.rotation;
      if (has_log && i % 2 == 0) {
        sample.Set(NavField::kVelocity);
        const double h = 1e-3;
        const Vec3 velocity_ned =
            (SurveyBody(t + h).translation - SurveyBody(t - h).translation) / (2.0 * h);
        sample.sigma_velocity_mps = Vec3::Constant(0.005);
        sample.velocity_body_mps = body.rotation.conjugate() * velocity_ned +
                                   0.005 * Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian());
        if (t > off_from_s && t < off_to_s) sample.velocity_body_mps.x() += off_mps;
      }
      if (i % 5 == 0) {
        sample.Set(NavField::kDepth);
        sample.depth_m = body.translation.z() + rng.Gaussian(0.0, 0.01);
        sample.sigma_depth_m = 0.01;
        if (!has_log) {
          sample.Set(NavField::kAltitude);
          sample.altitude_m = FeatureWorldOptions().depth_m - body.translation.z();
          sample.sigma_altitude_m = 0.02;
        }
      }
      mapper_->nav().buffer().Insert(sample);
    }
  }

  AnyCamera camera_;
  FeatureWorld world_;
  std::unique_ptr<IncrementalMapper> mapper_;
  std::size_t heap_calls_ = 0;
};

}  // namespace rsfm
