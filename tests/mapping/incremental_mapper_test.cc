#include "rsfm/mapping/incremental_mapper.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <string>
#include <thread>

#include "tests/mapping/survey.h"

namespace rsfm {
namespace {

class MapperSurvey : public ::testing::TestWithParam<TestPort> {};
INSTANTIATE_TEST_SUITE_P(Ports, MapperSurvey,
                         ::testing::Values(TestPort::kNone, TestPort::kFlat, TestPort::kDome),
                         [](const auto& port) {
                           return std::string(port.param == TestPort::kNone   ? "None"
                                              : port.param == TestPort::kFlat ? "Flat"
                                                                              : "Dome");
                         });

TEST_P(MapperSurvey, WithNavigationIsMetricAndTrue) {
  SurveyFlight survey(GetParam(), TestOptions());
  survey.FeedNav(40.0);
  int placed = 0;
  Vec3 offset = Vec3::Zero();
  for (int frame = 0; frame < 40; ++frame) {
    const StepReport report = survey.Fly(frame);
    if (report.state != MapperState::kTracking) continue;
    EXPECT_TRUE(report.scale_is_metric);
    EXPECT_TRUE(report.world_is_ned);
    EXPECT_EQ(report.reset_counter, 0);
    // Without fixes the world starts where the vehicle did: north and east are relative.
    const Vec3 error =
        report.camera_from_world.OriginOfTarget() - survey.TrueCamera(frame).OriginOfTarget();
    if (placed++ == 0) offset = Vec3(error.x(), error.y(), 0.0);
    const double travelled = 0.3 * frame;
    EXPECT_LT((error - offset).norm(), 0.02 + 0.01 * travelled) << "frame " << frame;
    EXPECT_LT(AngleBetween(report.camera_from_world.rotation, survey.TrueCamera(frame).rotation),
              0.012);
    // The covariance is one, and the error is not absurd in its light.
    const BodyPose body = ToBodyPose(report.camera_from_world, report.covariance, DownwardCamera());
    EXPECT_GT(body.covariance.diagonal().minCoeff(), 0.0);
    EXPECT_LT(std::sqrt(body.covariance.topLeftCorner<3, 3>().trace()), 0.5);
  }
  EXPECT_GE(placed, 39);
  EXPECT_EQ(survey.heap_calls(), 0u);
}

// The camera is up before navigation, as on any vehicle: the scale is not given away for that.
TEST_P(MapperSurvey, AKeyframeFromBeforeNavigationDoesNotTakeTheScaleAway) {
  SurveyFlight survey(GetParam(), TestOptions());
  survey.FeedNav(12.0, 0.5 / kFrameRate);
  for (int frame = 0; frame < 10; ++frame) {
    const StepReport report = survey.Fly(frame);
    if (frame < 3) continue;
    EXPECT_EQ(report.state, MapperState::kTracking) << frame;
    EXPECT_TRUE(report.scale_is_metric);
    EXPECT_TRUE(report.world_is_ned);
  }
}

// An image is mapped before the navigation of its time has come: the world is NED all the same.
TEST_P(MapperSurvey, NavigationThatComesAfterTheFirstImageStillGivesTheWorld) {
  SurveyFlight survey(GetParam(), TestOptions());
  survey.Fly(0);
  survey.FeedNav(8.0);
  for (int frame = 1; frame < 6; ++frame) {
    const StepReport report = survey.Fly(frame);
    EXPECT_EQ(report.state, MapperState::kTracking) << frame;
    EXPECT_TRUE(report.scale_is_metric);
    EXPECT_TRUE(report.world_is_ned);
  }
}

TEST_P(MapperSurvey, WithoutNavigationHasTheShapeAndSaysTheScaleIsUnknown) {
  SurveyFlight survey(GetParam(), TestOptions());
  std::vector<Vec3> found, truth;
  for (int frame = 0; frame < 30; ++frame) {
    const StepReport report = survey.Fly(frame);
    EXPECT_FALSE(report.scale_is_metric);
    EXPECT_FALSE(report.world_is_ned);
    if (report.state != MapperState::kTracking) continue;
    found.push_back(report.camera_from_world.OriginOfTarget());
    truth.push_back(survey.TrueCamera(frame).OriginOfTarget());
  }
  ASSERT_GE(found.size(), 28u);
  Eigen::Matrix3Xd a(3, found.size()), b(3, found.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    a.col(static_cast<Eigen::Index>(i)) = found[i];
    b.col(static_cast<Eigen::Index>(i)) = truth[i];
  }
  const Mat4 similarity = Eigen::umeyama(a, b, true);
  const Eigen::Matrix3Xd aligned =
      (similarity.topLeftCorner<3, 3>() * a).colwise() + similarity.topRightCorner<3, 1>();
  const double rmse = std::sqrt((aligned - b).squaredNorm() / static_cast<double>(found.size()));
  EXPECT_LT(rmse, 0.09);  // 1 % of the 9 m: scale drifts where nothing holds it
  EXPECT_EQ(survey.heap_calls(), 0u);
}

TEST(IncrementalMapper, SmallCapacitiesEvictAndGoOn) {
  MapperOptions options = TestOptions();
  options.max_keyframes = 10;
  options.window_keyframes = 5;
  options.max_landmarks = 1500;
  SurveyFlight survey(TestPort::kFlat, options);
  survey.FeedNav(50.0);
  int placed = 0;
  for (int frame = 0; frame < 50; ++frame) {
    const StepReport report = survey.Fly(frame);
    placed += report.state == MapperState::kTracking;
    EXPECT_LE(survey.mapper().map().keyframes().size(), 10u);
    EXPECT_LE(survey.mapper().map().landmarks().size(), 1500u);
  }
  EXPECT_GE(placed, 49);
  const StepReport last = survey.Fly(50);
  const Vec3 moved = last.camera_from_world.OriginOfTarget();
  EXPECT_NEAR(moved.x() - survey.TrueCamera(0).OriginOfTarget().x(), 15.0, 0.3);
  EXPECT_EQ(survey.heap_calls(), 0u);
}

TEST(IncrementalMapper, KeyframesFromBeforeTheFirstPairArePlacedLater) {
  SurveyFlight survey(TestPort::kFlat, TestOptions());
  // Standing still: no parallax, no map.
  const AnyCamera camera = TestCamera(TestPort::kFlat);
  const FeatureWorld world(FeatureWorldOptions{});
  for (int i = 0; i < 3; ++i) {
    const FeatureFrame seen = world.See(camera, survey.TrueCamera(0), 50 + i);
    const auto report = survey.mapper().Step(seen.View(UsFromSeconds(99.0 + 0.1 * i)));
    ASSERT_TRUE(report.has_value());
    EXPECT_EQ(report->state, MapperState::kInitialising);
  }
  for (int frame = 1; frame < 6; ++frame) survey.Fly(frame);
  for (const SlotId id : survey.mapper().map().keyframes())
    EXPECT_TRUE(survey.mapper().map().keyframe(id).is_placed);
}

TEST(IncrementalMapper, TracksPlaceFramesBetweenKeyframes) {
  MapperOptions options = TestOptions();
  options.rhythm = Rhythm::kVideo;
  const AnyCamera camera = TestCamera(TestPort::kDome);
  const FeatureWorld world(FeatureWorldOptions{});
  auto mapper = IncrementalMapper::Create(options, camera, DownwardCamera()).value();
  int placed = 0;
  for (int frame = 0; frame < 80; ++frame) {  // 10 Hz, a keyframe every eighth
    const double seconds = 0.1 * frame;
    const Rigid3 truth = (SurveyBody(seconds) * DownwardCamera()).Inverse();
    FeatureFrame seen = world.See(camera, truth, frame);
    const bool is_keyframe = frame % 8 == 0;
    const auto view = seen.View(UsFromSeconds(100.0 + seconds), is_keyframe);
    MallocTrap trap;
    const auto report = mapper->Step(view);
    EXPECT_EQ(trap.count(), 0u);
    ASSERT_TRUE(report.has_value());
    placed += report->state == MapperState::kTracking;
    EXPECT_TRUE(is_keyframe || !report->keyframe.valid());
  }
  EXPECT_GE(placed, 70);  // all after the first pair
}

void Append(const StepReport& report, std::string* bytes) {
  double values[7 + 36];
  Quat::Coefficients::Map(values) = report.camera_from_world.rotation.coeffs();
  Vec3::Map(values + 4) = report.camera_from_world.translation;
  Mat6::Map(values + 7) = report.covariance;
  bytes->append(reinterpret_cast<const char*>(values), sizeof values);
}

TEST(IncrementalMapper, SameInputsSameBytesOut) {
  std::string first;
  for (int run = 0; run < 2; ++run) {
    SurveyFlight survey(TestPort::kFlat, TestOptions());
    survey.FeedNav(20.0);
    std::string bytes;
    for (int frame = 0; frame < 15; ++frame) Append(survey.Fly(frame), &bytes);
    if (run == 0) first = bytes;
    EXPECT_TRUE(bytes == first);
  }
}

// While another thread adjusts, navigation comes in and the map is read; whoever adjusts, and also
// where nobody does before the next frame, the same comes out.
TEST(IncrementalMapper, AnyThreadMayAdjust) {
  std::string first;
  for (const bool has_thread : {false, true}) {
    SurveyFlight survey(TestPort::kFlat, TestOptions());
    std::string bytes;
    int num_adjusted = 0;
    for (int frame = 0; frame < 15; ++frame) {
      const StepReport report = survey.Fly(frame);
      const bool is_due = survey.mapper().needs_adjustment();
      num_adjusted += is_due;
      std::thread adjustment;
      if (has_thread) adjustment = std::thread([&] { survey.mapper().AdjustWindow(); });
      survey.FeedNav(frame + 2.0, frame == 0 ? -1.0 : frame + 2.05);
      std::size_t observed = 0;
      for (const SlotId id : survey.mapper().map().keyframes())
        observed += survey.mapper().map().landmarks_of(id).size();
      EXPECT_TRUE(observed > 0 || frame < 2);
      if (has_thread) adjustment.join();
      EXPECT_EQ(survey.mapper().needs_adjustment(), is_due && !has_thread);
      Append(report, &bytes);
    }
    Append(survey.mapper().Finish(), &bytes);
    EXPECT_FALSE(survey.mapper().needs_adjustment());
    EXPECT_GE(num_adjusted, 12);
    if (!has_thread) first = bytes;
    EXPECT_TRUE(bytes == first);
  }
}

// A frame that was placed without descriptors becomes a keyframe afterwards: as one that had them
// from the start.
TEST(IncrementalMapper, AFrameBecomesAKeyframeOnceItsPoseIsOut) {
  const AnyCamera camera = TestCamera(TestPort::kFlat);
  const FeatureWorld world(FeatureWorldOptions{});
  const auto fly = [&](bool later) {
    SurveyFlight survey(TestPort::kFlat, TestOptions());
    survey.FeedNav(20.0);
    IncrementalMapper& mapper = survey.mapper();
    std::vector<Rigid3> poses;
    for (int frame = 0; frame < 15; ++frame) {
      const FeatureFrame seen = world.See(camera, survey.TrueCamera(frame), frame);
      const Utime utime = UsFromSeconds(100.0 + frame);
      const bool is_tracking = mapper.state() == MapperState::kTracking;
      MallocTrap trap;
      const auto placed = mapper.Step(seen.View(utime, !later || !is_tracking));
      if (later && is_tracking) {
        EXPECT_EQ(placed->state, MapperState::kTracking);
        EXPECT_FALSE(placed->keyframe.valid());
        EXPECT_FALSE(mapper.needs_adjustment());
        const auto keyframe = mapper.AddKeyframe(seen.View(utime));
        EXPECT_TRUE(keyframe->keyframe.valid());
        EXPECT_GT(keyframe->num_triangulated, 0);
        EXPECT_TRUE(mapper.needs_adjustment());
        EXPECT_LT((keyframe->camera_from_world.OriginOfTarget() -
                   placed->camera_from_world.OriginOfTarget())
                      .norm(),
                  0.02);
      }
      EXPECT_EQ(trap.count(), 0u);
    }
    mapper.Finish();
    for (const SlotId id : mapper.map().keyframes())
      poses.push_back(mapper.map().keyframe(id).camera_from_world);
    return poses;
  };
  const std::vector<Rigid3> at_once = fly(false), later = fly(true);
  ASSERT_EQ(at_once.size(), 15u);
  ASSERT_EQ(later.size(), at_once.size());
  for (std::size_t i = 0; i < later.size(); ++i)
    EXPECT_LT((later[i].OriginOfTarget() - at_once[i].OriginOfTarget()).norm(), 0.01) << i;
}

TEST(IncrementalMapper, OnlyTheLastPlacedFrameBecomesAKeyframe) {
  SurveyFlight survey(TestPort::kFlat, TestOptions());
  survey.FeedNav(20.0);
  const AnyCamera camera = TestCamera(TestPort::kFlat);
  const FeatureWorld world(FeatureWorldOptions{});
  const FeatureFrame seen = world.See(camera, survey.TrueCamera(5), 5);
  const auto refused = [&](const FrameObservations& frame, Errc code, const char* where) {
    const std::size_t num_keyframes = survey.mapper().map().keyframes().size();
    const auto report = survey.mapper().AddKeyframe(frame);
    ASSERT_FALSE(report.has_value());
    EXPECT_EQ(report.error().code, code);
    EXPECT_STREQ(report.error().where, where);
    EXPECT_EQ(survey.mapper().map().keyframes().size(), num_keyframes);
  };
  refused(seen.View(UsFromSeconds(105.0)), Errc::kOutOfOrder, "utime");  // no frame yet
  for (int frame = 0; frame < 5; ++frame) survey.Fly(frame);
  refused(seen.View(UsFromSeconds(105.0)), Errc::kOutOfOrder, "utime");  // not seen yet
  refused(seen.View(UsFromSeconds(104.0)), Errc::kOutOfOrder, "utime");  // is one
  ASSERT_TRUE(survey.mapper().Step(seen.View(UsFromSeconds(105.0), false)).has_value());
  refused(seen.View(UsFromSeconds(104.0)), Errc::kOutOfOrder, "utime");  // not the last
  refused(seen.View(UsFromSeconds(105.0), false), Errc::kInvalidArgument, "descriptors");
  FrameObservations wrong_type = seen.View(UsFromSeconds(105.0));
  wrong_type.descriptors.type = DescriptorType::kOrb;
  refused(wrong_type, Errc::kInvalidArgument, "descriptors");
  EXPECT_TRUE(survey.mapper().AddKeyframe(seen.View(UsFromSeconds(105.0))).has_value());
  survey.mapper().Finish();
  refused(seen.View(UsFromSeconds(105.0)), Errc::kOutOfOrder, "utime");  // is one by now
  const FeatureFrame empty;
  ASSERT_TRUE(survey.mapper().Step(empty.View(UsFromSeconds(106.0))).has_value());
  refused(seen.View(UsFromSeconds(106.0)), Errc::kOutOfOrder, "utime");  // was not placed
}

TEST(IncrementalMapper, RefusesBadFramesUnharmed) {
  SurveyFlight survey(TestPort::kFlat, TestOptions());
  survey.FeedNav(20.0);
  for (int frame = 0; frame < 5; ++frame) survey.Fly(frame);
  const std::size_t landmarks = survey.mapper().map().landmarks().size();
  const FeatureWorld world(FeatureWorldOptions{});
  const AnyCamera camera = TestCamera(TestPort::kFlat);
  const FeatureFrame good = world.See(camera, survey.TrueCamera(5), 5);

  const auto refused = [&](const FrameObservations& frame, Errc code, const char* where) {
    const auto report = survey.mapper().Step(frame);
    ASSERT_FALSE(report.has_value());
    EXPECT_EQ(report.error().code, code);
    EXPECT_STREQ(report.error().where, where);
  };
  refused(good.View(UsFromSeconds(104.0)), Errc::kOutOfOrder, "utime");  // the last again
  refused(good.View(UsFromSeconds(50.0)), Errc::kOutOfOrder, "utime");
  FeatureFrame nan = good;
  nan.features[7].y_px = std::numeric_limits<float>::quiet_NaN();
  refused(nan.View(UsFromSeconds(105.0)), Errc::kInvalidArgument, "features");
  FrameObservations wrong_type = good.View(UsFromSeconds(105.0));
  wrong_type.descriptors.type = DescriptorType::kOrb;
  refused(wrong_type, Errc::kInvalidArgument, "descriptors");
  FrameObservations too_few = good.View(UsFromSeconds(105.0));
  too_few.descriptors.count -= 1;
  refused(too_few, Errc::kInvalidArgument, "descriptors");
  FeatureFrame many = good;
  many.features.resize(701);
  many.descriptors.resize(701 * 128);
  refused(many.View(UsFromSeconds(105.0)), Errc::kOutOfCapacity, "features");

  EXPECT_EQ(survey.mapper().map().landmarks().size(), landmarks);
  EXPECT_EQ(survey.Fly(5).state, MapperState::kTracking);
  FeatureFrame empty;  // a lens cap: valid, and shows nothing
  const auto dark = survey.mapper().Step(empty.View(UsFromSeconds(106.0)));
  ASSERT_TRUE(dark.has_value());
  EXPECT_EQ(dark->state, MapperState::kDeadReckoning);
}

// Frames of an hour ago, and navigation too: another world, mapped as if nothing had been before.
TEST(IncrementalMapper, AClockThatIsSetBackBeginsAnotherWorld) {
  SurveyFlight survey(TestPort::kFlat, TestOptions());
  survey.FeedNav(20.0);
  StepReport before;
  for (int frame = 0; frame < 10; ++frame) before = survey.Fly(frame);
  ASSERT_EQ(before.state, MapperState::kTracking);
  {
    const MallocTrap trap;
    survey.mapper().SetClockBack(UsFromSeconds(99.0));
    EXPECT_EQ(trap.count(), 0u);
  }
  EXPECT_TRUE(survey.mapper().map().keyframes().empty());
  const std::uint64_t refused = survey.mapper().nav().buffer().rejected(NavReject::kRunsBackwards);
  survey.FeedNav(20.0);
  EXPECT_EQ(survey.mapper().nav().buffer().rejected(NavReject::kRunsBackwards), refused);
  EXPECT_FALSE(survey.Fly(0).has_pose);
  StepReport after;
  for (int frame = 1; frame < 10; ++frame) after = survey.Fly(frame);
  EXPECT_EQ(after.state, MapperState::kTracking);
  EXPECT_TRUE(after.world_is_ned);
  EXPECT_GT(after.world, before.world);
  const Vec3 moved =
      after.camera_from_world.OriginOfTarget() - before.camera_from_world.OriginOfTarget();
  EXPECT_LT(moved.norm(), 0.05);
  EXPECT_EQ(survey.heap_calls(), 0u);
}

TEST(IncrementalMapper, PlanCountsWhatIsAllocated) {
  MapperOptions options = TestOptions();
  const AnyCamera camera = TestCamera(TestPort::kFlat);
  MallocTrap trap;
  const auto mapper = IncrementalMapper::Create(options, camera, Rigid3()).value();
  const std::size_t allocated = trap.bytes();
  if (!MallocTrap::IsActive()) GTEST_SKIP() << "sanitizer build";
  const std::size_t planned = mapper->memory_plan().total();
  EXPECT_GT(planned, static_cast<std::size_t>(0.9 * static_cast<double>(allocated)));
  EXPECT_LT(planned, static_cast<std::size_t>(1.1 * static_cast<double>(allocated)));
}

}  // namespace
}  // namespace rsfm
