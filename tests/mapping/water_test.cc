// The camera's index of water follows what a CTD measures, in steps, without heap, and the map is
// the better for it.
#include <gtest/gtest.h>

#include "rsfm/mapping/incremental_mapper.h"
#include "rsfm/refraction/sea_water.h"
#include "tests/mapping/feature_world.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

AnyCamera CameraIn(double index_water, TestPort port = TestPort::kFlat) {
  CameraConfig config = TestCamera(port).config();
  config.port.index_water = index_water;
  return AnyCamera::Create(config).value();
}

MapperOptions Options() {
  MapperOptions options;
  options.max_features = 700;
  options.max_keyframes = 24;
  options.max_landmarks = 4000;
  options.ransac_iterations = 300;
  return options;
}

std::unique_ptr<IncrementalMapper> MakeMapper(const MapperOptions& options,
                                              const AnyCamera& camera) {
  return IncrementalMapper::Create(options, camera, DownwardCamera()).value();
}

void Measure(double seconds, double temperature_c, double salinity_psu, double depth_m,
             IncrementalMapper* mapper) {
  NavSample sample;
  sample.utime = UsFromSeconds(seconds);
  sample.Set(NavField::kWater);
  sample.temperature_c = temperature_c;
  sample.salinity_psu = salinity_psu;
  if (depth_m >= 0.0) {
    sample.Set(NavField::kDepth);
    sample.depth_m = depth_m;
  }
  mapper->nav().buffer().Insert(sample);
}

// A frame without features: nothing but its time.
double IndexAt(double seconds, IncrementalMapper* mapper) {
  const MallocTrap trap;
  const auto report =
      mapper->Step({UsFromSeconds(seconds), {}, {nullptr, 0, DescriptorType::kSift}});
  EXPECT_TRUE(report.has_value());
  EXPECT_EQ(trap.count(), 0u);
  return mapper->water().index;
}

TEST(WaterTest, TheIndexFollowsTheCtdInSteps) {
  const auto mapper = MakeMapper(Options(), CameraIn(1.334));
  EXPECT_EQ(IndexAt(1.0, mapper.get()), 1.334);
  EXPECT_FALSE(mapper->water().is_measured);
  Measure(2.0, 8.0, 35.0, -1.0, mapper.get());
  EXPECT_EQ(IndexAt(1.5, mapper.get()), 1.334);  // not before it was measured
  const double at_surface = *SeaWaterIndex({8.0, 35.0, 0.0, 530.0});
  EXPECT_EQ(IndexAt(2.0, mapper.get()), at_surface);
  EXPECT_TRUE(mapper->water().is_measured);
  EXPECT_EQ(mapper->water().temperature_c, 8.0);
  // Less than a step: 0.1 degrees. Then the sum of two that are more.
  Measure(3.0, 8.1, 35.0, -1.0, mapper.get());
  EXPECT_EQ(IndexAt(3.0, mapper.get()), at_surface);
  Measure(4.0, 9.0, 35.0, -1.0, mapper.get());
  EXPECT_EQ(IndexAt(4.0, mapper.get()), *SeaWaterIndex({9.0, 35.0, 0.0, 530.0}));
  // Pressure, an hour after: what was measured last still holds.
  Measure(5.0, 9.0, 35.0, 400.0, mapper.get());
  EXPECT_EQ(IndexAt(3605.0, mapper.get()), *SeaWaterIndex({9.0, 35.0, 400.0, 530.0}));
  EXPECT_EQ(mapper->water().depth_m, 400.0);
  // Outside the sea: not believed.
  Measure(3606.0, 90.0, 35.0, 400.0, mapper.get());
  EXPECT_EQ(IndexAt(3607.0, mapper.get()), *SeaWaterIndex({9.0, 35.0, 400.0, 530.0}));
}

TEST(WaterTest, TheOptionsDecide) {
  MapperOptions fixed = Options();
  fixed.water_index_step = 0.0;
  const auto deaf = MakeMapper(fixed, CameraIn(1.334));
  Measure(1.0, 8.0, 35.0, 100.0, deaf.get());
  EXPECT_EQ(IndexAt(2.0, deaf.get()), 1.334);

  MapperOptions blue = Options();
  blue.light_wavelength_nm = 450.0;
  const auto in_blue = MakeMapper(blue, CameraIn(1.334));
  Measure(1.0, 8.0, 35.0, 100.0, in_blue.get());
  EXPECT_EQ(IndexAt(2.0, in_blue.get()), *SeaWaterIndex({8.0, 35.0, 100.0, 450.0}));

  const auto no_port = MakeMapper(Options(), CameraIn(1.334, TestPort::kNone));
  Measure(1.0, 8.0, 35.0, 100.0, no_port.get());
  EXPECT_EQ(IndexAt(2.0, no_port.get()), 1.334);
}

struct Flight {
  std::vector<StepReport> reports;
  double mean_depth_m = 0.0;  // of the landmarks
  std::size_t heap_calls = 0;
};

// A survey in water of `true_index` with a rig that says `rig_index`.
Flight Fly(double true_index, double rig_index, bool with_ctd) {
  const auto mapper = MakeMapper(Options(), CameraIn(rig_index));
  const AnyCamera camera = CameraIn(true_index);
  const FeatureWorld world{FeatureWorldOptions{}};
  for (int i = 0; i <= 240; ++i) {
    const double t = 0.1 * i - 1.0;
    NavSample sample;
    sample.utime = UsFromSeconds(t + 100.0);
    sample.Set(NavField::kAttitude);
    sample.Set(NavField::kVelocity);
    sample.ned_from_body = SurveyBody(t).rotation;
    sample.velocity_body_mps =
        sample.ned_from_body.conjugate() *
        (SurveyBody(t + 1e-3).translation - SurveyBody(t - 1e-3).translation) / 2e-3;
    mapper->nav().buffer().Insert(sample);
  }
  if (with_ctd) Measure(99.0, 4.0, 35.0, -1.0, mapper.get());
  Flight flight;
  for (int frame = 0; frame < 12; ++frame) {
    const FeatureFrame seen =
        world.See(camera, (SurveyBody(frame) * DownwardCamera()).Inverse(), frame);
    const FrameObservations view = seen.View(UsFromSeconds(frame + 100.0));
    const MallocTrap trap;
    const auto report = mapper->Step(view);
    flight.heap_calls += trap.count();
    EXPECT_TRUE(report.has_value());
    flight.reports.push_back(report.value_or(StepReport()));
  }
  int count = 0;
  mapper->map().landmarks().ForEach([&](SlotId, const Landmark& landmark) {
    flight.mean_depth_m += landmark.point_in_world.z();
    ++count;
  });
  EXPECT_GT(count, 200);
  flight.mean_depth_m /= std::max(count, 1);
  return flight;
}

TEST(WaterTest, AMapperThatFollowsMapsAsOneThatKnew) {
  const double true_index = *SeaWaterIndex({4.0, 35.0, 0.0, 530.0});
  const Flight knew = Fly(true_index, true_index, false);
  const Flight followed = Fly(true_index, 1.325, true);
  const Flight wrong = Fly(true_index, 1.325, false);
  ASSERT_EQ(knew.reports.size(), followed.reports.size());
  int placed = 0;
  for (std::size_t i = 0; i < knew.reports.size(); ++i) {
    placed += knew.reports[i].has_pose ? 1 : 0;
    ASSERT_EQ(knew.reports[i].has_pose, followed.reports[i].has_pose);
    const Rigid3 &a = knew.reports[i].camera_from_world, &b = followed.reports[i].camera_from_world;
    EXPECT_EQ(a.translation, b.translation);  // bit for bit
    EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
  }
  EXPECT_GE(placed, 10);
  EXPECT_EQ(followed.heap_calls, 0u);
  EXPECT_EQ(knew.mean_depth_m, followed.mean_depth_m);
  // An index that is 1 % too low puts the seabed, 2 m away, up to 1 % too near; where navigation
  // holds the depths, less.
  EXPECT_GT(std::abs(wrong.mean_depth_m - knew.mean_depth_m), 0.005);
}

}  // namespace
}  // namespace rsfm
