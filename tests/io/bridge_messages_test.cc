// What bridges hand over: frames by what the instrument says, every mark of an invalid value, and
// through NavConverter what the daemon makes of it.
#include "rsfm/io/bridge_messages.h"

#include <gtest/gtest.h>

#include <cmath>

#include "rsfm/io/nav_messages.h"
#include "rsfm/io/tables.h"

namespace rsfm {
namespace {

constexpr std::uint8_t kBeam = 0x00, kInstrument = 0x40, kShip = 0x80, kEarth = 0xc0, kTilts = 0x20;

Vec3 Velocity(const dvl_t& message) { return Vec3::Map(message.velocity_body_mps); }
bool HasVelocity(const dvl_t& message) { return (message.valid & dvl_t::VALID_VELOCITY) != 0; }
bool HasAltitude(const dvl_t& message) { return (message.valid & dvl_t::VALID_ALTITUDE) != 0; }

// Beam 3 ahead, looking down: x to starboard, y ahead, z up.
const Quat kBodyFromRdi(Mat3{{0, 1, 0}, {1, 0, 0}, {0, 0, -1}});

RdiPing Ping(std::uint8_t system_config, const Vec3& velocity) {
  RdiPing ping;
  ping.utime = 1'000'000;
  ping.system_config = system_config;
  ping.bottom_velocity_mps = {velocity.x(), velocity.y(), velocity.z(), 0.01};
  ping.altitude_m = 3.0;
  return ping;
}

// The same motion as each frame has it.
TEST(BridgeTest, RdisFrameIsWhatItsBitsSay) {
  const Quat ned_from_body = QuatFromRollPitchHeading(0.1, -0.2, 2.0);
  const Vec3 in_body(1.0, 0.2, -0.1);
  const auto swap = [](const Vec3& v) { return Vec3(v.y(), v.x(), -v.z()); };
  const Vec3 in_ned = ned_from_body * in_body;
  const Vec3 level = QuatFromRollPitchHeading(0.0, 0.0, 2.0).conjugate() * in_ned;
  for (const auto& [config, velocity] : {std::pair<int, Vec3>{kInstrument, swap(in_body)},
                                         {kShip, swap(in_body)},
                                         {kShip | kTilts, swap(level)},
                                         {kEarth, swap(in_ned)},
                                         {kEarth | kTilts, swap(in_ned)}}) {
    dvl_t message;
    ASSERT_TRUE(DvlFromRdi(Ping(static_cast<std::uint8_t>(config | 0x03), velocity), kBodyFromRdi,
                           ned_from_body, &message));
    ASSERT_TRUE(HasVelocity(message)) << config;
    EXPECT_LT((Velocity(message) - in_body).norm(), 1e-12) << config;
    EXPECT_EQ(message.utime, 1'000'000);
    EXPECT_EQ(message.altitude_m, 3.0);
  }
}

TEST(BridgeTest, RdisFrameIsNeverGuessed) {
  for (const std::uint8_t config : {kBeam, kEarth, static_cast<std::uint8_t>(kShip | kTilts)}) {
    dvl_t message;
    EXPECT_TRUE(DvlFromRdi(Ping(config, Vec3(1, 0, 0)), kBodyFromRdi, std::nullopt, &message));
    EXPECT_FALSE(HasVelocity(message)) << int{config};
    EXPECT_TRUE(HasAltitude(message));
  }
}

TEST(BridgeTest, RdisMarksForNothingAreRefused) {
  dvl_t message;
  for (int axis = 0; axis < 3; ++axis) {
    RdiPing ping = Ping(kInstrument, Vec3(1, 0, 0));
    ping.bottom_velocity_mps[static_cast<std::size_t>(axis)] = -32.768;
    EXPECT_TRUE(DvlFromRdi(ping, kBodyFromRdi, std::nullopt, &message));
    EXPECT_FALSE(HasVelocity(message));
  }
  RdiPing ping = Ping(kInstrument, Vec3(std::nan(""), 0, 0));
  ping.altitude_m = 0.0;
  EXPECT_FALSE(DvlFromRdi(ping, kBodyFromRdi, std::nullopt, &message));
  EXPECT_EQ(message.valid, 0);
  NavConverter converter{Rig()};
  NavSample sample;
  EXPECT_FALSE(converter.Convert(message, &sample));
}

TEST(BridgeTest, RdiTellsTheWater) {
  RdiPing ping = Ping(kInstrument, Vec3::Zero());
  ping.temperature_c = 8.0;
  ping.salinity_psu = 35.0;
  NavConverter converter{Rig()};
  NavSample sample;
  ASSERT_TRUE(converter.Convert(CtdFromRdi(ping), &sample));
  EXPECT_TRUE(sample.Has(NavField::kWater));
  EXPECT_EQ(sample.temperature_c, 8.0);
  EXPECT_EQ(sample.salinity_psu, 35.0);
}

WaterLinkedReport A50() {
  WaterLinkedReport report;
  report.utime = 7;
  report.velocity_mps = Vec3(0.5, -0.1, 0.02);
  report.fom_mps = 0.003;
  report.altitude_m = 1.5;
  report.is_velocity_valid = true;
  for (int i = 0; i < 4; ++i)  // in another order than that of their ids
    report.beams[static_cast<std::size_t>(i)] = {3 - i, 0.1 * (3 - i), 1.0 + (3 - i), true};
  return report;
}

TEST(BridgeTest, WaterLinked) {
  const Quat turned_right = QuatFromRollPitchHeading(0.0, 0.0, M_PI / 2);  // its x is our right
  WaterLinkedReport report = A50();
  report.beams[1].is_valid = false;  // id 2
  report.beams[1].distance_m = -1.0;
  dvl_t message;
  ASSERT_TRUE(DvlFromWaterLinked(report, turned_right, &message));
  EXPECT_LT((Velocity(message) - Vec3(0.1, 0.5, 0.02)).norm(), 1e-12);
  EXPECT_NEAR(message.velocity_cov_m2ps2[0], 9e-6, 1e-18);
  EXPECT_NEAR(message.velocity_cov_m2ps2[1], 0.0, 1e-18);
  EXPECT_EQ(message.beam_range_m, (std::vector<double>{1.0, 2.0, 0.0, 4.0}));
  EXPECT_EQ(message.beam_valid, (std::vector<std::int8_t>{1, 1, 0, 1}));
  std::vector<std::uint8_t> bytes;
  EXPECT_TRUE(Encode(message, &bytes));
  NavConverter converter{Rig()};
  NavSample sample;
  ASSERT_TRUE(converter.Convert(message, &sample));
  EXPECT_NEAR(sample.sigma_velocity_mps.x(), 0.003, 1e-15);
  EXPECT_EQ(sample.altitude_m, 1.5);
}

TEST(BridgeTest, WaterLinkedsMarksForNothingAreRefused) {
  dvl_t message;
  WaterLinkedReport report = A50();
  report.is_velocity_valid = false;
  EXPECT_TRUE(DvlFromWaterLinked(report, Quat::Identity(), &message));
  EXPECT_FALSE(HasVelocity(message));
  report.altitude_m = -1.0;
  EXPECT_FALSE(DvlFromWaterLinked(report, Quat::Identity(), &message));
}

// 1 to 4 are the manual's: which beam is meant cannot be known.
TEST(BridgeTest, WaterLinkedsBeamsMustHaveTheWiresIds) {
  for (const int id : {4, -1, 0}) {  // the last is there twice then
    WaterLinkedReport report = A50();
    report.beams[0].id = id;
    dvl_t message;
    message.utime = 99;
    EXPECT_FALSE(DvlFromWaterLinked(report, Quat::Identity(), &message)) << id;
    EXPECT_EQ(message.utime, 99);
  }
}

TEST(BridgeTest, UuvDvl) {
  UuvDvl dvl;
  dvl.utime = 7;
  dvl.velocity_mps = Vec3(0.5, 0.0, 0.0);
  dvl.velocity_covariance = {1e-4, 0, 0, 0, 4e-4, 0, 0, 0, 9e-4};
  dvl.altitude_m = 2.0;
  const Quat turned_right = QuatFromRollPitchHeading(0.0, 0.0, M_PI / 2);
  dvl_t message;
  ASSERT_TRUE(DvlFromUuv(dvl, turned_right, &message));
  EXPECT_LT((Velocity(message) - Vec3(0.0, 0.5, 0.0)).norm(), 1e-12);
  EXPECT_NEAR(message.velocity_cov_m2ps2[0], 4e-4, 1e-15);
  EXPECT_NEAR(message.velocity_cov_m2ps2[4], 1e-4, 1e-15);

  NavConverter converter{Rig()};
  NavSample sample;
  dvl.velocity_covariance = {};  // unknown
  ASSERT_TRUE(DvlFromUuv(dvl, Quat::Identity(), &message));
  ASSERT_TRUE(converter.Convert(message, &sample));
  EXPECT_TRUE(sample.Has(NavField::kVelocity));
  EXPECT_EQ(sample.sigma_velocity_mps, Vec3::Zero());

  dvl.velocity_covariance[0] = -1.0;  // invalid
  ASSERT_TRUE(DvlFromUuv(dvl, Quat::Identity(), &message));
  EXPECT_FALSE(HasVelocity(message));
  dvl.altitude_m = 0.0;
  EXPECT_FALSE(DvlFromUuv(dvl, Quat::Identity(), &message));
}

pose_t Pose() {
  pose_t pose = {};
  pose.utime = 1'700'000'000'000'000;
  pose.frame_id = "ned";
  pose.child_frame_id = "body";
  for (int i = 0; i < 3; ++i) pose.position_m[i] = i + 1;
  pose.frame_from_body_q[0] = 1.0;
  for (int i = 0; i < 36; ++i)
    pose.covariance[i] = 10 * std::min(i / 6, i % 6) + std::max(i / 6, i % 6);
  pose.state = pose_t::STATE_TRACKING;
  pose.quality = 80;
  pose.reset_counter = 258;
  pose.scale_is_metric = 1;
  return pose;
}

TEST(BridgeTest, PosesForAnAutopilot) {
  MavlinkOdometry odometry;
  ASSERT_TRUE(ToMavlinkOdometry(Pose(), &odometry));
  EXPECT_EQ(odometry.time_usec, 1'700'000'000'000'000u);
  EXPECT_EQ(odometry.frame_id, 1);
  EXPECT_EQ(odometry.child_frame_id, 12);
  EXPECT_EQ(odometry.position_m, (std::array<float, 3>{1, 2, 3}));
  EXPECT_EQ(odometry.q, (std::array<float, 4>{1, 0, 0, 0}));
  // Six of the first row, five of the second, and so on.
  EXPECT_EQ(odometry.pose_covariance,
            (std::array<float, 21>{0,  1,  2,  3,  4,  5,  11, 12, 13, 14, 15,
                                   22, 23, 24, 25, 33, 34, 35, 44, 45, 55}));
  EXPECT_EQ(odometry.reset_counter, 2);
  EXPECT_EQ(odometry.quality, 80);
}

TEST(BridgeTest, WhatAPoseDoesNotHaveIsMarkedAsMavlinkDoes) {
  pose_t pose = Pose();
  pose.covariance[0] = -1.0;
  pose.velocity_body_mps[0] = std::nan("");
  pose.quality = 0;  // the worst; 0 is "not known" there
  MavlinkOdometry odometry;
  ASSERT_TRUE(ToMavlinkOdometry(pose, &odometry));
  EXPECT_TRUE(std::isnan(odometry.pose_covariance[0]));
  EXPECT_TRUE(std::isnan(odometry.velocity_mps[0]));
  EXPECT_EQ(odometry.quality, 1);
  pose.state = pose_t::STATE_LOST;
  ASSERT_TRUE(ToMavlinkOdometry(pose, &odometry));
  EXPECT_EQ(odometry.quality, -1);
}

TEST(BridgeTest, AnAutopilotGetsNoPoseThatItCannotUse) {
  MavlinkOdometry odometry;
  odometry.quality = 42;
  pose_t pose = Pose();
  pose.frame_id = "first_camera";
  EXPECT_FALSE(ToMavlinkOdometry(pose, &odometry));
  pose = Pose();
  pose.scale_is_metric = 0;
  EXPECT_FALSE(ToMavlinkOdometry(pose, &odometry));
  pose = Pose();
  pose.state = pose_t::STATE_INITIALISING;
  EXPECT_FALSE(ToMavlinkOdometry(pose, &odometry));
  EXPECT_EQ(odometry.quality, 42);
}

}  // namespace
}  // namespace rsfm
