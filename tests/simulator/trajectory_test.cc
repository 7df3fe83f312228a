#include "tools/simulator/trajectory.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "rsfm/base/so3.h"

namespace rsfm::simulator {
namespace {

LawnmowerOptions Steady() {
  LawnmowerOptions options;
  options.roll_deg = options.pitch_deg = options.yaw_deg = 0.0;
  options.sway_m = options.heave_m = 0.0;
  return options;
}

TEST(LawnmowerTest, LegsLieWhereTheyWereAskedFor) {
  LawnmowerOptions options = Steady();
  options.legs = 3;
  options.leg_length_m = 6.0;
  options.leg_spacing_m = 1.5;
  options.altitude_m = 2.0;
  const auto trajectory = MakeLawnmower(options, 20.0);
  const Vec3 start = trajectory->WorldFromBody(0.0).translation;
  const Vec3 end = trajectory->WorldFromBody(trajectory->duration_s()).translation;
  EXPECT_NEAR((start - Vec3(-3.0, -1.5, 18.0)).norm(), 0.0, 1e-9);
  EXPECT_NEAR((end - Vec3(3.0, 1.5, 18.0)).norm(), 0.0, 1e-6);
  // A heading of 90 degrees turns the whole plan about the origin.
  options.heading_deg = 90.0;
  const Rigid3 turned = MakeLawnmower(options, 20.0)->WorldFromBody(0.0);
  EXPECT_NEAR((turned.translation - Vec3(1.5, -3.0, 18.0)).norm(), 0.0, 1e-9);
  EXPECT_NEAR((turned.rotation * Vec3::UnitX() - Vec3::UnitY()).norm(), 0.0, 1e-9);
}

TEST(LawnmowerTest, KeepsItsLimitsOfSpeedAccelerationAndTurnRate) {
  LawnmowerOptions options = Steady();
  options.turns = LawnmowerOptions::Turns::kRotate;
  const auto trajectory = MakeLawnmower(options, 20.0);
  double top_speed = 0.0, top_rate = 0.0, top_change = 0.0, last_speed = -1.0;
  constexpr double kStep = 0.05;
  for (double t = 0.1; t < trajectory->duration_s() - 0.1; t += kStep) {
    const BodyMotion motion = trajectory->MotionAt(t);
    const double speed = motion.velocity_in_body_mps.norm();
    // The bow follows the path: no drift sideways.
    EXPECT_NEAR(motion.velocity_in_body_mps.y(), 0.0, 1e-3);
    if (last_speed >= 0.0) top_change = std::max(top_change, std::abs(speed - last_speed) / kStep);
    last_speed = speed;
    top_speed = std::max(top_speed, speed);
    top_rate = std::max(top_rate, motion.rate_in_body_radps.norm());
  }
  EXPECT_NEAR(top_speed, options.speed_mps, 1e-3);
  EXPECT_LT(top_rate, 1.02 * options.max_turn_rate_dps * std::numbers::pi / 180.0);
  EXPECT_GT(top_rate, 0.9 * options.max_turn_rate_dps * std::numbers::pi / 180.0);
  EXPECT_LT(top_change, 1.05 * options.max_acceleration_mps2);
}

TEST(LawnmowerTest, StrafingKeepsTheHeading) {
  const auto trajectory = MakeLawnmower(Steady(), 20.0);
  for (double t = 0.0; t < trajectory->duration_s(); t += 0.5) {
    EXPECT_LT(AngleBetween(trajectory->WorldFromBody(t).rotation, Quat::Identity()), 1e-9);
  }
}

TEST(LawnmowerTest, MotionIsTheDerivativeOfThePose) {
  LawnmowerOptions options;
  options.turns = LawnmowerOptions::Turns::kRotate;
  const auto trajectory = MakeLawnmower(options, 20.0);
  // Velocity and rate integrate to the pose: midpoint rule over the whole path.
  constexpr double kStep = 0.01;
  Rigid3 world_from_body = trajectory->WorldFromBody(0.0);
  double t = 0.0;
  for (; t + kStep < trajectory->duration_s(); t += kStep) {
    const BodyMotion motion = trajectory->MotionAt(t + 0.5 * kStep);
    world_from_body.translation +=
        kStep * (motion.world_from_body.rotation * motion.velocity_in_body_mps);
    world_from_body.rotation =
        (world_from_body.rotation * ExpSo3(kStep * motion.rate_in_body_radps)).normalized();
  }
  const Rigid3 truth = trajectory->WorldFromBody(t);
  EXPECT_LT((world_from_body.translation - truth.translation).norm(), 5e-3);
  EXPECT_LT(AngleBetween(world_from_body.rotation, truth.rotation), 5e-3);
}

TEST(LawnmowerTest, SeedDecidesTheSwayAlone) {
  LawnmowerOptions options;
  const auto a = MakeLawnmower(options, 20.0);
  const auto same = MakeLawnmower(options, 20.0);
  options.seed = 2;
  const auto other = MakeLawnmower(options, 20.0);
  EXPECT_EQ(a->duration_s(), other->duration_s());
  const Rigid3 pose = a->WorldFromBody(11.0);
  EXPECT_EQ(pose.translation, same->WorldFromBody(11.0).translation);
  EXPECT_NE(pose.translation, other->WorldFromBody(11.0).translation);
  EXPECT_LT((pose.translation - other->WorldFromBody(11.0).translation).norm(), 1.0);
}

TEST(LawnmowerTest, ASmallerSurveyKeepsSpacingAndSpeed) {
  LawnmowerOptions whole = Steady();
  whole.legs = 20;
  whole.leg_length_m = 24.0;
  const double rate_hz = 1.0;
  const auto count = [&](const LawnmowerOptions& o) {
    return static_cast<int>(MakeLawnmower(o, 20.0)->duration_s() * rate_hz) + 1;
  };
  const int all = count(whole);
  for (const int images : {2, 30, 300, all / 2, all - 1}) {
    const LawnmowerOptions part = FitToImages(whole, images, rate_hz);
    EXPECT_GE(count(part), images);
    EXPECT_LE(count(part), images + 2);
    EXPECT_EQ(part.leg_spacing_m, whole.leg_spacing_m);
    EXPECT_EQ(part.speed_mps, whole.speed_mps);
    EXPECT_LE(part.leg_length_m, whole.leg_length_m);
    EXPECT_LE(part.legs, whole.legs);
    if (images < 300) continue;
    // About as long as wide, as the whole is.
    EXPECT_LT(part.leg_length_m / (part.legs * part.leg_spacing_m), 2.0);
    EXPECT_GT(part.leg_length_m / (part.legs * part.leg_spacing_m), 0.5);
  }
  EXPECT_EQ(FitToImages(whole, all + 5, rate_hz).legs, whole.legs);
}

TEST(OrbitTest, TheCameraLooksInwardsAndStaysInItsRings) {
  OrbitOptions options;
  const Rigid3 body_from_camera(ExpSo3(Vec3(0.3, -0.2, 0.9)), Vec3(0.2, 0.1, -0.1));
  const auto trajectory = MakeOrbit(options, body_from_camera, 1.0, 2.0);
  EXPECT_NEAR(trajectory->duration_s(), 105 / 2.0, 1e-9);
  Vec3 last = Vec3::Zero();
  for (int i = 0; i < options.images; ++i) {
    const Rigid3 world_from_camera = trajectory->WorldFromBody(i / 2.0) * body_from_camera;
    const Vec3& place = world_from_camera.translation;
    const Vec3 axis = world_from_camera.rotation * Vec3::UnitZ();
    EXPECT_LE(std::abs(place.x()), options.radius_north_m + 1e-9);
    EXPECT_LE(std::abs(place.y()), options.radius_east_m + 1e-9);
    EXPECT_LT(place.z(), 1.0 - options.bottom_height_m + options.bob_m + 1e-9);
    EXPECT_GT(axis.z(), 0.3);  // down
    // Towards the far side, and level but for the roll.
    EXPECT_LT(axis.head<2>().dot(place.head<2>()), 0.0);
    const Vec3 right = world_from_camera.rotation * Vec3::UnitX();
    EXPECT_LT(std::abs(right.z()), std::sin(options.roll_deg * std::numbers::pi / 180.0) + 1e-9);
    if (i > 0) {
      EXPECT_LT((place - last).norm(), 0.11);
    }
    last = place;
  }
}

}  // namespace
}  // namespace rsfm::simulator
