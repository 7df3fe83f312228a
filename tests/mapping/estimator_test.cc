// The estimator on simulated surveys: how far off it is, and whether it knows.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <vector>

#include "tests/mapping/simulated_flight.h"

namespace rsfm {
namespace {

// The mean NEES of the last pose over twelve flights lies in the 95 % band: of stills, of a video
// between keyframes, and after an outage; in one it may be below.
struct ConsistencyCase {
  const char* name;
  int num_frames, least_tracking;
  double frame_rate_hz;
  int keyframe_every;
  double blind_from_s, blind_to_s;
};
void PrintTo(const ConsistencyCase& c, std::ostream* out) { *out << c.name; }

class Consistency : public ::testing::TestWithParam<ConsistencyCase> {};
INSTANTIATE_TEST_SUITE_P(Cases, Consistency,
                         ::testing::Values(ConsistencyCase{"Stills", 36, 35, 2.0, 1, 0.0, 0.0},
                                           ConsistencyCase{"Video", 129, 120, 10.0, 5, 0.0, 0.0},
                                           ConsistencyCase{"InAnOutage", 36, 19, 2.0, 1, 10.0,
                                                           20.0},
                                           ConsistencyCase{"AfterIt", 48, 35, 2.0, 1, 10.0, 15.0}),
                         [](const auto& c) { return std::string(c.param.name); });

TEST_P(Consistency, NeesIsInTheBand) {
  constexpr int kRuns = 12;
  double sum = 0.0;
  bool is_seeing = true;
  for (int run = 0; run < kRuns; ++run) {
    SimulatedMissionOptions options;
    options.seed = static_cast<std::uint64_t>(run) + 1;
    options.legs = 1;
    options.heading_bias_deg = 1.0;
    options.max_features = 110;
    options.points_per_m2 = 9.0;
    options.frame_rate_hz = GetParam().frame_rate_hz;
    options.keyframe_every = GetParam().keyframe_every;
    options.blind_from_s = GetParam().blind_from_s;
    options.blind_to_s = GetParam().blind_to_s;
    const SimulatedMission mission(options);
    const auto mapper = MakeMapper(mission, mission.Mapper());
    const Flight flight = Fly(mission, mapper.get(), GetParam().num_frames);
    ASSERT_GE(flight.num_tracking, GetParam().least_tracking);
    EXPECT_EQ(flight.heap_calls, 0u);
    ASSERT_TRUE(flight.reports.back().has_pose);
    is_seeing &= flight.reports.back().state == MapperState::kTracking;
    sum += flight.nees.back();
  }
  const double mean = sum / kRuns;
  RecordProperty("nees", std::to_string(mean));
  std::printf("mean NEES %.2f of 6\n", mean);
  // The 95 % band of chi-square with 72 degrees of freedom over 12 runs.
  if (is_seeing) {
    EXPECT_GT(mean, 50.4 / kRuns);
  }
  EXPECT_LT(mean, 97.4 / kRuns);
}

// Points that were missed for a while and are found again are no revisit: the old keyframes that
// saw them know the yaw no better than the compass, whose bias nobody knows.
TEST(Estimator, PointsFoundAgainAreNoRevisit) {
  SimulatedMissionOptions options;
  options.legs = 1;
  options.speed_mps = 0.12;  // a point is in sight for some 30 keyframes
  options.heading_bias_deg = 2.0;
  options.missed = 0.04;
  options.max_features = 300;
  const SimulatedMission mission(options);
  const auto mapper = MakeMapper(mission, mission.Mapper());
  const Flight flight = Fly(mission, mapper.get(), 70);
  const auto yaw_sigma_rad = [&](std::size_t frame) {
    const StepReport& report = flight.reports[frame];
    const BodyPose body = ToBodyPose(report.camera_from_world, report.covariance, DownwardCamera());
    return std::sqrt(body.covariance(5, 5));
  };
  ASSERT_EQ(flight.reports.size(), 70u);
  const double at_start = yaw_sigma_rad(12);
  EXPECT_GT(at_start, 0.03);
  for (std::size_t frame = 12; frame < 70; ++frame)
    EXPECT_GT(yaw_sigma_rad(frame), 0.95 * at_start) << frame;
}

TEST(Estimator, BeatsDeadReckoning) {
  SimulatedMissionOptions options;
  options.legs = 3;
  options.heading_bias_deg = 1.0;
  const SimulatedMission mission(options);
  const auto mapper = MakeMapper(mission, mission.Mapper());
  const int frames = mission.num_frames();
  const Flight flight = Fly(mission, mapper.get(), frames);
  const double rmse = AlignedRmse(flight.found, flight.truth);
  const double reckoned = DeadReckonedRmse(mission, mapper->nav(), frames);
  std::printf("%.0f m: %.3f m (%.2f %%), dead reckoning %.3f m\n", mission.length_m(), rmse,
              100.0 * rmse / mission.length_m(), reckoned);
  EXPECT_LT(rmse, 0.003 * mission.length_m());
  EXPECT_GE(flight.num_tracking, frames - 2);
}

// Metric from any one source; from none, it says so.
TEST(Estimator, AnyOneSensorGivesTheScale) {
  struct Case {
    bool velocity, depth, altitude;
    double fix_every_s;
  };
  for (const Case& c :
       {Case{true, false, false, 0.0}, Case{false, true, false, 0.0}, Case{false, false, true, 0.0},
        Case{false, false, false, 2.0}, Case{false, false, false, 0.0}}) {
    SimulatedMissionOptions options;
    options.legs = 1;
    options.max_features = 110;
    options.points_per_m2 = 9.0;
    options.has_velocity = c.velocity;
    options.has_depth = c.depth;
    options.has_altitude = c.altitude;
    options.fix_every_s = c.fix_every_s;
    options.fix_sigma_m = 0.1;
    const SimulatedMission mission(options);
    const auto mapper = MakeMapper(mission, mission.Mapper());
    const Flight flight = Fly(mission, mapper.get(), 60);
    const bool has_any = c.velocity || c.depth || c.altitude || c.fix_every_s > 0.0;
    const StepReport& last = flight.reports.back();
    EXPECT_EQ(last.scale_is_metric, has_any) << c.velocity << c.depth << c.altitude;
    EXPECT_EQ(last.world_is_ned, has_any);
    EXPECT_EQ(flight.heap_calls, 0u);
    if (!has_any) continue;
    // The last two metres, after the announced jump, are two metres long: to twice the 5 % at which
    // a scale is taken for known.
    const std::size_t n = flight.found.size();
    const double found = (flight.found[n - 1] - flight.found[n - 9]).norm();
    const double truth = (flight.truth[n - 1] - flight.truth[n - 9]).norm();
    EXPECT_NEAR(found / truth, 1.0, 0.1) << c.velocity << c.depth << c.altitude;
    EXPECT_EQ(last.reset_counter, c.velocity ? 0 : 1);
  }
}

TEST(Estimator, DeadReckonsThroughAnOutageKnowingHowWell) {
  SimulatedMissionOptions options;
  options.legs = 1;
  options.max_features = 110;
  options.points_per_m2 = 9.0;
  options.blind_from_s = 8.0;
  options.blind_to_s = 18.0;
  const SimulatedMission mission(options);
  const auto mapper = MakeMapper(mission, mission.Mapper());
  const Flight flight = Fly(mission, mapper.get(), 52);
  double last_sigma = 0.0;
  int num_reckoned = 0;
  for (int frame = 2; frame < 52; ++frame) {
    const StepReport& report = flight.reports[static_cast<std::size_t>(frame)];
    const double t = mission.TimeOf(frame);
    const double sigma = std::sqrt(report.covariance.bottomRightCorner<3, 3>().trace());
    EXPECT_TRUE(report.has_pose);
    EXPECT_EQ(report.reset_counter, 0);
    if (t >= options.blind_from_s && t < options.blind_to_s) {
      EXPECT_EQ(report.state, MapperState::kDeadReckoning);
      EXPECT_GT(sigma, last_sigma);
      ++num_reckoned;
    }
    if (t >= options.blind_to_s + 1.5) {
      EXPECT_EQ(report.state, MapperState::kTracking) << frame;
    }
    last_sigma = sigma;
  }
  EXPECT_EQ(num_reckoned, 20);
  for (std::size_t i = 0; i < flight.nees.size(); ++i)
    EXPECT_LT(flight.nees[i], 33.0) << i;  // 1e-5 of chi-square with six
  EXPECT_LT((flight.found.back() - flight.found[1] - flight.truth.back() + flight.truth[1]).norm(),
            0.2);
}

// Out and back beside its own way, long after that has left the map: the loops that are found there
// correct the way and the pose, each jump is announced, and the world stays the same.
TEST(Estimator, RevisitsCloseLoops) {
  SimulatedMissionOptions options = PassesSideBySide(2);
  options.max_features = 130;
  options.heading_drift_deg = 10.0;
  const SimulatedMission mission(options);
  MapperOptions mapper_options = mission.Mapper();
  mapper_options.heading_drift_deg = 10.0;
  double end_error_m[2] = {};
  for (const bool with_loops : {false, true}) {
    mapper_options.max_places = with_loops ? 30 : 0;  // fewer than there are: they are thinned out
    mapper_options.max_way_nodes = 1000;
    const auto mapper = MakeMapper(mission, mapper_options);
    const Flight flight = Fly(mission, mapper.get(), mission.num_frames());
    end_error_m[with_loops] =
        (flight.found.back() - flight.found[0] - flight.truth.back() + flight.truth[0]).norm();
    EXPECT_EQ(flight.heap_calls, 0u);
    EXPECT_EQ(flight.reports.back().world, 0);
    EXPECT_EQ(mapper->loops().num_closed() > 10, with_loops);
    EXPECT_EQ(flight.reports.back().reset_counter > 0, with_loops);
    EXPECT_LE(mapper->loops().num_places(), 30);
    // No step of the pose between two frames is unannounced: the vehicle goes 0.25 m.
    for (std::size_t i = 2; i < flight.reports.size(); ++i) {
      if (flight.reports[i].reset_counter != flight.reports[i - 1].reset_counter) continue;
      EXPECT_LT((flight.found[i - 1] - flight.found[i - 2]).norm(), 0.35) << i;
    }
  }
  std::printf("out and back: %.3f m off, with loops %.3f m\n", end_error_m[0], end_error_m[1]);
  // Where chance has left no error, loops have none to take.
  EXPECT_LT(end_error_m[1], std::max(0.5 * end_error_m[0], 0.03));
}

// Six passes side by side while the water rises by 15 cm: where the depth has been measured it is
// the sensor's to say. Loops neither pull it back, step by step, nor are they refused for it.
TEST(Estimator, LoopsLeaveTheDepthAlone) {
  SimulatedMissionOptions options = PassesSideBySide(6);
  options.max_features = 110;
  options.tide_m = 0.15;
  const SimulatedMission mission(options);
  MapperOptions mapper_options = mission.Mapper();
  mapper_options.max_way_nodes = 1000;
  const auto mapper = MakeMapper(mission, mapper_options);
  const Flight flight = Fly(mission, mapper.get(), mission.num_frames());
  ASSERT_EQ(flight.found.size() + 1, static_cast<std::size_t>(mission.num_frames()));  // the first
  double worst_m = 0.0;
  for (std::size_t i = 10; i < flight.found.size(); ++i) {
    const double measured =
        flight.truth[i].z() + mission.Tide(mission.TimeOf(static_cast<int>(i) + 1));
    worst_m = std::max(worst_m, std::abs(flight.found[i].z() - measured));
  }
  std::printf("%d loops, %d refused: depth at most %.3f m off what is measured\n",
              mapper->loops().num_closed(), mapper->loops().num_refused(), worst_m);
  EXPECT_GT(mapper->loops().num_closed(), 150);
  EXPECT_LT(worst_m, 0.06);  // 0.15 where loops change the depth
}

// A fix that is 20 m off, a depth that stops: refused or outweighed, and counted.
TEST(Estimator, OneWrongSensorDoesNotTakeItAway) {
  SimulatedMissionOptions options;
  options.legs = 1;
  options.max_features = 110;
  options.points_per_m2 = 9.0;
  options.fix_every_s = 4.0;
  options.fix_sigma_m = 0.3;
  options.frozen_depth_from_s = 12.0;
  options.frozen_depth_to_s = 60.0;
  options.wrong_fixes_from_s = 13.0;
  options.wrong_fixes_to_s = 15.0;
  const SimulatedMission mission(options);
  const auto mapper = MakeMapper(mission, mission.Mapper());
  const Flight flight = Fly(mission, mapper.get(), 70);
  EXPECT_GT(mapper->adjuster().num_nav_outliers(), 0);
  for (std::size_t i = 4; i < flight.found.size(); ++i) {
    const Vec3 error = flight.found[i] - flight.truth[i];
    EXPECT_LT(error.head<2>().norm(), 0.8) << i;
    EXPECT_LT(std::abs(error.z()), 0.3) << i;
  }
}

// Navigation stamped 80 ms late: the offset is found, to a few of its own sigmas.
TEST(Estimator, FindsTheClocksOffset) {
  SimulatedMissionOptions options;
  options.legs = 2;
  options.leg_m = 8.0;
  options.clock_offset_s = 0.08;
  options.max_features = 110;
  options.points_per_m2 = 9.0;
  options.heading_deg = 0.2;
  const SimulatedMission mission(options);
  const auto mapper = MakeMapper(mission, mission.Mapper());
  Fly(mission, mapper.get(), mission.num_frames());
  const double found_s = mapper->adjuster().nav_states()[kClockOffset];
  const double sigma_s =
      std::sqrt(mapper->adjuster().nav_state_covariance()(kClockOffset, kClockOffset));
  std::printf("clock offset %.1f ms +- %.1f\n", 1e3 * found_s, 1e3 * sigma_s);
  // A stamp that runs ahead shows the truth of before: at its time, of minus the offset.
  EXPECT_NEAR(found_s, -0.08, 0.03);
  EXPECT_LT(sigma_s, 0.025);
}

// Whatever a sensor may send that is no measurement: refused, counted by reason, and the poses are
// the same to the last bit.
TEST(Estimator, BadNavigationChangesNothing) {
  SimulatedMissionOptions options;
  options.legs = 1;
  options.max_features = 110;
  options.points_per_m2 = 9.0;
  options.has_altitude = true;
  const SimulatedMission mission(options);
  const auto clean = MakeMapper(mission, mission.Mapper());
  const auto dirty = MakeMapper(mission, mission.Mapper());
  mission.FeedNav(&dirty->nav().buffer());
  NavBuffer& nav = dirty->nav().buffer();
  const auto rejected = [&](NavReject reason) { return nav.rejected(reason); };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 20; ++i) {
    NavSample bad;
    bad.utime = UsFromSeconds(SimulatedMission::kStart_s + 0.513 * i + 0.007);
    for (const NavField field : {NavField::kVelocity, NavField::kDepth, NavField::kAltitude,
                                 NavField::kPosition, NavField::kAttitude})
      bad.Set(field);
    bad.velocity_body_mps = Vec3(-32.768, 0.0, 0.0);
    bad.depth_m = kNan;
    bad.altitude_m = 0.0;
    bad.sigma_position_m = Vec3(-1.0, -1.0, -1.0);
    bad.ned_from_body.coeffs() = Vec4::Zero();
    EXPECT_EQ(nav.Insert(bad), 0u);
    NavSample jump;
    jump.utime = bad.utime + 1000;
    jump.Set(NavField::kVelocity);
    jump.velocity_body_mps = Vec3(80.0, 0.0, 0.0);
    EXPECT_EQ(nav.Insert(jump), 0u);
    NavSample repeated;
    repeated.utime = UsFromSeconds(SimulatedMission::kStart_s + (0.1 * (20 + 5 * i) - 2.0) + 0.0);
    repeated.Set(NavField::kDepth);
    repeated.depth_m = 3.0;
    EXPECT_EQ(nav.Insert(repeated), 0u);
  }
  EXPECT_EQ(rejected(NavReject::kNotFinite), 20u);
  EXPECT_EQ(rejected(NavReject::kSentinel), 60u);    // velocity, altitude, position
  EXPECT_EQ(rejected(NavReject::kOutOfRange), 40u);  // attitude, jump
  EXPECT_EQ(rejected(NavReject::kRepeated), 20u);
  const Flight a = Fly(mission, clean.get(), 16);
  std::vector<Vec3> found;
  for (int frame = 0; frame < 16; ++frame) {
    const FeatureFrame seen = mission.See(frame);
    const auto report = dirty->Step(seen.View(mission.UtimeOf(frame)));
    ASSERT_TRUE(report.has_value());
    if (report->has_pose)
      found.push_back(ToBodyPose(report->camera_from_world, report->covariance, DownwardCamera())
                          .world_from_body.translation);
  }
  EXPECT_EQ(found, a.found);
}

}  // namespace
}  // namespace rsfm
