// Messages: round trips, and whatever is not one is refused without harm.
#include "rsfm/io/messages.h"
#include "rsfm/base/plausible_time.h"

#include <gtest/gtest.h>

#include "rsfm/base/rng.h"
#include "rsfm/io/nav_messages.h"
#include "rsfm/io/tables.h"

namespace rsfm {
namespace {

keyframe_t SampleKeyframe() {
  keyframe_t m = {};
  m.utime = 42;
  m.id = 7;
  m.image = "a.jpg";
  m.camera_from_world_q[0] = 1.0;
  m.num_features = 2;
  m.x_px = {1.5f, 2.5f};
  m.y_px = {3.0f, 4.0f};
  m.size_px = {5.0f, 6.0f};
  m.landmark_id = {-1, 9};
  m.descriptor_type = keyframe_t::DESCRIPTOR_ORB;
  m.descriptor_bytes = 32;
  m.num_descriptor_bytes = 64;
  m.descriptors.assign(64, 0xAB);
  return m;
}

template <class Message>
Message Sample() {
  Message m = {};
  m.utime = 5;
  return m;
}
template <>
keyframe_t Sample<keyframe_t>() {
  return SampleKeyframe();
}
template <>
dvl_t Sample<dvl_t>() {
  dvl_t m = {};
  m.num_beams = 4;
  m.beam_range_m = m.beam_velocity_mps = {1.0, 2.0, 3.0, 4.0};
  m.beam_valid = {1, 1, 0, 1};
  return m;
}
template <>
keyframe_poses_t Sample<keyframe_poses_t>() {
  keyframe_poses_t m = {};
  m.num = 1;
  m.id = {3};
  m.qw = m.qx = m.qy = m.qz = {0.5};
  m.tx = m.ty = m.tz = {1.0};
  return m;
}
template <>
landmarks_t Sample<landmarks_t>() {
  landmarks_t m = {};
  m.num = 1;
  m.id = {3};
  m.x = m.y = m.z = {1.0};
  m.r = m.g = m.b = {200};
  return m;
}
template <>
pose_t Sample<pose_t>() {
  pose_t m = {};
  m.frame_id = "ned";
  m.child_frame_id = "body";
  return m;
}
template <>
status_t Sample<status_t>() {
  status_t m = {};
  m.frame_id = "first_camera";
  m.message = "all is well";
  return m;
}

template <class Message>
class MessageTest : public ::testing::Test {};
using Messages = ::testing::Types<acfrlcm::auv_acfr_nav_t, ahrs_t, bot_core::pose_t, ctd_t, depth_t,
                                  dvl_t, fix_t, keyframe_poses_t, keyframe_t, landmarks_t, nav_t,
                                  pose_t, status_t, water_t>;
TYPED_TEST_SUITE(MessageTest, Messages);

TYPED_TEST(MessageTest, DecodeInvertsEncode) {
  const TypeParam message = Sample<TypeParam>();
  std::vector<std::uint8_t> bytes, again;
  ASSERT_TRUE(Encode(message, &bytes));
  TypeParam back = {};
  ASSERT_TRUE(Decode(bytes, &back));
  ASSERT_TRUE(Encode(back, &again));
  EXPECT_EQ(bytes, again);
}

TYPED_TEST(MessageTest, EveryTruncationAndEveryExtensionIsRefused) {
  std::vector<std::uint8_t> bytes;
  ASSERT_TRUE(Encode(Sample<TypeParam>(), &bytes));
  TypeParam back = {};
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(Decode(std::span(bytes.data(), size), &back)) << size;
  }
  bytes.push_back(0);
  EXPECT_FALSE(Decode(bytes, &back));
}

TYPED_TEST(MessageTest, AnotherFingerprintIsRefused) {
  std::vector<std::uint8_t> bytes;
  ASSERT_TRUE(Encode(Sample<TypeParam>(), &bytes));
  TypeParam back = {};
  for (std::size_t i = 0; i < 8; ++i) {
    bytes[i] ^= 1;
    EXPECT_FALSE(Decode(bytes, &back));
    bytes[i] ^= 1;
  }
}

// Whatever the counts and lengths say: no crash, no memory beyond the message's size.
TYPED_TEST(MessageTest, RandomDamageIsHarmless) {
  std::vector<std::uint8_t> good;
  ASSERT_TRUE(Encode(Sample<TypeParam>(), &good));
  Rng rng(3);
  for (int trial = 0; trial < 2000; ++trial) {
    std::vector<std::uint8_t> bytes = good;
    for (int k = 0; k < 4; ++k) {
      const auto at = 8 + rng.Index(static_cast<std::uint32_t>(good.size()) - 8);
      bytes[at] = static_cast<std::uint8_t>(rng.Index(3) == 0 ? 0xff : rng.Index(256));
    }
    TypeParam back = {};
    std::vector<std::uint8_t> again;
    if (Decode(bytes, &back)) {
      EXPECT_TRUE(Encode(back, &again));
    }
  }
}

TEST(KeyframeTest, CountsThatDoNotMatchTheArraysAreRefused) {
  std::vector<std::uint8_t> bytes;
  keyframe_t m = SampleKeyframe();
  m.x_px.pop_back();
  EXPECT_FALSE(Encode(m, &bytes));
  m = SampleKeyframe();
  m.descriptor_bytes = 31;
  EXPECT_FALSE(Encode(m, &bytes));
}

NavSample FullSample() {
  NavSample s;
  s.utime = 123;
  s.valid = 63;
  s.position_ned_m = {1, 2, 3};
  s.ned_from_body = Quat(0.5, 0.5, -0.5, 0.5);
  s.velocity_body_mps = {0.1, 0.2, 0.3};
  s.depth_m = 3.5;
  s.altitude_m = 2.5;
  s.temperature_c = 8;
  s.salinity_psu = 35;
  s.sigma_position_m = {0.5, 0.25, 2};
  s.sigma_attitude_rad = {0.5, 0.125, 4};
  s.sigma_velocity_mps = {0.25, 0.5, 1};
  s.sigma_depth_m = 0.05;
  s.sigma_altitude_m = 0.1;
  return s;
}

TEST(NavMessagesTest, ASampleSurvivesItsMessage) {
  NavConverter converter{Rig()};
  const NavSample s = FullSample();
  NavSample back;
  ASSERT_TRUE(converter.Convert(ToMessage(s), &back));
  EXPECT_EQ(back.utime, s.utime);
  EXPECT_EQ(back.valid, s.valid);
  EXPECT_EQ(back.position_ned_m, s.position_ned_m);
  EXPECT_EQ(back.ned_from_body.coeffs(), s.ned_from_body.coeffs());
  EXPECT_EQ(back.velocity_body_mps, s.velocity_body_mps);
  EXPECT_EQ(back.depth_m, s.depth_m);
  EXPECT_EQ(back.altitude_m, s.altitude_m);
  EXPECT_EQ(back.salinity_psu, s.salinity_psu);
  EXPECT_EQ(back.sigma_position_m, s.sigma_position_m);
  EXPECT_EQ(back.sigma_attitude_rad, s.sigma_attitude_rad);
  EXPECT_EQ(back.sigma_depth_m, s.sigma_depth_m);
}

TEST(NavMessagesTest, WhatIsNotFiniteIsLeftOut) {
  NavConverter converter{Rig()};
  nav_t message = ToMessage(FullSample());
  message.position_ned_m[1] = std::nan("");
  message.velocity_cov_m2ps2[4] = -1.0;
  message.ned_from_body_q[0] = 0.9;
  NavSample sample;
  ASSERT_TRUE(converter.Convert(message, &sample));
  EXPECT_FALSE(sample.Has(NavField::kPosition));
  EXPECT_FALSE(sample.Has(NavField::kVelocity));
  EXPECT_FALSE(sample.Has(NavField::kAttitude));
  EXPECT_TRUE(sample.Has(NavField::kDepth));
  EXPECT_EQ(converter.rejected(NavReject::kNotFinite), 1u);
  EXPECT_EQ(converter.rejected(NavReject::kSentinel), 1u);
  EXPECT_EQ(converter.rejected(NavReject::kOutOfRange), 1u);
  message.valid = nav_t::VALID_POSITION;
  EXPECT_FALSE(converter.Convert(message, &sample));
  EXPECT_EQ(converter.rejected(NavReject::kNotFinite), 2u);
}

TEST(NavMessagesTest, WhatHasNoTimeIsRefusedAndCounted) {
  NavConverter converter{Rig()};
  NavSample sample;
  std::uint64_t refused = 0;
  for (const Utime no_time : {std::numeric_limits<Utime>::min(), kMaxUtime + 1}) {
    nav_t nav = ToMessage(FullSample());
    nav.utime = no_time;
    EXPECT_FALSE(converter.Convert(nav, &sample));
    EXPECT_EQ(converter.rejected(NavReject::kOutOfRange), ++refused);
    depth_t depth = {};
    depth.utime = no_time;
    depth.valid = 1;
    depth.sigma_m = 0.1;
    EXPECT_FALSE(converter.Convert(depth, &sample));
    EXPECT_EQ(converter.rejected(NavReject::kOutOfRange), ++refused);
  }
}

// Beside a lever arm the body's depth moves with the attitude, though the sensor has stopped.
TEST(NavMessagesTest, ASensorThatHasStoppedIsRefusedAsItMeasured) {
  Rig rig;
  rig.sensors.depth_in_body_m = {2, 0, 0};
  rig.sensors.dvl_in_body_m = {1, 0, 0.5};
  NavConverter converter(rig);
  NavSample sample;
  ahrs_t ahrs = {};
  ahrs.valid = int{ahrs_t::VALID_ATTITUDE} | int{ahrs_t::VALID_ROTATION_RATE};
  depth_t depth = {};
  depth.valid = 1;
  dvl_t dvl = {};
  dvl.valid = int{dvl_t::VALID_VELOCITY} | int{dvl_t::VALID_ALTITUDE};
  int num_depths = 0, num_logs = 0;
  for (int i = 0; i < 1200; ++i) {
    const double pitch = 0.1 * std::sin(0.1 * i);
    ahrs.utime = depth.utime = dvl.utime = 100'000 * (i + 1);
    ahrs.ned_from_body_q[0] = std::cos(0.5 * pitch);
    ahrs.ned_from_body_q[2] = std::sin(0.5 * pitch);
    ahrs.rotation_rate_radps[1] = 0.1 * std::cos(0.1 * i);
    ASSERT_TRUE(converter.Convert(ahrs, &sample));
    if (i < 1000) {
      depth.depth_m = 5.0 + 1e-3 * i;
      dvl.velocity_body_mps[0] = 1e-3 * i;
      dvl.altitude_m = 3.0 + 1e-3 * i;
    }
    num_depths += converter.Convert(depth, &sample);
    num_logs += converter.Convert(dvl, &sample);
    // The same messages once more are no repetition.
    static_cast<void>(converter.Convert(depth, &sample));
    static_cast<void>(converter.Convert(dvl, &sample));
  }
  EXPECT_EQ(num_depths, 1003);
  EXPECT_EQ(num_logs, 1003);
  EXPECT_EQ(converter.rejected(NavReject::kFrozen), 2u * 3u * 197u);
}

// The turn rate times the lever arm would make a speed of it.
TEST(NavMessagesTest, ALogsMarkForNoVelocityIsKnownBesideALeverArm) {
  Rig rig;
  rig.sensors.dvl_in_body_m = {1, 0, 0.5};
  NavConverter converter(rig);
  NavSample sample;
  ahrs_t ahrs = {};
  ahrs.utime = 1000;
  ahrs.valid = int{ahrs_t::VALID_ATTITUDE} | int{ahrs_t::VALID_ROTATION_RATE};
  ahrs.ned_from_body_q[0] = 1.0;
  ahrs.rotation_rate_radps[1] = 0.2;
  ASSERT_TRUE(converter.Convert(ahrs, &sample));
  dvl_t dvl = {};
  dvl.utime = 1000;
  dvl.valid = int{dvl_t::VALID_VELOCITY};
  for (double& v : dvl.velocity_body_mps) v = -32.768;
  EXPECT_FALSE(converter.Convert(dvl, &sample));
  EXPECT_EQ(converter.rejected(NavReject::kSentinel), 1u);
}

TEST(NavMessagesTest, LeverArmsAreRemoved) {
  Rig rig;
  rig.sensors.dvl_in_body_m = {1, 0, 0.5};
  rig.sensors.depth_in_body_m = {2, 0, 0};
  NavConverter converter(rig);
  ahrs_t ahrs = {};
  ahrs.utime = 1000;
  ahrs.valid = int{ahrs_t::VALID_ATTITUDE} | int{ahrs_t::VALID_ROTATION_RATE};
  // Nose down by 90 degrees: the body's forward axis points down.
  const double half = std::sqrt(0.5);
  ahrs.ned_from_body_q[0] = half;
  ahrs.ned_from_body_q[2] = -half;
  ahrs.rotation_rate_radps[2] = 0.1;
  NavSample sample;
  ASSERT_TRUE(converter.Convert(ahrs, &sample));
  depth_t depth = {};
  depth.utime = 1000;
  depth.valid = 1;
  depth.depth_m = 10.0;
  ASSERT_TRUE(converter.Convert(depth, &sample));
  EXPECT_NEAR(sample.depth_m, 8.0, 1e-12);
  dvl_t dvl = {};
  dvl.utime = 1000;
  dvl.valid = dvl_t::VALID_VELOCITY;
  dvl.velocity_body_mps[0] = 1.0;
  dvl.velocity_body_mps[1] = 0.1;  // 0.1 rad/s about down, one metre ahead
  ASSERT_TRUE(converter.Convert(dvl, &sample));
  EXPECT_NEAR((sample.velocity_body_mps - Vec3(1.0, 0.0, 0.0)).norm(), 0.0, 1e-12);
}

TEST(NavMessagesTest, FixesAreTurnedIntoNedAtTheFirst) {
  NavConverter converter{Rig()};
  fix_t fix = {};
  fix.valid = int{fix_t::VALID_HORIZONTAL} | int{fix_t::VALID_HEIGHT};
  fix.latitude_deg = 54.0;
  fix.longitude_deg = 10.0;
  NavSample sample;
  ASSERT_TRUE(converter.Convert(fix, &sample));
  EXPECT_LT(sample.position_ned_m.norm(), 1e-9);
  ASSERT_TRUE(converter.origin());
  EXPECT_EQ(converter.origin()->latitude_deg, 54.0);
  fix.latitude_deg = 54.001;  // 111.3 m per 0.001 degrees there
  ASSERT_TRUE(converter.Convert(fix, &sample));
  EXPECT_NEAR(sample.position_ned_m.x(), 111.3, 0.1);
  fix.latitude_deg = 91.0;
  EXPECT_FALSE(converter.Convert(fix, &sample));
}

// Level, heading east, moving ahead at 1 m/s, 3 m east, 4 m north, 5 m below the origin: the same
// state in both conventions of bot_core.pose_t.
TEST(NavMessagesTest, BotCorePoseInBothConventions) {
  const double half = std::sqrt(0.5);
  bot_core::pose_t libbot = {};
  libbot.pos[0] = 3;
  libbot.pos[1] = 4;
  libbot.pos[2] = -5;
  libbot.vel[0] = 1.0;          // east, in the local frame
  libbot.orientation[0] = 1.0;  // x forward is east, z up
  bot_core::pose_t humanoids = libbot;
  humanoids.orientation[0] = 0.0;
  humanoids.orientation[1] = 1.0;  // x forward is east, z down: a half turn about x
  humanoids.vel[0] = 1.0;          // ahead
  for (const auto& [message, convention] :
       {std::pair{libbot, Convention::kLibbot}, {humanoids, Convention::kOpenHumanoids}}) {
    NavConverter converter{Rig()};
    NavSample sample;
    ASSERT_TRUE(converter.Convert(message, convention, &sample));
    EXPECT_LT((sample.position_ned_m - Vec3(4, 3, 5)).norm(), 1e-12);
    EXPECT_LT((sample.velocity_body_mps - Vec3(1, 0, 0)).norm(), 1e-12);
    EXPECT_LT(sample.ned_from_body.angularDistance(Quat(half, 0, 0, half)), 1e-7);
  }
}

// Heading east, nose down by 30 degrees and turning right at 0.1 rad/s about its own down: what is
// known of attitude and rate from a bot_core.pose_t removes the lever arms of other sensors.
TEST(NavMessagesTest, BotCorePoseGivesTheAttitudeForLeverArms) {
  Rig rig;
  rig.sensors.depth_in_body_m = Vec3(2.0, 0.0, 0.0);
  rig.sensors.dvl_in_body_m = Vec3(2.0, 0.0, 0.0);
  const Quat ned_from_body = QuatFromRollPitchHeading(0.0, -M_PI / 6, M_PI / 2);
  const Mat3 enu_from_ned{{0, 1, 0}, {1, 0, 0}, {0, 0, -1}};
  const Vec3 rate_in_enu = enu_from_ned * (ned_from_body * Vec3(0, 0, 0.1));
  for (const Convention convention : {Convention::kLibbot, Convention::kOpenHumanoids}) {
    const bool is_libbot = convention == Convention::kLibbot;
    const Mat3 frd_from_body =
        is_libbot ? Mat3(Vec3(1, -1, -1).asDiagonal()) : Mat3(Mat3::Identity());
    const Quat q(Mat3(enu_from_ned * ned_from_body.toRotationMatrix() * frd_from_body));
    bot_core::pose_t pose = {};
    const double wxyz[4] = {q.w(), q.x(), q.y(), q.z()};
    std::copy_n(wxyz, 4, pose.orientation);
    const Vec3 rate = is_libbot ? rate_in_enu : Vec3(0, 0, 0.1);
    std::copy_n(rate.data(), 3, pose.rotation_rate);
    NavConverter converter(rig);
    NavSample sample;
    ASSERT_TRUE(converter.Convert(pose, convention, &sample));
    depth_t depth = {};
    depth.valid = 1;
    depth.depth_m = 10.0;
    ASSERT_TRUE(converter.Convert(depth, &sample));
    EXPECT_NEAR(sample.depth_m, 9.0, 1e-12);  // the sensor is 2 m ahead: 1 m deeper
    dvl_t dvl = {};
    dvl.valid = dvl_t::VALID_VELOCITY;
    dvl.velocity_body_mps[0] = 1.0;
    ASSERT_TRUE(converter.Convert(dvl, &sample));
    EXPECT_LT((sample.velocity_body_mps - Vec3(1.0, -0.2, 0.0)).norm(), 1e-12);
  }
}

// Finite, and infinite once it is turned: found by the fuzzer.
TEST(NavMessagesTest, WhatOverflowsIsNoMeasurement) {
  NavConverter converter{Rig()};
  NavSample sample;
  bot_core::pose_t pose = {};
  pose.orientation[0] = 1.0;
  pose.pos[0] = pose.pos[1] = -1.7e308;
  EXPECT_FALSE(converter.Convert(pose, Convention::kLibbot, &sample));
  pose.pos[0] = pose.pos[1] = 0.0;
  pose.vel[2] = 1.7e308;
  EXPECT_FALSE(converter.Convert(pose, Convention::kLibbot, &sample));
  dvl_t dvl = {};
  dvl.valid = dvl_t::VALID_VELOCITY;
  dvl.velocity_body_mps[0] = 1.7e308;
  EXPECT_FALSE(converter.Convert(dvl, &sample));
  EXPECT_EQ(converter.rejected(NavReject::kOutOfRange), 3u);
}

// A rate of rotation like that is none: the sensor's lever arm is left out.
TEST(NavMessagesTest, ARateThatOverflowsIsNone) {
  Rig rig;
  rig.sensors.dvl_in_body_m = Vec3(1.0, 0.0, 0.5);
  NavConverter converter(rig);
  NavSample sample;
  ahrs_t ahrs = {};
  ahrs.valid = int{ahrs_t::VALID_ATTITUDE} | int{ahrs_t::VALID_ROTATION_RATE};
  ahrs.ned_from_body_q[0] = 1.0;
  ahrs.rotation_rate_radps[0] = ahrs.rotation_rate_radps[2] = 1.7e308;
  ASSERT_TRUE(converter.Convert(ahrs, &sample));
  dvl_t dvl = {};
  dvl.valid = dvl_t::VALID_VELOCITY;
  dvl.velocity_body_mps[0] = 1.0;
  ASSERT_TRUE(converter.Convert(dvl, &sample));
  EXPECT_EQ(sample.velocity_body_mps, Vec3(1.0, 0.0, 0.0));
}

TEST(NavMessagesTest, AcfrNav) {
  acfrlcm::auv_acfr_nav_t message = {};
  message.utime = 7;
  message.x = 4;
  message.y = 3;
  message.depth = 5;
  message.heading = std::asin(1.0);  // east
  message.vx = 1;
  NavConverter converter{Rig()};
  NavSample sample;
  ASSERT_TRUE(converter.Convert(message, &sample));
  const double half = std::sqrt(0.5);
  EXPECT_EQ(sample.utime, 7);
  EXPECT_LT((sample.position_ned_m - Vec3(4, 3, 5)).norm(), 1e-12);
  EXPECT_LT((sample.velocity_body_mps - Vec3(1, 0, 0)).norm(), 1e-12);
  EXPECT_LT(sample.ned_from_body.angularDistance(Quat(half, 0, 0, half)), 1e-7);
  EXPECT_EQ(sample.depth_m, 5.0);
  EXPECT_FALSE(sample.Has(NavField::kAltitude));  // 0: the altimeter had no return
  message.altitude = 2.5;
  ASSERT_TRUE(converter.Convert(message, &sample));
  EXPECT_EQ(sample.altitude_m, 2.5);
  message.pitch = std::nan("");
  EXPECT_FALSE(converter.Convert(message, &sample));
}

}  // namespace
}  // namespace rsfm
