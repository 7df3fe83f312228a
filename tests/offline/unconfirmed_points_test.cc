#include "tools/offline/unconfirmed_points.h"

#include <gtest/gtest.h>

#include "tests/offline/made_scene.h"

namespace rsfm {
namespace {

Survey MadeSurvey(const AnyCamera& camera) {
  SurveyOptions options;
  options.lines = 3;
  options.images_per_line = 5;
  options.num_points = 9000;
  return MakeSurvey(camera, options);
}

// The first `count` points that more than two images show keep two observations.
std::vector<int> LeaveTwo(int count, Scene* scene) {
  std::vector<int> left;
  for (int p = 0; p < static_cast<int>(scene->points.size()) && count > 0; ++p) {
    if (scene->points[p].track.size() < 3) continue;
    while (scene->points[p].track.size() > 2) scene->Forget(scene->points[p].track.back());
    left.push_back(p);
    --count;
  }
  return left;
}

TEST(UnconfirmedPoints, RightOnesStay) {
  const AnyCamera camera = *AnyCamera::Create(FlatRig());
  Scene scene = MakeScene(FlatRig(), MadeSurvey(camera));
  LeaveTwo(200, &scene);
  EXPECT_EQ(RemoveUnconfirmedOutliers({}, &scene), 0);
}

// Wrong matches along the epipolar curve give ranges that are wrong from both images.
TEST(UnconfirmedPoints, ThoseFarBehindOrBeforeTheBottomGo) {
  const AnyCamera camera = *AnyCamera::Create(FlatRig());
  Scene scene = MakeScene(FlatRig(), MadeSurvey(camera));
  const int before = scene.NumPoints();
  const std::vector<int> two = LeaveTwo(100, &scene);
  ASSERT_EQ(two.size(), 100U);
  for (std::size_t i = 0; i < 50; ++i) {
    ScenePoint& point = scene.points[two[i]];
    Vec3 between = Vec3::Zero();
    for (const TrackElement& e : point.track)
      between += 0.5 * scene.images[e.image].camera_from_world.OriginOfTarget();
    point.xyz = between + (i % 2 == 0 ? 6.0 : 0.2) * (point.xyz - between);
  }
  EXPECT_EQ(RemoveUnconfirmedOutliers({}, &scene), 50);
  EXPECT_EQ(scene.NumPoints(), before - 50);
  for (std::size_t i = 0; i < two.size(); ++i)
    EXPECT_EQ(scene.points[two[i]].track.empty(), i < 50) << i;
}

// Three images that agree are believed, whatever is around.
TEST(UnconfirmedPoints, ConfirmedOnesStay) {
  const AnyCamera camera = *AnyCamera::Create(FlatRig());
  Scene scene = MakeScene(FlatRig(), MadeSurvey(camera));
  for (ScenePoint& point : scene.points) {
    if (point.track.size() < 3) continue;
    point.xyz.z() -= 1.0;
    break;
  }
  EXPECT_EQ(RemoveUnconfirmedOutliers({}, &scene), 0);
}

// What stands alone has nobody to contradict it.
TEST(UnconfirmedPoints, WithoutNeighboursThereIsNoVerdict) {
  const AnyCamera camera = *AnyCamera::Create(FlatRig());
  Scene scene = MakeScene(FlatRig(), MadeSurvey(camera));
  const std::vector<int> two = LeaveTwo(1, &scene);
  ASSERT_EQ(two.size(), 1U);
  scene.points[two[0]].xyz *= 4.0;
  UnconfirmedPointOptions options;
  options.radius = options.far_radius = 1e-4;
  EXPECT_EQ(RemoveUnconfirmedOutliers(options, &scene), 0);
}

}  // namespace
}  // namespace rsfm
