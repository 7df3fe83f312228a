#include "tools/simulator/nav_sensors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "rsfm/base/so3.h"

namespace rsfm::simulator {
namespace {

constexpr Utime kStart = 1'700'000'000'000'000;
constexpr double kDeg = 180.0 / std::numbers::pi;

struct Statistics {
  int count = 0;
  double mean = 0.0;
  double sigma = 0.0;
};

Statistics Of(const std::vector<double>& values) {
  Statistics s;
  s.count = static_cast<int>(values.size());
  for (const double v : values) s.mean += v / s.count;
  for (const double v : values) s.sigma += (v - s.mean) * (v - s.mean) / s.count;
  s.sigma = std::sqrt(s.sigma);
  return s;
}

class NavSensorsTest : public ::testing::Test {
 protected:
  NavSensorsTest() {
    LawnmowerOptions plan;
    plan.legs = 6;
    plan.leg_length_m = 40.0;  // ten minutes
    plan.turns = LawnmowerOptions::Turns::kRotate;
    trajectory_ = MakeLawnmower(plan, 20.0);
  }

  std::vector<NavMeasurement> Run(NavSource source) const {
    std::vector<NavMeasurement> wanted;
    for (const NavMeasurement& m : SimulateNavigation(
             *trajectory_, kStart, 0.0, [](const Vec3& place) { return 20.0 - place.z(); },
             options_)) {
      if (m.source == source) wanted.push_back(m);
    }
    return wanted;
  }
  BodyMotion Truth(const NavMeasurement& m) const {
    return trajectory_->MotionAt(SecondsFromUs(m.sample.utime - kStart));
  }

  std::unique_ptr<Trajectory> trajectory_;
  NavSensorOptions options_;
};

TEST_F(NavSensorsTest, DepthHasItsBiasAndNoise) {
  options_.depth.sigma_m = 0.02;
  options_.depth.bias_m = 0.15;
  std::vector<double> errors;
  for (const NavMeasurement& m : Run(NavSource::kDepth)) {
    ASSERT_TRUE(m.sample.Has(NavField::kDepth));
    EXPECT_EQ(m.sample.sigma_depth_m, 0.02);
    errors.push_back(m.sample.depth_m - Truth(m).world_from_body.translation.z());
  }
  const Statistics s = Of(errors);
  ASSERT_GT(s.count, 3000);
  EXPECT_NEAR(s.mean, 0.15, 0.002);
  EXPECT_NEAR(s.sigma, 0.02, 0.001);
}

TEST_F(NavSensorsTest, DvlHasItsScaleErrorAndNoiseAndItsLeverArm) {
  options_.dvl.sigma_mps = 0.01;
  options_.dvl.scale_error = 0.05;
  options_.dvl.dvl_in_body_m = Vec3(-1.0, 0.0, 0.3);
  std::vector<double> errors[3];
  double swing_seen = 0.0;
  for (const NavMeasurement& m : Run(NavSource::kDvl)) {
    const BodyMotion truth = Truth(m);
    const Vec3 swing = truth.rate_in_body_radps.cross(options_.dvl.dvl_in_body_m);
    const Vec3 at_dvl = truth.velocity_in_body_mps + swing;
    const Vec3 error = m.velocity_at_dvl_mps - 1.05 * at_dvl;
    for (int i = 0; i < 3; ++i) errors[i].push_back(error[i]);
    // The sample is the body's own velocity again.
    EXPECT_LT((m.velocity_at_dvl_mps - swing - m.sample.velocity_body_mps).norm(), 1e-9);
    swing_seen = std::max(swing_seen, swing.norm());
  }
  EXPECT_GT(swing_seen, 0.05);
  for (const auto& axis : errors) {
    const Statistics s = Of(axis);
    ASSERT_GT(s.count, 1500);
    EXPECT_NEAR(s.mean, 0.0, 0.001);
    EXPECT_NEAR(s.sigma, 0.01, 0.001);
  }
}

TEST_F(NavSensorsTest, AttitudeErrorsAreAboutTheWorldsAxes) {
  options_.attitude.heading_bias_sigma_deg = 0.0;
  options_.attitude.roll_pitch_sigma_deg = 0.2;
  options_.attitude.heading_sigma_deg = 0.8;
  std::vector<double> errors[3];
  for (const NavMeasurement& m : Run(NavSource::kAttitude)) {
    const Quat truth = Truth(m).world_from_body.rotation;
    const Vec3 error = LogSo3(m.sample.ned_from_body * truth.conjugate());
    for (int i = 0; i < 3; ++i) errors[i].push_back(error[i] * kDeg);
  }
  EXPECT_NEAR(Of(errors[0]).sigma, 0.2, 0.01);
  EXPECT_NEAR(Of(errors[1]).sigma, 0.2, 0.01);
  EXPECT_NEAR(Of(errors[2]).sigma, 0.8, 0.03);
  EXPECT_NEAR(Of(errors[2]).mean, 0.0, 0.05);
}

TEST_F(NavSensorsTest, HeadingDriftsSlowly) {
  options_.attitude.heading_bias_sigma_deg = 2.0;
  options_.attitude.heading_bias_time_s = 100.0;
  options_.attitude.heading_sigma_deg = 0.0;
  options_.attitude.roll_pitch_sigma_deg = 0.0;
  double last = 0.0, largest = 0.0, largest_step = 0.0;
  bool is_first = true;
  for (const NavMeasurement& m : Run(NavSource::kAttitude)) {
    const Quat truth = Truth(m).world_from_body.rotation;
    const double error = LogSo3(m.sample.ned_from_body * truth.conjugate()).z() * kDeg;
    if (!is_first) largest_step = std::max(largest_step, std::abs(error - last));
    is_first = false;
    last = error;
    largest = std::max(largest, std::abs(error));
  }
  EXPECT_GT(largest, 1.0);
  EXPECT_LT(largest_step, 0.4);  // 2 sqrt(2 * 0.05 s / 100 s) is one sigma of a step: 0.063
}

TEST_F(NavSensorsTest, DropoutsAndDelaysAreThoseAskedFor) {
  options_.depth.timing.dropout = 0.3;
  const auto full = static_cast<double>(trajectory_->duration_s() * options_.depth.timing.rate_hz);
  EXPECT_NEAR(static_cast<double>(Run(NavSource::kDepth).size()) / full, 0.7, 0.03);
  options_.depth.timing.dropout = 0.0;
  const auto on_time = Run(NavSource::kDepth);
  options_.depth.timing.delay_s = 0.25;
  const auto late = Run(NavSource::kDepth);
  ASSERT_EQ(on_time.size(), late.size());
  EXPECT_EQ(late[10].sample.utime - on_time[10].sample.utime, 250'000);
  EXPECT_EQ(late[10].sample.depth_m, on_time[10].sample.depth_m);
  options_.depth.timing.enabled = false;
  EXPECT_TRUE(Run(NavSource::kDepth).empty());
}

TEST_F(NavSensorsTest, OneSensorsOptionsLeaveTheOthersAlone) {
  const auto before = Run(NavSource::kDvl);
  options_.depth.timing.enabled = false;
  options_.attitude.timing.rate_hz = 3.0;
  const auto after = Run(NavSource::kDvl);
  ASSERT_EQ(before.size(), after.size());
  EXPECT_EQ(before.back().velocity_at_dvl_mps, after.back().velocity_at_dvl_mps);
}

TEST_F(NavSensorsTest, InstrumentsMeasureAtTheirOwnPlaces) {
  const Vec3 arm(1.0, -0.5, 0.8);
  options_.depth.depth_in_body_m = options_.dvl.dvl_in_body_m = arm;
  options_.position.position_in_body_m = arm;
  options_.position.timing.enabled = true;
  options_.position.horizontal_sigma_m = options_.position.vertical_sigma_m = 0.0;
  options_.depth.sigma_m = options_.dvl.altitude_sigma_m = 0.0;
  for (const NavMeasurement& m : Run(NavSource::kDepth)) {
    const Rigid3 truth = Truth(m).world_from_body;
    ASSERT_NEAR(m.depth_at_sensor_m, (truth * arm).z(), 1e-9);
    ASSERT_NEAR(m.sample.depth_m, truth.translation.z(), 1e-9);
  }
  for (const NavMeasurement& m : Run(NavSource::kPosition)) {
    const Rigid3 truth = Truth(m).world_from_body;
    ASSERT_LT((m.position_of_transponder_ned_m - truth * arm).norm(), 1e-6);
    ASSERT_LT((m.sample.position_ned_m - truth.translation).norm(), 1e-6);
  }
  for (const NavMeasurement& m : Run(NavSource::kDvl)) {  // over a floor at 20 m
    const Rigid3 truth = Truth(m).world_from_body;
    ASSERT_NEAR(m.altitude_at_dvl_m, 20.0 - (truth * arm).z(), 1e-6);
    ASSERT_NEAR(m.sample.altitude_m, 20.0 - truth.translation.z(), 1e-6);
  }
}

TEST_F(NavSensorsTest, BiasesAndMisalignmentsAreThoseAskedFor) {
  options_.attitude = {};
  options_.attitude.heading_bias_sigma_deg = options_.attitude.heading_sigma_deg = 0.0;
  options_.attitude.roll_pitch_sigma_deg = 0.0;
  options_.attitude.roll_bias_deg = 1.0;
  options_.attitude.pitch_bias_deg = -2.0;
  for (const NavMeasurement& m : Run(NavSource::kAttitude)) {
    const Vec3 error =
        kDeg * LogSo3(Truth(m).world_from_body.rotation.conjugate() * m.sample.ned_from_body);
    ASSERT_LT((error - Vec3(1.0, -2.0, 0.0)).norm(), 1e-6);
  }
  options_.dvl.sigma_mps = options_.dvl.scale_error = 0.0;
  options_.dvl.heading_misalignment_deg = 90.0;
  options_.dvl.bias_mps = Vec3(0.0, 0.0, 0.01);
  for (const NavMeasurement& m : Run(NavSource::kDvl)) {
    const Vec3 v = Truth(m).velocity_in_body_mps;
    ASSERT_LT((m.velocity_at_dvl_mps - Vec3(-v.y(), v.x(), v.z() + 0.01)).norm(), 1e-9);
  }
}

TEST_F(NavSensorsTest, PositionsDriftSlowly) {
  options_.position.timing = {true, 1.0, 0.0, 0.0};
  options_.position.horizontal_sigma_m = options_.position.vertical_sigma_m = 0.0;
  options_.position.drift_sigma_m = 2.0;
  options_.position.drift_time_s = 100.0;
  Vec3 last = Vec3::Zero();
  double largest = 0.0, largest_step = 0.0;
  bool is_first = true;
  for (const NavMeasurement& m : Run(NavSource::kPosition)) {
    const Vec3 error = m.sample.position_ned_m - Truth(m).world_from_body.translation;
    EXPECT_NEAR(error.z(), 0.0, 1e-9);
    EXPECT_NEAR(m.sample.sigma_position_m.x(), 2.0, 1e-9);
    largest = std::max(largest, error.norm());
    if (!is_first) largest_step = std::max(largest_step, (error - last).norm());
    is_first = false;
    last = error;
  }
  EXPECT_GT(largest, 1.5);
  EXPECT_LT(largest_step, 1.6);  // 2 sqrt(2 * 1 s / 100 s) is one sigma of a step: 0.28
}

TEST_F(NavSensorsTest, MergingUnitesWhatWasMeasuredTogether) {
  const auto measurements = SimulateNavigation(
      *trajectory_, kStart, 0.0, [](const Vec3&) { return 1.0; }, options_);
  const std::vector<NavSample> samples = MergeSamples(measurements);
  EXPECT_LT(samples.size(), measurements.size());
  for (std::size_t i = 1; i < samples.size(); ++i) {
    ASSERT_LT(samples[i - 1].utime, samples[i].utime);
  }
  EXPECT_TRUE(samples[0].Has(NavField::kAttitude));
  EXPECT_TRUE(samples[0].Has(NavField::kVelocity));
  EXPECT_TRUE(samples[0].Has(NavField::kDepth));
  EXPECT_FALSE(samples[0].Has(NavField::kPosition));
}

}  // namespace
}  // namespace rsfm::simulator
