// The window's adjustment alone: every feature at its true landmark, poses from a rough prediction.
// What navigation and landmarks do not measure must not become certain.
#include "rsfm/mapping/window_adjuster.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <map>
#include <vector>

#include "tests/mapping/simulated_mission.h"

namespace rsfm {
namespace {

struct Conditions {
  std::uint64_t seed = 1;
  bool has_nav = true, has_velocity = true, has_depth = true;
  double leg_m = 15.0;
  double sigma_scale = 0.0;  // of a world whose scale is known beforehand
};

class Window {
 public:
  explicit Window(const Conditions& conditions)
      : conditions_(conditions),
        mission_(Mission(conditions)),
        options_(Options(mission_)),
        nav_(NavAid::Create(options_, DownwardCamera()).value()),
        map_(options_),
        adjuster_(WindowAdjuster::Create(options_, mission_.camera()).value()),
        rng_(conditions.seed * 77 + 5) {
    mission_.FeedNav(&nav_.buffer());
    adjuster_.Reset(conditions.sigma_scale);
  }

  // Takes the next frame and adjusts.
  void Step() {
    const FeatureFrame seen = Known(mission_.See(frame_));
    const Rigid3 truth = mission_.TrueCamera(frame_);
    Keyframe keyframe;
    keyframe.id = frame_;
    keyframe.utime = mission_.UtimeOf(frame_);
    keyframe.is_placed = true;
    keyframe.camera_from_world = truth;
    if (frame_ > 0) {
      // Without navigation the first two frames are the frame and the unit.
      const double scale = frame_ == 1 && !conditions_.has_nav ? 0.0 : 1.0;
      Vec6 off;
      for (int i = 0; i < 6; ++i) off[i] = scale * (i < 3 ? 0.002 : 0.01) * rng_.Gaussian();
      const Rigid3 moved = truth * mission_.TrueCamera(frame_ - 1).Inverse();
      keyframe.camera_from_world = Perturb(moved * newest().camera_from_world, off);
    }
    newest_ = map_.AddKeyframe(seen.View(keyframe.utime), keyframe).value();
    for (std::size_t i = 0; i < seen.features.size(); ++i)
      Observe(seen.features[i], static_cast<int>(i), truth);
    if (frame_ > 0) {
      NavAid* nav = conditions_.has_nav ? &nav_ : nullptr;
      ASSERT_TRUE(adjuster_.Prepare(map_, nav).has_value());
      ASSERT_TRUE(adjuster_.Finish(&map_, nav).has_value());
    }
    ++frame_;
  }

  BodyPose body() const {
    return ToBodyPose(map_.keyframe(newest_).camera_from_world, map_.keyframe(newest_).covariance,
                      DownwardCamera());
  }
  double Nees() const {
    const BodyPose found = body();
    const Rigid3 truth = mission_.Body(mission_.TimeOf(frame_ - 1));
    Vec6 error;
    error.head<3>() = found.world_from_body.translation - truth.translation;
    error.tail<3>() = LogSo3(found.world_from_body.rotation * truth.rotation.conjugate());
    return error.dot(found.covariance.ldlt().solve(error));
  }
  double yaw_sigma_rad() const { return std::sqrt(body().covariance(5, 5)); }

 private:
  static SimulatedMission Mission(const Conditions& conditions) {
    SimulatedMissionOptions options;
    options.seed = conditions.seed;
    options.legs = 1;
    options.leg_m = conditions.leg_m;
    options.heading_bias_deg = 1.0;
    options.max_features = 110;
    options.points_per_m2 = 9.0;
    options.has_velocity = conditions.has_velocity;
    options.has_depth = conditions.has_depth;
    return SimulatedMission(options);
  }
  static MapperOptions Options(const SimulatedMission& mission) {
    MapperOptions options = mission.Mapper();
    options.max_keyframes = mission.num_frames() + 1;
    options.max_landmarks = 20000;
    return options;
  }
  static FeatureFrame Known(const FeatureFrame& seen) {
    FeatureFrame known;
    for (std::size_t i = 0; i < seen.features.size(); ++i) {
      if (seen.features[i].track == kNoTrack) continue;
      known.features.push_back(seen.features[i]);
      const auto row = seen.descriptors.begin() + static_cast<std::ptrdiff_t>(128 * i);
      known.descriptors.insert(known.descriptors.end(), row, row + 128);
    }
    return known;
  }
  const Keyframe& newest() const { return map_.keyframe(newest_); }

  // From its second sight a point is a landmark, which starts near where the newest camera has it.
  void Observe(const Feature& feature, int index, const Rigid3& true_camera) {
    if (const auto known = landmark_of_.find(feature.track); known != landmark_of_.end()) {
      map_.Observe(known->second, newest_, index);
      return;
    }
    auto [first, is_new] = first_seen_.try_emplace(feature.track, Observation{newest_, index});
    if (is_new) return;
    const Vec3 in_camera = true_camera * mission_.world().points()[feature.track];
    const Vec3 off(rng_.Gaussian(), rng_.Gaussian(), rng_.Gaussian());
    const SlotId landmark =
        map_.AddLandmark(newest().camera_from_world.Inverse() * in_camera + 0.02 * off, feature);
    map_.Observe(landmark, first->second.keyframe, first->second.feature);
    map_.Observe(landmark, newest_, index);
    landmark_of_[feature.track] = landmark;
  }

  Conditions conditions_;
  SimulatedMission mission_;
  MapperOptions options_;
  NavAid nav_;
  Map map_;
  WindowAdjuster adjuster_;
  Rng rng_;
  int frame_ = 0;
  SlotId newest_;
  std::map<std::uint32_t, SlotId> landmark_of_;
  std::map<std::uint32_t, Observation> first_seen_;
};

double MeanNees(Conditions conditions, int runs, int frames) {
  double sum = 0.0;
  for (int run = 0; run < runs; ++run) {
    conditions.seed = static_cast<std::uint64_t>(run) + 1;
    Window window(conditions);
    for (int frame = 0; frame < frames; ++frame) window.Step();
    sum += window.Nees();
  }
  return sum / runs;
}

// A heading bias that only its start says anything about leaves the yaw as uncertain as that, and
// as the drift makes it, however many keyframes come and go.
TEST(WindowAdjuster, YawGainsNoCertaintyFromNoise) {
  for (const bool has_velocity : {true, false}) {
    Conditions conditions;
    conditions.leg_m = 30.0;
    conditions.has_velocity = has_velocity;
    conditions.sigma_scale = has_velocity ? 0.0 : 0.05;
    Window window(conditions);
    for (int frame = 0; frame < 16; ++frame) window.Step();
    const double at_start = window.yaw_sigma_rad();
    for (int frame = 16; frame < 100; ++frame) window.Step();
    EXPECT_GT(window.yaw_sigma_rad(), at_start);
    EXPECT_LT(window.yaw_sigma_rad(), 1.1 * at_start);
  }
}

// 20 runs: the mean of chi-square with six degrees of freedom lies in 4.57 .. 7.61 with 95 %.
constexpr int kRuns = 20, kFrames = 36;
constexpr double kLow = 4.57, kHigh = 7.61;

TEST(WindowAdjuster, IsConsistentWithAllSensors) {
  const double nees = MeanNees({}, kRuns, kFrames);
  EXPECT_GT(nees, kLow);
  EXPECT_LT(nees, kHigh);
}

TEST(WindowAdjuster, IsConsistentWithoutVelocity) {
  Conditions conditions;
  conditions.has_velocity = false;
  conditions.sigma_scale = 0.05;
  const double nees = MeanNees(conditions, kRuns, kFrames);
  EXPECT_GT(nees, kLow - 1.0);  // the scale that was handed in was the true one
  EXPECT_LT(nees, kHigh);
}

TEST(WindowAdjuster, IsConsistentWithoutDepth) {
  Conditions conditions;
  conditions.has_depth = false;
  const double nees = MeanNees(conditions, kRuns, kFrames);
  EXPECT_GT(nees, kLow);
  EXPECT_LT(nees, kHigh);
}

TEST(WindowAdjuster, IsConsistentByImagesAlone) {
  Conditions conditions;
  conditions.has_nav = false;
  const double nees = MeanNees(conditions, kRuns, kFrames);
  EXPECT_GT(nees, kLow - 1.0);  // likewise the first baseline
  EXPECT_LT(nees, kHigh);
}

}  // namespace
}  // namespace rsfm
