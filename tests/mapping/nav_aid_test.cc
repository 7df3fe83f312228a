#include "rsfm/mapping/nav_aid.h"

#include <gtest/gtest.h>

#include <cmath>

#include "rsfm/base/so3.h"
#include "tests/mapping/feature_world.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

NavSample SampleAt(double seconds, bool with_position, bool with_velocity) {
  const Rigid3 body = SurveyBody(seconds);
  NavSample sample;
  sample.utime = UsFromSeconds(seconds);
  sample.Set(NavField::kAttitude);
  sample.ned_from_body = body.rotation;
  if (with_position) {
    sample.Set(NavField::kPosition);
    sample.position_ned_m = body.translation;
    sample.sigma_position_m = Vec3::Constant(0.5);
  }
  if (with_velocity) {
    sample.Set(NavField::kVelocity);
    const double h = 1e-3;
    sample.velocity_body_mps =
        body.rotation.conjugate() *
        ((SurveyBody(seconds + h).translation - SurveyBody(seconds - h).translation) / (2.0 * h));
    sample.sigma_velocity_mps = Vec3::Constant(0.01);
  }
  return sample;
}

NavAid Make(bool with_position, bool with_velocity) {
  NavAid nav = NavAid::Create(MapperOptions{}, DownwardCamera()).value();
  for (int i = 0; i <= 200; ++i)
    nav.buffer().Insert(SampleAt(0.05 * i, with_position, with_velocity));
  return nav;
}

TEST(NavAid, MotionIsTheCamerasWhateverTheSource) {
  for (const bool with_velocity : {true, false}) {
    const NavAid nav = Make(true, with_velocity);
    MallocTrap trap;
    const auto motion = nav.Motion(UsFromSeconds(2.0), UsFromSeconds(6.0));
    EXPECT_EQ(trap.count(), 0u);
    ASSERT_TRUE(motion.has_value());
    const Rigid3 start = SurveyBody(2.0) * DownwardCamera(),
                 end = SurveyBody(6.0) * DownwardCamera();
    const Rigid3 expected = start.Inverse() * end;
    EXPECT_LT((motion->start_from_end.translation - expected.translation).norm(), 2e-3);
    EXPECT_LT(AngleBetween(motion->start_from_end.rotation, expected.rotation), 1e-6);
    // Two fixes of half a metre are worth less than four seconds of the log.
    EXPECT_NEAR(motion->sigma_baseline_m(), with_velocity ? 0.011 : 0.707,
                with_velocity ? 0.03 : 0.01);
  }
  EXPECT_FALSE(Make(false, false).Motion(UsFromSeconds(2.0), UsFromSeconds(6.0)).has_value());
  EXPECT_FALSE(Make(true, true).Motion(UsFromSeconds(2.0), UsFromSeconds(60.0)).has_value());
}

TEST(NavAid, FactorsVanishAtTheTruth) {
  const NavAid nav = Make(true, true);
  const Rigid3 a = (SurveyBody(3.0) * DownwardCamera()).Inverse();
  const Rigid3 b = (SurveyBody(4.0) * DownwardCamera()).Inverse();
  NavSample sample = SampleAt(3.0, true, true);
  sample.Set(NavField::kDepth);
  sample.depth_m = SurveyBody(3.0).translation.z();
  const NavStates none = NavStates::Zero();
  const Vec3 still = Vec3::Zero();
  const Utime at = UsFromSeconds(3.0);
  for (const auto& factor :
       {nav.AttitudeFactor(0, sample, still), nav.DepthFactor(0, sample, still),
        nav.PositionFactor(0, at, at - 1, at + 1, still)}) {
    ASSERT_TRUE(factor.has_value());
    EXPECT_LT(EvaluateNavFactor(*factor, a, Rigid3(), none).residual.norm(), 1e-6);
    EXPECT_GT(EvaluateNavFactor(*factor, b, Rigid3(), none).residual.norm(), 0.1);
  }
  const auto displacement = nav.DisplacementFactor(0, 1, at, UsFromSeconds(4.0));
  ASSERT_TRUE(displacement.has_value());
  EXPECT_LT(EvaluateNavFactor(*displacement, a, b, none).residual.norm(), 0.1);
  EXPECT_GT(EvaluateNavFactor(*displacement, a, a, none).residual.norm(), 3.0);
  EXPECT_FALSE(nav.DisplacementFactor(0, 1, at, UsFromSeconds(60.0)).has_value());
  EXPECT_FALSE(nav.PositionFactor(0, at, UsFromSeconds(60.0), UsFromSeconds(61.0), still));
}

// A log that is mounted wrong, off by a factor and away from the body's origin: the factor's states
// explain what it measures.
TEST(NavAid, SensorStatesExplainTheLog) {
  NavStates states = NavStates::Zero();
  states[kHeadingBias] = 0.01;
  states[kVelocityScale] = 0.005;
  states.segment<3>(kMisalignment) = Vec3(0.004, -0.006, 0.008);
  states.segment<3>(kVelocityLever) = Vec3(0.1, -0.05, 0.2);
  NavAid nav = NavAid::Create(MapperOptions{}, DownwardCamera()).value();
  for (int i = 0; i <= 400; ++i) {
    const double t = 0.025 * i, h = 1e-3;
    NavSample sample = SampleAt(t, false, true);
    const Mat3 rotation = SampleAt(t, false, false).ned_from_body.toRotationMatrix();
    const Vec3 rate_ned =
        LogSo3(SurveyBody(t + h).rotation * SurveyBody(t - h).rotation.conjugate()) / (2.0 * h);
    const Vec3 swing = (rotation.transpose() * rate_ned).cross(states.segment<3>(kVelocityLever));
    sample.velocity_body_mps =
        (1.0 + states[kVelocityScale]) *
        (ExpSo3(states.segment<3>(kMisalignment)) * (sample.velocity_body_mps + swing));
    sample.ned_from_body = ExpSo3(Vec3(0, 0, states[kHeadingBias])) * sample.ned_from_body;
    nav.buffer().Insert(sample);
  }
  const auto factor = nav.DisplacementFactor(0, 1, UsFromSeconds(3.0), UsFromSeconds(7.0));
  ASSERT_TRUE(factor.has_value());
  const Rigid3 a = (SurveyBody(3.0) * DownwardCamera()).Inverse();
  const Rigid3 b = (SurveyBody(7.0) * DownwardCamera()).Inverse();
  NavFactor in_metres = *factor;
  in_metres.sqrt_information = Mat3::Identity();
  const double explained = EvaluateNavFactor(in_metres, a, b, states).residual.norm();
  EXPECT_LT(explained, 1e-3);
  for (const int state :
       {kHeadingBias + 0, kVelocityScale + 0, kMisalignment + 2, kVelocityLever + 0}) {
    NavStates without = states;
    without[state] = 0.0;
    EXPECT_GT(EvaluateNavFactor(in_metres, a, b, without).residual.norm(), 1.5 * explained)
        << state;
  }
}

TEST(NavAid, PlacesTheCameraWhereTheBodyIs) {
  const NavAid nav = Make(true, true);
  const auto camera_from_ned = nav.CameraFromNed(SampleAt(3.0, true, false));
  ASSERT_TRUE(camera_from_ned.has_value());
  const Rigid3 expected = (SurveyBody(3.0) * DownwardCamera()).Inverse();
  EXPECT_LT((camera_from_ned->OriginOfTarget() - expected.OriginOfTarget()).norm(), 1e-9);
  EXPECT_FALSE(nav.CameraFromNed(NavSample{}).has_value());  // no attitude
}

}  // namespace
}  // namespace rsfm
