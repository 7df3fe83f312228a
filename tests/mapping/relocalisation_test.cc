// After a gap, over ground that has left the map long ago.
#include <gtest/gtest.h>

#include <cstdio>
#include <optional>
#include <vector>

#include "tests/mapping/simulated_flight.h"

namespace rsfm {
namespace {

struct Gap {
  std::vector<StepReport> reports;
  std::vector<std::optional<Vec3>> errors;  // of the body's position
  int recognised = -1;                      // frame
  std::size_t heap_calls = 0;
};

// Out, 10 s of black from the turn on, and back over the way out, which has left the map.
SimulatedMissionOptions OutAndBlackAndBack(bool has_velocity) {
  SimulatedMissionOptions options = PassesSideBySide(2);
  options.max_features = 130;
  options.has_velocity = has_velocity;
  options.has_altitude = !has_velocity;
  options.blind_from_s = 32.0;
  options.blind_to_s = 42.0;
  return options;
}

Gap FlyOver(const SimulatedMission& mission, IncrementalMapper* mapper) {
  mission.FeedNav(&mapper->nav().buffer());
  Gap gap;
  for (int frame = 0; frame < mission.num_frames(); ++frame) {
    const FeatureFrame seen = mission.See(frame);
    const FrameObservations view = seen.View(mission.UtimeOf(frame));
    MallocTrap trap;
    const StepReport report = mapper->Step(view).value();
    gap.heap_calls += trap.count();
    gap.reports.push_back(report);
    gap.errors.emplace_back();
    if (report.recognised_keyframe >= 0 && gap.recognised < 0) gap.recognised = frame;
    if (!report.has_pose) continue;
    const BodyPose body = ToBodyPose(report.camera_from_world, report.covariance, DownwardCamera());
    gap.errors.back() =
        body.world_from_body.translation - mission.Body(mission.TimeOf(frame)).translation;
  }
  return gap;
}

class Relocalisation : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Navigation, Relocalisation, ::testing::Bool(), [](const auto& log) {
  return std::string(log.param ? "WithLog" : "WithoutLog");
});

TEST_P(Relocalisation, APlaceIsRecognisedAfterTheMapHasForgottenIt) {
  const SimulatedMission mission(OutAndBlackAndBack(GetParam()));
  MapperOptions options = mission.Mapper();
  options.max_keyframes = 10;
  options.window_keyframes = 5;  // 1.25 m: the place that it comes back to is not in it
  const auto mapper = MakeMapper(mission, options);
  const Gap gap = FlyOver(mission, mapper.get());
  EXPECT_EQ(gap.heap_calls, 0u);
  const int first_blind = 64, first_seen = 84;
  const StepReport& before = gap.reports[first_blind - 1];
  ASSERT_EQ(before.state, MapperState::kTracking);
  for (int frame = first_blind; frame < first_seen; ++frame) {
    const StepReport& report = gap.reports[static_cast<std::size_t>(frame)];
    EXPECT_EQ(report.has_pose, GetParam()) << frame;
    const int lost = frame - first_blind + 1;
    const auto state = GetParam()                                  ? MapperState::kDeadReckoning
                       : lost < options.lost_frames_before_restart ? MapperState::kRelocalising
                                                                   : MapperState::kLost;
    EXPECT_EQ(report.state, state) << frame;
  }
  // The first image after it is enough, and the world is the same.
  ASSERT_EQ(gap.recognised, first_seen);
  const StepReport& found = gap.reports[first_seen];
  EXPECT_EQ(found.state, MapperState::kTracking);
  EXPECT_EQ(found.world, before.world);
  // Without navigation nobody could know that the pose would be there: a jump. With it, only where
  // it is farther off than it should be.
  if (!GetParam()) {
    EXPECT_EQ(found.reset_counter, before.reset_counter + 1);
  }
  // As far off as that place was when it was new, and not as what came between.
  const auto frame_of_place = static_cast<std::size_t>(found.recognised_keyframe);
  ASSERT_LT(frame_of_place, 50u);
  const Vec3 off = *gap.errors[first_seen] - *gap.errors[frame_of_place];
  std::printf("recognised %zu, %.3f m from where it was\n", frame_of_place, off.norm());
  // Without a log the scale is the altimeter's, to a per cent.
  EXPECT_LT(off.norm(), GetParam() ? 0.06 : 0.15);
  for (std::size_t frame = first_seen; frame < gap.reports.size(); ++frame) {
    EXPECT_EQ(gap.reports[frame].state, MapperState::kTracking) << frame;
    EXPECT_EQ(gap.reports[frame].world, before.world) << frame;
    EXPECT_LT((*gap.errors[frame] - *gap.errors[frame_of_place]).norm(), GetParam() ? 0.15 : 0.3)
        << frame;
  }
  // The keyframe that was recognised is a node of the way now, and its place a loop in it.
  EXPECT_GT(mapper->loops().num_closed(), 0);
  EXPECT_EQ(mapper->loops().num_refused(), 0);
}

// The same flight without an archive: without navigation the world ends, and a new one begins.
TEST(RelocalisationWorld, WithoutPlacesANewWorldBegins) {
  const SimulatedMission mission(OutAndBlackAndBack(false));
  MapperOptions options = mission.Mapper();
  options.max_keyframes = 10;
  options.window_keyframes = 5;
  options.max_places = 0;
  const auto mapper = MakeMapper(mission, options);
  const Gap gap = FlyOver(mission, mapper.get());
  EXPECT_EQ(gap.recognised, -1);
  EXPECT_GT(gap.reports.back().world, gap.reports[63].world);
}

// A seabed that looks the same somewhere else: navigation does not let it be taken for the place.
void FlyToALookAlike(double heading_bias_sigma_deg, double max_error_m) {
  SimulatedMissionOptions mission_options = OutAndBlackAndBack(true);
  mission_options.legs = 1;
  mission_options.leg_m = 30.0;
  mission_options.repeat_m = 12.0;
  const SimulatedMission mission(mission_options);
  MapperOptions options = mission.Mapper();
  options.heading_bias_sigma_deg = heading_bias_sigma_deg;
  options.max_keyframes = 10;
  options.window_keyframes = 5;
  const auto mapper = MakeMapper(mission, options);
  const Gap gap = FlyOver(mission, mapper.get());
  EXPECT_EQ(gap.recognised, -1);
  EXPECT_EQ(gap.reports.back().state, MapperState::kTracking);
  EXPECT_LT((*gap.errors.back() - *gap.errors[10]).norm(), max_error_m);
}

TEST(RelocalisationWorld, ALookAlikeFarFromNavigationIsNotThePlace) { FlyToALookAlike(0.1, 0.2); }

// The whole way may be turned then: by a degree, 0.5 m at its end. The look-alike is 12 m away.
TEST(RelocalisationWorld, NorWhereTheHeadingIsHardlyKnown) { FlyToALookAlike(20.0, 1.0); }

}  // namespace
}  // namespace rsfm
