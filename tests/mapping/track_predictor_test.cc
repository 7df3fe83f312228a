#include "rsfm/mapping/track_predictor.h"

#include <gtest/gtest.h>

#include "rsfm/mapping/incremental_mapper.h"
#include "tests/mapping/feature_world.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

// A map of two keyframes made from known points; the third image is expected where it will be.
TEST(TrackPredictor, ProjectsLandmarksAndGuessesTheRest) {
  MapperOptions options;
  options.max_features = 400;
  const AnyCamera camera = TestCamera(TestPort::kFlat);
  FeatureWorldOptions world_options;
  world_options.max_features = 400;
  world_options.clutter = 0.0;
  world_options.noise_px = 0.0;
  const FeatureWorld world(world_options);
  const auto camera_at = [](double t) { return (SurveyBody(t) * DownwardCamera()).Inverse(); };
  const FeatureFrame first = world.See(camera, camera_at(1.0), 1);
  const FrameObservations observations = first.View(1'000'000);

  Map map(options);
  Keyframe keyframe;
  keyframe.is_placed = true;
  keyframe.camera_from_world = camera_at(1.0);
  const auto id = map.AddKeyframe(observations, keyframe);
  ASSERT_TRUE(id.has_value());
  TrackPredictor predictor(options.max_features);
  predictor.Remember(observations.features);
  EXPECT_TRUE(predictor.Predict(map, camera, camera_at(1.0), camera_at(1.2)).empty());

  // Every second feature is a landmark.
  for (std::size_t i = 0; i < observations.features.size(); i += 2) {
    const Feature& feature = observations.features[i];
    const SlotId landmark = map.AddLandmark(world.points()[feature.track], feature);
    ASSERT_TRUE(map.Observe(landmark, *id, static_cast<int>(i)));
  }
  const MallocTrap trap;
  const auto expected = predictor.Predict(map, camera, camera_at(1.0), camera_at(1.2));
  EXPECT_EQ(trap.count(), 0u);
  ASSERT_EQ(expected.size(), observations.features.size());
  int exact = 0, near = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    Vec2 truth;
    const Vec3 point = camera_at(1.2) * world.points()[observations.features[i].track];
    if (camera.Project(point, &truth) != Projection::kOk) continue;
    const double error = (expected[i] - truth).norm();
    const double motion = (truth - observations.features[i].pixel()).norm();
    if (i % 2 == 0) {
      EXPECT_LT(error, 1e-6);
      ++exact;
    } else {
      near += error < 0.5 * motion;
    }
  }
  EXPECT_GE(exact, 40);
  EXPECT_GE(near, exact * 8 / 10);
}

}  // namespace
}  // namespace rsfm
