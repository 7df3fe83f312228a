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

TEST(NavAid, PriorsVanishAtTheTruth) {
  const NavAid nav = Make(true, true);
  const Rigid3 a = (SurveyBody(3.0) * DownwardCamera()).Inverse();
  const Rigid3 b = (SurveyBody(4.0) * DownwardCamera()).Inverse();
  NavSample sample = SampleAt(3.0, true, true);
  sample.Set(NavField::kDepth);
  sample.depth_m = SurveyBody(3.0).translation.z();
  int count = 0;
  nav.ForEachPrior(0, sample, [&](const PosePrior& prior) {
    ++count;
    EXPECT_LT(EvaluatePrior(prior, a, Rigid3()).residual.norm(), 1e-6);
    EXPECT_GT(EvaluatePrior(prior, b, Rigid3()).residual.norm(), 0.1);
  });
  EXPECT_EQ(count, 3);
  const auto displacement = nav.DisplacementPrior(0, 1, UsFromSeconds(3.0), UsFromSeconds(4.0));
  ASSERT_TRUE(displacement.has_value());
  EXPECT_LT(EvaluatePrior(*displacement, a, b).residual.norm(), 0.1);
  EXPECT_GT(EvaluatePrior(*displacement, a, a).residual.norm(), 3.0);
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
