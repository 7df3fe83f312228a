// A mission without end: round and round over the same ground, with capacities that are full after
// the first rounds and outages now and then. For the soak in CI and the long one by hand.
#pragma once

#include <malloc.h>

#include <chrono>
#include <memory>
#include <numbers>
#include <vector>

#include "rsfm/mapping/incremental_mapper.h"
#include "tests/mapping/feature_world.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {

// What the process has from the heap now, by the C library's own books; 0 in sanitizer builds.
inline std::size_t HeapBytesNow() {
  if (!MallocTrap::IsActive()) return 0;
  const struct mallinfo2 info = ::mallinfo2();
  return info.uordblks + info.hblkhd;
}

class SoakFlight {
 public:
  static constexpr double kFrameRate = 2.0, kSpeed_mps = 0.5, kRadius_m = 4.0;
  static constexpr int kFeatures = 90;

  static MapperOptions Options() {
    MapperOptions options;
    options.max_features = kFeatures + 10;
    options.max_keyframes = 16;
    options.max_landmarks = 900;
    options.nav_samples = 512;
    options.window_keyframes = 5;
    options.window_landmarks = 400;
    options.window_iterations = 5;
    options.ransac_iterations = 100;
    options.min_inliers = 15;
    options.init_min_inliers = 30;
    options.pixel_sigma = 0.5;
    options.max_places = 24;      // of a round
    options.max_way_nodes = 128;  // a little more than a round
    options.max_loops = 8;
    return options;
  }

  SoakFlight() : camera_(TestCamera(TestPort::kFlat)), world_(World()), nav_rng_(5) {
    mapper_ = IncrementalMapper::Create(Options(), camera_, DownwardCamera()).value();
  }

  static Rigid3 Body(double seconds) {
    const double angle = kSpeed_mps * seconds / kRadius_m;
    const Quat attitude = ExpSo3(Vec3(0, 0, angle + 0.5 * std::numbers::pi)) *
                          ExpSo3(Vec3(0, 0.03 * std::sin(0.7 * seconds), 0));
    return {attitude.normalized(),
            Vec3(kRadius_m * std::cos(angle) + 5.0, kRadius_m * std::sin(angle), 7.0)};
  }
  static bool IsBlind(int frame) { return frame % 500 >= 490; }

  // Navigation up to the frame, then the frame.
  StepReport Fly(int frame) {
    const double seconds = frame / kFrameRate;
    for (; 0.1 * nav_count_ <= seconds + 0.3; ++nav_count_) AddNav(0.1 * nav_count_);
    const auto seed = static_cast<std::uint64_t>(frame);
    const FeatureFrame seen =
        IsBlind(frame) ? world_.SeeNothing(camera_, seed)
                       : world_.See(camera_, (Body(seconds) * DownwardCamera()).Inverse(), seed);
    const FrameObservations view = seen.View(UsFromSeconds(1000.0 + seconds));
    const auto start = std::chrono::steady_clock::now();
    MallocTrap trap;
    const auto report = mapper_->Step(view);
    heap_calls_ += trap.count();
    step_ms_ =
        1e3 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report.value_or(StepReport{});
  }

  const IncrementalMapper& mapper() const { return *mapper_; }
  std::size_t heap_calls() const { return heap_calls_; }  // in Step
  double step_ms() const { return step_ms_; }             // of the last

 private:
  static FeatureWorldOptions World() {
    FeatureWorldOptions world;
    world.length_m = 10.0;
    world.width_m = 14.0;
    world.num_points = 2400;
    world.clutter = 0.1;
    world.max_features = kFeatures;
    return world;
  }
  void AddNav(double seconds) {
    const Rigid3 body = Body(seconds);
    NavSample sample;
    sample.utime = UsFromSeconds(1000.0 + seconds);
    sample.Set(NavField::kAttitude);
    sample.sigma_attitude_rad = Vec3(0.002, 0.002, 0.009);
    sample.ned_from_body = (ExpSo3(Vec3(0.002 * nav_rng_.Gaussian(), 0.002 * nav_rng_.Gaussian(),
                                        0.009 * nav_rng_.Gaussian())) *
                            body.rotation)
                               .normalized();
    if (nav_count_ % 2 == 0) {
      const double h = 1e-3;
      sample.Set(NavField::kVelocity);
      sample.sigma_velocity_mps = Vec3::Constant(0.01);
      sample.velocity_body_mps =
          body.rotation.conjugate() *
              ((Body(seconds + h).translation - Body(seconds - h).translation) / (2.0 * h)) +
          0.01 * Vec3(nav_rng_.Gaussian(), nav_rng_.Gaussian(), nav_rng_.Gaussian());
    }
    if (nav_count_ % 5 == 0) {
      sample.Set(NavField::kDepth);
      sample.depth_m = body.translation.z() + nav_rng_.Gaussian(0.0, 0.02);
      sample.sigma_depth_m = 0.02;
    }
    mapper_->nav().buffer().Insert(sample);
  }

  AnyCamera camera_;
  FeatureWorld world_;
  Rng nav_rng_;
  std::unique_ptr<IncrementalMapper> mapper_;
  int nav_count_ = 0;
  std::size_t heap_calls_ = 0;
  double step_ms_ = 0.0;
};

}  // namespace rsfm
