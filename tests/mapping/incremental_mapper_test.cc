#include "rsfm/mapping/incremental_mapper.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <string>

#include "tests/mapping/feature_world.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr double kFrameRate = 1.0;  // strobed stills: 0.3 m apart, two thirds of overlap

MapperOptions TestOptions() {
  MapperOptions options;
  options.max_features = 700;
  options.max_keyframes = 48;
  options.max_landmarks = 6000;
  options.ransac_iterations = 300;
  return options;
}

struct Run {
  std::vector<StepReport> reports;
  std::vector<Rigid3> true_camera_from_world;
  std::size_t heap_calls = 0;
};

// A survey flown by the mapper.
class Survey {
 public:
  Survey(TestPort port, const MapperOptions& options, const FeatureWorldOptions& world = {})
      : camera_(TestCamera(port)), world_(world) {
    mapper_ = IncrementalMapper::Create(options, camera_, DownwardCamera()).value();
  }

  IncrementalMapper& mapper() { return *mapper_; }

  // Attitude at 10 Hz, velocity at 5 Hz, depth at 2 Hz, with typical noise.
  // From one time to another the log is that much too fast.
  void FeedNav(double end_s, double begin_s = -1.0, double off_mps = 0.0, double off_from_s = 0.0,
               double off_to_s = 0.0) {
    Rng rng(99);
    for (int i = 0; i <= static_cast<int>(10 * end_s) + 20; ++i) {
      const double t = 0.1 * i - 1.0;
      if (t < begin_s) continue;
      const Rigid3 body = SurveyBody(t);
      NavSample sample;
      sample.utime = UsFromSeconds(t + 100.0);
      sample.Set(NavField::kAttitude);
      sample.sigma_attitude_rad = Vec3(0.002, 0.002, 0.005);
      sample.ned_from_body =
          ExpSo3(0.002 * Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian())) * body.rotation;
      if (i % 2 == 0) {
        sample.Set(NavField::kVelocity);
        const double h = 1e-3;
        const Vec3 velocity_ned =
            (SurveyBody(t + h).translation - SurveyBody(t - h).translation) / (2.0 * h);
        sample.sigma_velocity_mps = Vec3::Constant(0.005);
        sample.velocity_body_mps = body.rotation.conjugate() * velocity_ned +
                                   0.005 * Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian());
        if (t > off_from_s && t < off_to_s) sample.velocity_body_mps.x() += off_mps;
      }
      if (i % 5 == 0) {
        sample.Set(NavField::kDepth);
        sample.depth_m = body.translation.z() + rng.Gaussian(0.0, 0.01);
        sample.sigma_depth_m = 0.01;
      }
      mapper_->nav().buffer().Insert(sample);
    }
  }

  Rigid3 TrueCamera(int frame) const {
    return (SurveyBody(frame / kFrameRate) * DownwardCamera()).Inverse();
  }

  StepReport Fly(int frame, bool blind = false) {
    const FeatureFrame seen =
        blind ? world_.SeeNothing(camera_, frame) : world_.See(camera_, TrueCamera(frame), frame);
    const FrameObservations view = seen.View(UsFromSeconds(frame / kFrameRate + 100.0));
    MallocTrap trap;
    const auto report = mapper_->Step(view);
    heap_calls_ += trap.count();
    EXPECT_TRUE(report.has_value());
    return report.value_or(StepReport{});
  }
  std::size_t heap_calls() const { return heap_calls_; }

 private:
  AnyCamera camera_;
  FeatureWorld world_;
  std::unique_ptr<IncrementalMapper> mapper_;
  std::size_t heap_calls_ = 0;
};

class MapperSurvey : public ::testing::TestWithParam<TestPort> {};
INSTANTIATE_TEST_SUITE_P(Ports, MapperSurvey,
                         ::testing::Values(TestPort::kNone, TestPort::kFlat, TestPort::kDome),
                         [](const auto& port) {
                           return std::string(port.param == TestPort::kNone   ? "None"
                                              : port.param == TestPort::kFlat ? "Flat"
                                                                              : "Dome");
                         });

TEST_P(MapperSurvey, WithNavigationIsMetricAndTrue) {
  Survey survey(GetParam(), TestOptions());
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
  Survey survey(GetParam(), TestOptions());
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
  Survey survey(GetParam(), TestOptions());
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
  Survey survey(GetParam(), TestOptions());
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
  Survey survey(TestPort::kFlat, options);
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

TEST(IncrementalMapper, DeadReckonsThroughAnOutageAndReturnsWithoutAJump) {
  Survey survey(TestPort::kFlat, TestOptions());
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
TEST(IncrementalMapper, IsNotDrawnBackToABottomThatLooksTheSame) {
  FeatureWorldOptions look_alike;
  look_alike.repeat_m = 6.0;
  Survey survey(TestPort::kFlat, TestOptions(), look_alike);
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
    EXPECT_LT((error - offset).norm(), 0.2) << frame;
    tracked_after += frame >= 22 && report.state == MapperState::kTracking;
  }
  EXPECT_GE(tracked_after, 15);
}

// The same without navigation is what the test above is worth: the wrong place is taken.
TEST(IncrementalMapper, WithoutNavigationALookAlikeIsTakenForThePlace) {
  FeatureWorldOptions look_alike;
  look_alike.repeat_m = 6.0;
  Survey survey(TestPort::kFlat, TestOptions(), look_alike);
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

TEST(IncrementalMapper, FindsItselfAgainWithoutNavigation) {
  Survey survey(TestPort::kNone, TestOptions());
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

TEST(IncrementalMapper, ALongLossWithoutNavigationBeginsANewWorldAndSaysSo) {
  MapperOptions options = TestOptions();
  options.lost_frames_before_restart = 4;
  Survey survey(TestPort::kNone, options);
  for (int frame = 0; frame < 8; ++frame) survey.Fly(frame);
  StepReport report;
  for (int frame = 30; frame < 40; ++frame) report = survey.Fly(frame);  // elsewhere
  EXPECT_EQ(report.state, MapperState::kTracking);
  EXPECT_EQ(report.reset_counter, 1);
}

// The lens cap is on: images come, and show nothing. Then it is off.
TEST(IncrementalMapper, WaitsUnderTheLensCap) {
  Survey survey(TestPort::kFlat, TestOptions());
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
TEST(IncrementalMapper, AnOutageWithoutNavigationIsALossAndThenANewWorld) {
  MapperOptions options = TestOptions();
  options.lost_frames_before_restart = 6;
  Survey survey(TestPort::kFlat, options);
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
TEST(IncrementalMapper, AReturnFartherThanThreeSigmasIsAnnounced) {
  for (const double off_mps : {0.0, 0.1}) {
    Survey survey(TestPort::kFlat, TestOptions());
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

TEST(IncrementalMapper, KeyframesFromBeforeTheFirstPairArePlacedLater) {
  Survey survey(TestPort::kFlat, TestOptions());
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

TEST(IncrementalMapper, SameInputsSameBytesOut) {
  std::string first;
  for (int run = 0; run < 2; ++run) {
    Survey survey(TestPort::kFlat, TestOptions());
    survey.FeedNav(20.0);
    std::string bytes;
    for (int frame = 0; frame < 15; ++frame) {
      const StepReport report = survey.Fly(frame);
      double values[7 + 36];
      Quat::Coefficients::Map(values) = report.camera_from_world.rotation.coeffs();
      Vec3::Map(values + 4) = report.camera_from_world.translation;
      Mat6::Map(values + 7) = report.covariance;
      bytes.append(reinterpret_cast<const char*>(values), sizeof values);
    }
    if (run == 0) first = bytes;
    EXPECT_TRUE(bytes == first);
  }
}

TEST(IncrementalMapper, RefusesBadFramesUnharmed) {
  Survey survey(TestPort::kFlat, TestOptions());
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

TEST(BodyPose, CovarianceIsThatOfPositionAndRotationAboutTheWorldsAxes) {
  Rng rng(8);
  const Rigid3 camera_from_world(ExpSo3(Vec3(0.4, -0.7, 1.1)), Vec3(3.0, -2.0, 5.0));
  Mat6 root;
  for (int i = 0; i < 36; ++i) root(i) = 0.01 * rng.Gaussian();
  const Mat6 covariance = root * root.transpose();
  const BodyPose pose = ToBodyPose(camera_from_world, covariance, DownwardCamera());
  // Through the definition, by differences along the columns of the root.
  Mat6 moved;
  for (int k = 0; k < 6; ++k) {
    const double h = 1e-5;
    const Rigid3 other =
        ToBodyPose(Perturb(camera_from_world, h * root.col(k)), covariance, DownwardCamera())
            .world_from_body;
    moved.col(k).head<3>() = (other.translation - pose.world_from_body.translation) / h;
    moved.col(k).tail<3>() = LogSo3(other.rotation * pose.world_from_body.rotation.conjugate()) / h;
  }
  EXPECT_LT((moved * moved.transpose() - pose.covariance).norm(), 1e-4 * pose.covariance.norm());
}

}  // namespace
}  // namespace rsfm
