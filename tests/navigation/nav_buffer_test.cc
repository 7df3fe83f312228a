#include "rsfm/navigation/nav_buffer.h"
#include "rsfm/base/plausible_time.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "rsfm/base/rng.h"
#include "rsfm/base/so3.h"
#include "rsfm/navigation/lever_arm.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kPi = std::numbers::pi;

NavBuffer MakeBuffer(int capacity = 512) {
  NavBufferOptions options;
  options.capacity = capacity;
  return NavBuffer::Create(options).value();
}

NavSample Velocity(double seconds, const Vec3& v) {
  NavSample s;
  s.utime = UsFromSeconds(seconds);
  s.Set(NavField::kVelocity);
  s.velocity_body_mps = v;
  return s;
}
NavSample Attitude(double seconds, const Quat& q) {
  NavSample s;
  s.utime = UsFromSeconds(seconds);
  s.Set(NavField::kAttitude);
  s.ned_from_body = q;
  return s;
}
NavSample Depth(double seconds, double depth, double sigma = 0.0) {
  NavSample s;
  s.utime = UsFromSeconds(seconds);
  s.Set(NavField::kDepth);
  s.depth_m = depth;
  s.sigma_depth_m = sigma;
  return s;
}
NavSample Defaults() {
  NavSample d;
  d.sigma_velocity_mps = Vec3::Constant(0.01);
  d.sigma_attitude_rad = Vec3::Constant(0.01);
  d.sigma_depth_m = 0.02;
  return d;
}

TEST(NavBuffer, InterpolatesEachFieldAtItsOwnRate) {
  NavBuffer nav = MakeBuffer();
  for (double t = 0.0; t < 10.05; t += 0.1) nav.Insert(Depth(t, 5.0 + 0.3 * t));
  for (double t = 0.0; t < 10.05; t += 0.5) nav.Insert(Attitude(t, ExpSo3(Vec3(0, 0, 0.2 * t))));
  const NavSample at = nav.At(UsFromSeconds(3.33));
  ASSERT_TRUE(at.Has(NavField::kDepth));
  ASSERT_TRUE(at.Has(NavField::kAttitude));
  EXPECT_FALSE(at.Has(NavField::kPosition));
  EXPECT_FALSE(at.Has(NavField::kVelocity));
  EXPECT_NEAR(at.depth_m, 5.0 + 0.3 * 3.33, 1e-9);
  EXPECT_LT(AngleBetween(at.ned_from_body, ExpSo3(Vec3(0, 0, 0.2 * 3.33))), 1e-9);
}

TEST(NavBuffer, DoesNotBridgeGaps) {
  NavBuffer nav = MakeBuffer();  // max_gap_s = 2
  nav.Insert(Depth(0.0, 1.0));
  nav.Insert(Depth(1.9, 2.0));
  nav.Insert(Depth(5.0, 3.0));
  EXPECT_TRUE(nav.At(UsFromSeconds(1.0)).Has(NavField::kDepth));
  EXPECT_FALSE(nav.At(UsFromSeconds(3.0)).Has(NavField::kDepth));
  EXPECT_TRUE(nav.At(UsFromSeconds(5.1)).Has(NavField::kDepth));   // just after the last
  EXPECT_FALSE(nav.At(UsFromSeconds(5.5)).Has(NavField::kDepth));  // too long after
  EXPECT_FALSE(nav.At(UsFromSeconds(-1.0)).Has(NavField::kDepth));
}

TEST(NavBuffer, WaterIsWhatWasMeasuredLast) {
  NavBuffer nav = MakeBuffer();
  NavSample water;
  water.Set(NavField::kWater);
  for (int i = 1; i <= 3; ++i) {
    water.utime = UsFromSeconds(100.0 * i);
    water.temperature_c = i;
    water.salinity_psu = 30.0 + i;
    nav.Insert(water);
  }
  nav.Insert(Depth(150.0, 7.0));
  EXPECT_EQ(nav.WaterAt(UsFromSeconds(100.0) - 1).valid, 0u);
  const NavSample first = nav.WaterAt(UsFromSeconds(100.0));
  EXPECT_TRUE(first.Has(NavField::kWater));
  EXPECT_FALSE(first.Has(NavField::kDepth));  // none by then
  EXPECT_EQ(first.temperature_c, 1.0);
  const NavSample second = nav.WaterAt(UsFromSeconds(299.9));
  EXPECT_EQ(second.temperature_c, 2.0);
  EXPECT_EQ(second.salinity_psu, 32.0);
  ASSERT_TRUE(second.Has(NavField::kDepth));
  EXPECT_EQ(second.depth_m, 7.0);
  EXPECT_EQ(nav.WaterAt(UsFromSeconds(9999.0)).temperature_c, 3.0);
}

TEST(NavBuffer, LateSamplesGoToTheirPlace) {
  NavBuffer in_order = MakeBuffer(), shuffled = MakeBuffer();
  Rng rng(5);
  for (int i = 0; i < 100; ++i) in_order.Insert(Depth(0.1 * i, std::sin(0.1 * i)));
  for (int i = 0; i < 100; i += 4) {  // each four in reverse
    for (int k = 3; k >= 0; --k) shuffled.Insert(Depth(0.1 * (i + k), std::sin(0.1 * (i + k))));
  }
  EXPECT_EQ(shuffled.accepted(), 100u);
  for (int i = 0; i < 300; ++i) {
    const Utime t = UsFromSeconds(rng.Uniform(0.0, 9.8));
    EXPECT_EQ(in_order.At(t).depth_m, shuffled.At(t).depth_m);
  }
}

TEST(NavBuffer, RefusesAndCountsBadValues) {
  NavBuffer nav = MakeBuffer();
  const auto refused = [&](const NavSample& sample, NavReject reason) {
    const std::uint64_t before = nav.rejected(reason);
    EXPECT_EQ(nav.Insert(sample), 0u) << ToString(reason);
    EXPECT_EQ(nav.rejected(reason), before + 1) << ToString(reason);
  };
  nav.Insert(Depth(100.0, 5.0));
  refused(Depth(101.0, kNan), NavReject::kNotFinite);
  refused(Velocity(101.0, Vec3(0, kNan, 0)), NavReject::kNotFinite);
  refused(Velocity(101.0, Vec3(-32.768, -32.768, -32.768)), NavReject::kSentinel);
  refused(Velocity(101.0, Vec3(0, 30.0, 0)), NavReject::kOutOfRange);
  refused(Depth(101.0, 5.0, -1.0), NavReject::kSentinel);
  refused(Depth(101.0, 20000.0), NavReject::kOutOfRange);
  refused(Depth(100.0, 5.5), NavReject::kRepeated);
  refused(Depth(90.0, 5.0), NavReject::kRunsBackwards);
  refused(Attitude(101.0, Quat(2, 0, 0, 0)), NavReject::kOutOfRange);
  refused(Attitude(101.0, Quat(kNan, 0, 0, 0)), NavReject::kNotFinite);
  NavSample range;
  range.utime = UsFromSeconds(101.0);
  range.Set(NavField::kAltitude);
  range.altitude_m = 0.0;
  refused(range, NavReject::kSentinel);
  for (const Utime no_time : {std::numeric_limits<Utime>::min(), kMaxUtime + 1}) {
    NavSample timeless = Depth(101.0, 5.0);
    timeless.utime = no_time;
    refused(timeless, NavReject::kOutOfRange);
  }
  EXPECT_EQ(nav.accepted(), 1u);
  EXPECT_EQ(nav.At(UsFromSeconds(100.0)).depth_m, 5.0);  // unharmed

  // One bad field does not cost the others.
  NavSample mixed = Depth(101.0, 6.0);
  mixed.Set(NavField::kVelocity);
  mixed.velocity_body_mps = Vec3(-32.768, 0, 0);
  EXPECT_EQ(nav.Insert(mixed), static_cast<std::uint32_t>(NavField::kDepth));
}

// Each kind on its own; the water may stay as it is.
TEST(NavBuffer, ASensorThatHasStoppedIsRefused) {
  NavBuffer nav = MakeBuffer(4096);
  Rng rng(5);
  NavSample s;
  for (const NavField field : {NavField::kPosition, NavField::kAttitude, NavField::kVelocity,
                               NavField::kDepth, NavField::kAltitude, NavField::kWater})
    s.Set(field);
  s.temperature_c = 8.0;
  s.salinity_psu = 35.0;
  const auto noise = [&] { return Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian()); };
  const auto insert = [&](int i) {
    s.utime = UsFromSeconds(0.1 * i);
    return nav.Insert(s);
  };
  for (int i = 0; i < 1000; ++i) {
    s.position_ned_m = noise();
    s.ned_from_body = ExpSo3(0.01 * noise());
    s.velocity_body_mps = 0.01 * noise();
    s.depth_m = 5.0 + 0.01 * rng.Gaussian();
    s.altitude_m = 3.0 + 0.01 * rng.Gaussian();
    ASSERT_EQ(insert(i), s.valid) << i;
  }
  for (int i = 1000; i < 1300; ++i) {
    const bool is_late = i >= 1003;
    EXPECT_EQ(insert(i), is_late ? static_cast<std::uint32_t>(NavField::kWater) : s.valid) << i;
  }
  EXPECT_EQ(nav.rejected(NavReject::kFrozen), 5u * 297u);
  EXPECT_EQ(nav.At(UsFromSeconds(115.0)).valid, static_cast<std::uint32_t>(NavField::kWater));
  s.depth_m = 5.5;
  EXPECT_EQ(insert(1300), static_cast<std::uint32_t>(NavField::kDepth) |
                              static_cast<std::uint32_t>(NavField::kWater));
}

// A reading that no vehicle reaches carries the expected place away from what the images show.
TEST(NavBuffer, AJumpIsRefusedUntilThreeAgree) {
  NavBuffer nav = MakeBuffer();
  for (int i = 0; i < 20; ++i) {
    const double t = 100.0 + 0.2 * i;
    const bool is_wrong = i % 7 == 6;
    EXPECT_EQ(nav.Insert(Velocity(t, Vec3(is_wrong ? 2.5 : 0.5, 0, 0))) != 0u, !is_wrong) << i;
    EXPECT_EQ(nav.Insert(Depth(t, is_wrong ? 55.0 : 5.0 + 0.01 * i)) != 0u, !is_wrong) << i;
    EXPECT_EQ(
        nav.Insert(Attitude(t, ExpSo3(Vec3(0, 0, (is_wrong ? 2.0 : 0.01) + 0.001 * i)))) != 0u,
        !is_wrong)
        << i;
  }
  EXPECT_EQ(nav.rejected(NavReject::kJump), 6u);
  // What stays there is so: a vehicle that was lowered by crane, a log that lost its zero.
  for (int i = 0; i < 5; ++i)
    EXPECT_EQ(nav.Insert(Depth(104.0 + 0.2 * i, 20.0 + 0.01 * i)) != 0u, i >= 2) << i;
  EXPECT_EQ(nav.rejected(NavReject::kJump), 8u);
  // After a gap anything may be, and late samples lie between others.
  EXPECT_NE(nav.Insert(Depth(120.0, 5.0)), 0u);
  EXPECT_NE(nav.Insert(Depth(119.9, 12.0)), 0u);
}

// Uninitialised memory that came over the bus: its square would be no number, or 0.
TEST(NavBuffer, ASigmaThatNoSensorHasIsRefused) {
  NavBuffer nav = MakeBuffer();
  int i = 0;
  for (const double sigma : {1e-159, 1e-300, 1e-10, 1e7, 1e200})
    EXPECT_EQ(nav.Insert(Depth(100.0 + i++, 5.0, sigma)), 0u) << sigma;
  EXPECT_EQ(nav.rejected(NavReject::kOutOfRange), 5u);
  for (const double sigma : {0.0, 1e-6, 0.01, 1e3})
    EXPECT_NE(nav.Insert(Depth(100.0 + i++, 5.0, sigma)), 0u) << sigma;
}

// A time that is wrong by less than an hour is believed; the true ones after it run backwards, and
// go on.
TEST(NavBuffer, ATimeAheadDoesNotDeafenForLong) {
  NavBuffer nav = MakeBuffer();
  for (int i = 0; i < 10; ++i) EXPECT_NE(nav.Insert(Depth(100.0 + i, 5.0 + 0.01 * i)), 0u);
  EXPECT_NE(nav.Insert(Depth(1500.0, 5.2)), 0u);
  for (int i = 10; i < 20; ++i)
    EXPECT_EQ(nav.Insert(Depth(100.0 + i, 5.0 + 0.01 * i)) != 0u, i >= 12) << i;
  EXPECT_EQ(nav.rejected(NavReject::kRunsBackwards), 2u);
  EXPECT_TRUE(nav.At(UsFromSeconds(118.5)).Has(NavField::kDepth));
  // Single ones that come that late are no clock.
  for (int i = 20; i < 40; ++i) {
    EXPECT_NE(nav.Insert(Depth(100.0 + i, 5.0 + 0.01 * i)), 0u) << i;
    EXPECT_EQ(nav.Insert(Depth(90.0 + i, 5.0)), 0u) << i;
  }
}

// What comes after a time from the future would all run backwards.
TEST(NavBuffer, OneTimeFromTheFutureIsNotBelieved) {
  NavBuffer nav = MakeBuffer();
  for (const double t : {98.0, 99.0, 100.0}) EXPECT_NE(nav.Insert(Depth(t, 5.0)), 0u);
  for (int i = 1; i < 5; ++i) {  // however often, with the truth between
    EXPECT_EQ(nav.Insert(Depth(1e6 + i, 6.0)), 0u);
    EXPECT_NE(nav.Insert(Depth(100.0 + i, 5.0)), 0u);
  }
  EXPECT_EQ(nav.rejected(NavReject::kOutOfRange), 4u);
  EXPECT_NE(nav.Insert(Depth(3600.0, 5.0)), 0u);  // not long without navigation
  // The clock was set: the third on the new time is believed, and what follows.
  EXPECT_EQ(nav.Insert(Depth(9000.0, 7.0)), 0u);
  EXPECT_EQ(nav.Insert(Depth(9001.0, 7.0)), 0u);
  EXPECT_NE(nav.Insert(Depth(9002.0, 7.0)), 0u);
  EXPECT_NE(nav.Insert(Depth(9003.0, 7.0)), 0u);
  EXPECT_TRUE(nav.At(UsFromSeconds(9003.0)).Has(NavField::kDepth));
}

// Nothing is known yet that the first could be held against: those that follow overrule it.
TEST(NavBuffer, AWrongFirstTimeIsOverruled) {
  for (const double wrong : {1e6, -1e6}) {
    NavBuffer nav = MakeBuffer();
    nav.Insert(Depth(wrong, 6.0));
    for (int i = 0; i < 5; ++i) EXPECT_NE(nav.Insert(Depth(100.0 + i, 5.0)), 0u) << wrong;
    EXPECT_TRUE(nav.At(UsFromSeconds(104.0)).Has(NavField::kDepth));
    EXPECT_TRUE(nav.At(UsFromSeconds(102.5)).Has(NavField::kDepth));
    EXPECT_FALSE(nav.At(UsFromSeconds(wrong)).Has(NavField::kDepth));
    EXPECT_EQ(nav.Insert(Depth(1e6, 5.0)), 0u);
  }
  // Sensors whose clocks never agree do not make each other forget.
  NavBuffer nav = MakeBuffer();
  for (int i = 0; i < 40; ++i) {
    nav.Insert(Attitude(100.0 + i, Quat::Identity()));
    nav.Insert(Depth(-1e6 + i, 5.0));
  }
  EXPECT_TRUE(nav.At(UsFromSeconds(139.0)).Has(NavField::kAttitude));
  EXPECT_TRUE(nav.At(UsFromSeconds(138.5)).Has(NavField::kAttitude));
}

TEST(NavBuffer, DeadReckonsACircleWithinItsCovariance) {
  // Forward speed 0.5 m/s while turning at 0.1 rad/s: a circle of radius 5 m; depth rises by a
  // ramp.
  const double speed = 0.5, rate = 0.1, descent = 0.02, end = 20.0;
  const auto fill = [&](NavBuffer* nav, double noise, Rng* rng) {
    for (double t = 0.0; t <= end + 0.3; t += 0.05)
      nav->Insert(Attitude(t, ExpSo3(Vec3(0, 0, rate * t))));
    for (double t = 0.0; t <= end + 0.3; t += 0.2) {
      const Vec3 e = noise * Vec3(rng->Gaussian(), rng->Gaussian(), rng->Gaussian());
      nav->Insert(Velocity(t, Vec3(speed, 0, descent) + e));
    }
    for (double t = 0.0; t <= end + 0.3; t += 1.0) nav->Insert(Depth(t, 3.0 + descent * t));
  };
  const Vec3 expected(speed / rate * std::sin(rate * end),
                      speed / rate * (1 - std::cos(rate * end)), descent * end);
  Rng rng(11);
  NavBuffer exact = MakeBuffer();
  fill(&exact, 0.0, &rng);
  const auto motion = exact.DeadReckon(0, UsFromSeconds(end), Defaults());
  ASSERT_TRUE(motion.has_value());
  EXPECT_LT((motion->displacement_ned_m - expected).norm(), 1e-3);  // trapezoids on a curve

  // With white velocity noise the squared Mahalanobis distance averages below three dimensions'
  // worth: the covariance holds an attitude error besides, which is absent here.
  NavSample defaults = Defaults();
  defaults.sigma_attitude_rad = Vec3::Constant(1e-9);
  double sum = 0.0;
  for (int run = 0; run < 200; ++run) {
    NavBuffer nav = MakeBuffer();
    fill(&nav, 0.01, &rng);
    const auto noisy = nav.DeadReckon(0, UsFromSeconds(end), defaults);
    ASSERT_TRUE(noisy.has_value());
    const Eigen::Vector2d error = (noisy->displacement_ned_m - expected).head<2>();
    const Mat2 covariance = noisy->covariance_m2.topLeftCorner<2, 2>();
    sum += error.dot(covariance.inverse() * error);
  }
  EXPECT_NEAR(sum / 200.0, 2.0, 0.5);
}

TEST(NavBuffer, DepthBoundsTheVertical) {
  NavBuffer nav = MakeBuffer();
  for (double t = 0.0; t <= 10.0; t += 0.2) {
    nav.Insert(Attitude(t, Quat::Identity()));
    nav.Insert(Velocity(t, Vec3(0.3, 0.0, 0.05)));  // the vertical velocity is wrong: depth is flat
    nav.Insert(Depth(t, 7.0));
  }
  NavSample defaults = Defaults();
  defaults.sigma_depth_m = 1e-4;
  defaults.sigma_attitude_rad = Vec3::Constant(1e-9);  // else a pitch error would explain it
  const auto motion = nav.DeadReckon(0, UsFromSeconds(10.0), defaults);
  ASSERT_TRUE(motion.has_value());
  EXPECT_NEAR(motion->displacement_ned_m.z(), 0.0, 1e-3);
  EXPECT_LT(motion->covariance_m2(2, 2), 1e-6);
  EXPECT_NEAR(motion->displacement_ned_m.x(), 3.0, 1e-6);
}

TEST(NavBuffer, DeadReckoningSaysWhatIsMissing) {
  NavBuffer nav = MakeBuffer();
  for (double t = 0.0; t <= 10.0; t += 0.1) nav.Insert(Attitude(t, Quat::Identity()));
  EXPECT_STREQ(nav.DeadReckon(0, 1000000, Defaults()).error().where, "velocity");
  for (double t = 0.0; t <= 3.0; t += 0.5) nav.Insert(Velocity(t, Vec3::UnitX()));
  for (double t = 6.0; t <= 10.0; t += 0.5) nav.Insert(Velocity(t, Vec3::UnitX()));
  EXPECT_TRUE(nav.DeadReckon(0, 3000000, Defaults()).has_value());
  EXPECT_STREQ(nav.DeadReckon(0, 8000000, Defaults()).error().where, "velocity");
  EXPECT_EQ(nav.DeadReckon(3000000, 2000000, Defaults()).error().code, Errc::kOutOfOrder);
}

// The sums of a factor are those of dead reckoning, and its two matrices what a small misalignment
// and a lever do to them.
TEST(NavBuffer, IntegratesWhatAFactorNeeds) {
  const auto make = [](const Vec3& misalignment) {
    NavBuffer nav = MakeBuffer();
    for (int i = 0; i <= 100; ++i) {
      const double t = 0.1 * i;
      nav.Insert(Attitude(t, ExpSo3(Vec3(0.1 * std::sin(t), 0.05, 0.4 * t))));
      nav.Insert(Velocity(t, ExpSo3(misalignment) * Vec3(0.5, 0.1 * std::cos(t), 0.02)));
    }
    return nav;
  };
  const NavBuffer nav = make(Vec3::Zero());
  const Utime start = UsFromSeconds(1.23), end = UsFromSeconds(7.81);
  const auto sums = nav.IntegrateVelocity(start, end, Defaults());
  const auto reckoned = nav.DeadReckon(start, end, Defaults());
  ASSERT_TRUE(sums && reckoned);
  EXPECT_LT((sums->displacement_ned_m - reckoned->displacement_ned_m).norm(), 1e-12);
  EXPECT_LT((sums->turned - (reckoned->ned_from_body_end.toRotationMatrix() -
                             reckoned->ned_from_body_start.toRotationMatrix()))
                .norm(),
            1e-12);
  const Vec3 misalignment(0.002, -0.003, 0.004);
  const auto turned = make(misalignment).IntegrateVelocity(start, end, Defaults());
  ASSERT_TRUE(turned);
  // Measured = true + misalignment x v, so that the truth is the measured sum plus B m.
  EXPECT_LT((turned->displacement_ned_m + turned->by_misalignment * misalignment -
             sums->displacement_ned_m)
                .norm(),
            1e-4);
  EXPECT_GT((turned->displacement_ned_m - sums->displacement_ned_m).norm(), 5e-3);
  EXPECT_STREQ(nav.IntegrateVelocity(0, UsFromSeconds(30.0), Defaults()).error().where, "attitude");
  EXPECT_EQ(nav.IntegrateVelocity(end, start, Defaults()).error().code, Errc::kOutOfOrder);
}

TEST(NavBuffer, WhatComesAfterItsTimeIsRefusedAndCounted) {
  NavBuffer nav = MakeBuffer();
  nav.Insert(Depth(10.0, 3.0));
  nav.SetHorizon(UsFromSeconds(9.0));
  EXPECT_NE(nav.Insert(Depth(9.5, 3.0)), 0u);  // late, and still of use
  EXPECT_EQ(nav.Insert(Depth(8.5, 3.0)), 0u);
  EXPECT_EQ(nav.rejected(NavReject::kTooLate), 1u);
  nav.SetHorizon(UsFromSeconds(5.0));  // never goes back
  EXPECT_EQ(nav.Insert(Depth(8.6, 3.0)), 0u);
  EXPECT_EQ(nav.rejected(NavReject::kTooLate), 2u);
}

TEST(NavBuffer, AllocatesOnlyWhenMade) {
  NavBuffer nav = MakeBuffer(64);
  Rng rng(2);
  MallocTrap trap;
  for (int i = 0; i < 1000; ++i) {
    nav.Insert(Depth(0.1 * i, 1.0));
    nav.Insert(Velocity(0.1 * i, Vec3(0.1, 0, 0)));
    nav.Insert(Attitude(0.1 * i, ExpSo3(Vec3(0, 0, rng.Uniform(-kPi, kPi)))));
    nav.At(UsFromSeconds(0.1 * i - 0.05));
    nav.DeadReckon(UsFromSeconds(0.1 * i - 1.0), UsFromSeconds(0.1 * i - 0.02), Defaults())
        .has_value();
  }
  EXPECT_EQ(trap.count(), 0u);
}

TEST(LeverArm, SwingsWithTheBody) {
  NavMotion motion;
  motion.ned_from_body_end = ExpSo3(Vec3(0, 0, kPi / 2));  // turns right on the spot
  const Rigid3 body_from_camera(Quat::Identity(), Vec3(1.0, 0.0, 0.0));
  EXPECT_LT((CameraDisplacement(motion, body_from_camera) - Vec3(-1, 1, 0)).norm(), 1e-12);
  const Rigid3 ned_from_body(motion.ned_from_body_end, Vec3(3, 2, 1));
  const Rigid3 camera_from_ned = CameraFromNed(ned_from_body, body_from_camera);
  EXPECT_LT((camera_from_ned.OriginOfTarget() - Vec3(3, 3, 1)).norm(), 1e-12);
  EXPECT_LT((NedFromBody(camera_from_ned, body_from_camera).translation - Vec3(3, 2, 1)).norm(),
            1e-12);
  // A sensor one metre ahead of a body that turns right at 0.5 rad/s moves right at 0.5 m/s.
  EXPECT_LT(BodyVelocity(Vec3(0, 0.5, 0), Vec3(0, 0, 0.5), Vec3(1, 0, 0)).norm(), 1e-12);
}

}  // namespace
}  // namespace rsfm
