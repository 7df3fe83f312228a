// Waiting, tracking, dead reckoning, relocalising, lost, and back: what is published and announced.
#include "tests/mapping/survey.h"

namespace rsfm {
namespace {

TEST(MapperStates, DeadReckonsThroughAnOutageAndReturnsWithoutAJump) {
  SurveyFlight survey(TestPort::kFlat, TestOptions());
  survey.FeedNav(40.0);
  double last_sigma = 0.0;
  Vec3 offset = Vec3::Zero();
  for (int frame = 0; frame < 30; ++frame) {
    const bool blind = frame >= 12 && frame < 17;
    const StepReport report = survey.Fly(frame, blind);
    if (frame == 0) continue;
    ASSERT_TRUE(report.has_pose) << frame;
    // What it sees after the outage is new: it takes a pair of frames to go on.
    const bool is_pair = frame == 17 || frame == 18;
    if (!is_pair) {
      EXPECT_EQ(report.state, blind ? MapperState::kDeadReckoning : MapperState::kTracking)
          << frame;
    }
    EXPECT_EQ(report.reset_counter, 0);
    const Vec3 error =
        report.camera_from_world.OriginOfTarget() - survey.TrueCamera(frame).OriginOfTarget();
    if (frame == 1) offset = Vec3(error.x(), error.y(), 0.0);
    EXPECT_LT((error - offset).norm(), 0.15) << frame;
    const BodyPose body = ToBodyPose(report.camera_from_world, report.covariance, DownwardCamera());
    const double sigma = std::sqrt(body.covariance.topLeftCorner<3, 3>().trace());
    if (blind) {
      EXPECT_GT(sigma, last_sigma) << "grows without vision";
    }
    last_sigma = sigma;
  }
}

// Tiles, ripples, mussel beds: what comes after an outage looks exactly like what was mapped before
// it. Only navigation tells them apart.
void FlyOverALookAlike(const MapperOptions& options) {
  FeatureWorldOptions look_alike;
  look_alike.repeat_m = 6.0;
  SurveyFlight survey(TestPort::kFlat, options, look_alike);
  survey.FeedNav(50.0);
  int tracked_after = 0;
  Vec3 offset = Vec3::Zero();
  for (int frame = 0; frame < 40; ++frame) {
    const bool blind = frame >= 14 && frame < 22;
    const StepReport report = survey.Fly(frame, blind);
    if (frame == 0) continue;
    ASSERT_TRUE(report.has_pose) << frame;
    EXPECT_EQ(report.reset_counter, 0);
    const Vec3 error =
        report.camera_from_world.OriginOfTarget() - survey.TrueCamera(frame).OriginOfTarget();
    if (frame == 1) offset = Vec3(error.x(), error.y(), 0.0);
    EXPECT_LT((error - offset).norm(), 0.25) << frame;
    tracked_after += frame >= 22 && report.state == MapperState::kTracking;
  }
  EXPECT_GE(tracked_after, 15);
}

TEST(MapperStates, IsNotDrawnBackToABottomThatLooksTheSame) { FlyOverALookAlike(TestOptions()); }

// What is not known of the heading makes the world's place uncertain by metres, not the motion.
TEST(MapperStates, NorWhereTheHeadingIsHardlyKnown) {
  MapperOptions options = TestOptions();
  options.heading_bias_sigma_deg = 20.0;
  FlyOverALookAlike(options);
}

// Without a log no navigation spans an outage, but no vehicle is 3 m away in two seconds.
TEST(MapperStates, NorFartherThanTheVehicleGoes) {
  FeatureWorldOptions look_alike;
  look_alike.repeat_m = 6.0;
  MapperOptions options = TestOptions();
  options.max_speed_mps = 0.5;
  SurveyFlight survey(TestPort::kFlat, options, look_alike);
  survey.FeedNavWithoutLog(50.0);
  for (int frame = 0; frame < 22; ++frame) survey.Fly(frame);
  ASSERT_TRUE(survey.Fly(22).scale_is_metric);
  // 3 m on all looks as it did 3 m before, and nothing of what was seen last is in sight.
  for (const int frame : {32, 33}) {
    const FeatureWorld world(look_alike);
    const FeatureFrame seen =
        world.See(TestCamera(TestPort::kFlat), survey.TrueCamera(frame), frame);
    const auto report = survey.mapper().Step(seen.View(UsFromSeconds(frame - 8 + 100.0)));
    ASSERT_TRUE(report.has_value());
    EXPECT_NE(report->state, MapperState::kTracking) << frame;
  }
}

// The same without navigation is what the tests above are worth: the wrong place is taken.
TEST(MapperStates, WithoutNavigationALookAlikeIsTakenForThePlace) {
  FeatureWorldOptions look_alike;
  look_alike.repeat_m = 6.0;
  SurveyFlight survey(TestPort::kFlat, TestOptions(), look_alike);
  for (int frame = 0; frame < 22; ++frame) survey.Fly(frame, frame >= 14);
  const StepReport report = survey.Fly(24);
  EXPECT_EQ(report.state, MapperState::kTracking);
  EXPECT_FALSE(report.scale_is_metric);
  const Map& map = survey.mapper().map();
  const auto distance_to = [&](int frame) {
    for (const SlotId id : map.keyframes()) {
      if (map.keyframe(id).utime == UsFromSeconds(frame / kFrameRate + 100.0))
        return (map.keyframe(id).camera_from_world.OriginOfTarget() -
                report.camera_from_world.OriginOfTarget())
            .norm();
    }
    return -1.0;
  };
  // In truth it is 6 m from the frame 4 and 3.3 m from the frame 13.
  EXPECT_LT(distance_to(4), 0.5 * distance_to(13)) << "a period from where it is";
}

TEST(MapperStates, FindsItselfAgainWithoutNavigation) {
  SurveyFlight survey(TestPort::kNone, TestOptions());
  for (int frame = 0; frame < 15; ++frame) survey.Fly(frame);
  for (int frame = 15; frame < 20; ++frame) {
    const StepReport report = survey.Fly(frame, true);
    EXPECT_EQ(report.state, MapperState::kRelocalising);
    EXPECT_FALSE(report.has_pose);
  }
  // Back over a place far behind the newest keyframes: those of the frames 2 ... 5.
  const AnyCamera camera = TestCamera(TestPort::kNone);
  const FeatureWorld world(FeatureWorldOptions{});
  const Rigid3 old_place = survey.TrueCamera(4);
  const FeatureFrame seen = world.See(camera, old_place, 1234);
  const auto report = survey.mapper().Step(seen.View(UsFromSeconds(130.0)));
  ASSERT_TRUE(report.has_value());
  EXPECT_EQ(report->state, MapperState::kTracking);
  EXPECT_EQ(report->reset_counter, 0);
  // Where it was then, in the map's own scale.
  const Map& map = survey.mapper().map();
  const Vec3 here = report->camera_from_world.OriginOfTarget();
  double nearest = 1e9;
  for (const SlotId id : map.keyframes()) {
    if (map.keyframe(id).utime == UsFromSeconds(104.0))
      nearest = (map.keyframe(id).camera_from_world.OriginOfTarget() - here).norm();
  }
  EXPECT_LT(nearest, 0.05);
}

TEST(MapperStates, ALongLossWithoutNavigationBeginsANewWorldAndSaysSo) {
  MapperOptions options = TestOptions();
  options.lost_frames_before_restart = 4;
  SurveyFlight survey(TestPort::kNone, options);
  for (int frame = 0; frame < 8; ++frame) survey.Fly(frame);
  StepReport report;
  for (int frame = 30; frame < 40; ++frame) report = survey.Fly(frame);  // elsewhere
  EXPECT_EQ(report.state, MapperState::kTracking);
  EXPECT_EQ(report.reset_counter, 1);
}

// The lens cap is on: images come, and show nothing. Then it is off.
TEST(MapperStates, WaitsUnderTheLensCap) {
  SurveyFlight survey(TestPort::kFlat, TestOptions());
  survey.FeedNav(30.0);
  for (int frame = 0; frame < 5; ++frame) {
    const auto report = survey.mapper().Step({UsFromSeconds(frame / kFrameRate + 100.0), {}, {}});
    ASSERT_TRUE(report.has_value());
    EXPECT_EQ(report->state, MapperState::kWaiting);
    EXPECT_FALSE(report->has_pose);
  }
  EXPECT_EQ(survey.Fly(5).state, MapperState::kInitialising);
  EXPECT_EQ(survey.Fly(6).state, MapperState::kTracking);
  const auto report = survey.mapper().Step({UsFromSeconds(107.0), {}, {}});  // the cap again
  ASSERT_TRUE(report.has_value());
  EXPECT_EQ(report->state, MapperState::kDeadReckoning);
  EXPECT_EQ(survey.Fly(8).reset_counter, 0);
}

// Nothing to see and nothing to reckon with: it says so, and how long; what was known of the place
// is not published meanwhile.
TEST(MapperStates, AnOutageWithoutNavigationIsALossAndThenANewWorld) {
  MapperOptions options = TestOptions();
  options.lost_frames_before_restart = 6;
  SurveyFlight survey(TestPort::kFlat, options);
  for (int frame = 0; frame < 8; ++frame) survey.Fly(frame);
  for (int frame = 8; frame < 20; ++frame) {
    const StepReport report = survey.Fly(frame, true);
    EXPECT_EQ(report.state, frame < 13 ? MapperState::kRelocalising : MapperState::kLost) << frame;
    EXPECT_FALSE(report.has_pose);
    EXPECT_EQ(report.reset_counter, 0);
  }
  StepReport report;
  for (int frame = 40; frame < 44; ++frame) report = survey.Fly(frame);
  EXPECT_EQ(report.state, MapperState::kTracking);
  EXPECT_EQ(report.reset_counter, 1);
  EXPECT_EQ(report.world, 1);
  for (const SlotId id : survey.mapper().map().keyframes()) {
    const Keyframe& keyframe = survey.mapper().map().keyframe(id);
    EXPECT_TRUE(!keyframe.is_placed || keyframe.world == 1);
  }
}

// The log is off while an image shows nothing: the known ground that comes back is not where its
// covariance says. That jump is announced, in the same world; one within three sigmas is none.
TEST(MapperStates, AReturnFartherThanThreeSigmasIsAnnounced) {
  for (const double off_mps : {0.0, 0.1}) {
    SurveyFlight survey(TestPort::kFlat, TestOptions());
    survey.FeedNav(40.0, -1.0, off_mps, 9.0, 11.0);
    StepReport report;
    for (int frame = 0; frame < 16; ++frame) {
      const bool blind = frame == 10;
      report = survey.Fly(frame, blind);
      const auto wanted = blind ? MapperState::kDeadReckoning : MapperState::kTracking;
      EXPECT_TRUE(frame == 0 || report.state == wanted) << frame;
      EXPECT_EQ(report.reset_counter, off_mps > 0.0 && frame >= 11 ? 1 : 0) << frame;
      EXPECT_EQ(report.world, 0);
    }
    EXPECT_EQ(survey.heap_calls(), 0u);
  }
}

}  // namespace
}  // namespace rsfm
