#include "tools/offline/navigation.h"

#include <gtest/gtest.h>

#include "tests/offline/made_scene.h"
#include "tests/support/rigs.h"

namespace rsfm {
namespace {

// A survey in local NED, its navigation without noise, and the same scene in a world of its own.
class NavigationTest : public testing::Test {
 protected:
  NavigationTest() {
    SurveyOptions options;
    options.num_points = 100;
    truth_ = MakeSurvey(*AnyCamera::Create(PaperLens()), options);
    scene_ = MakeScene(PaperLens(), truth_);
    input_.body_from_camera = Rigid3(ExpSo3(Vec3(0.1, 0.0, 1.5)), Vec3(0.4, -0.2, 0.3));
    const Rigid3 own_from_ned(ExpSo3(Vec3(1.0, 0.4, -2.0)), Vec3(3.0, -1.0, 7.0));
    for (SceneImage& image : scene_.images) {
      const Vec3 place = own_from_ned * image.camera_from_world.OriginOfTarget() * kScale;
      image.camera_from_world.rotation =
          (image.camera_from_world.rotation * own_from_ned.rotation.conjugate()).normalized();
      image.camera_from_world.translation = -(image.camera_from_world.rotation * place);
    }
    for (ScenePoint& point : scene_.points) point.xyz = own_from_ned * point.xyz * kScale;
  }

  Rigid3 NedFromBody(std::size_t k) const {
    return truth_.camera_from_world[k].Inverse() * input_.body_from_camera.Inverse();
  }
  // At every image's time, and between them for the dead reckoning.
  void AddSamples(std::initializer_list<NavField> fields) {
    for (std::size_t k = 0; k < scene_.images.size(); ++k) {
      NavSample s;
      s.utime = scene_.images[k].utime;
      for (const NavField field : fields) s.Set(field);
      const Rigid3 body = NedFromBody(k);
      s.position_ned_m = body.translation;
      s.ned_from_body = body.rotation;
      s.depth_m = body.translation.z();
      s.sigma_attitude_rad = Vec3::Constant(0.01);
      input_.samples.push_back(s);
    }
  }
  double WorstPlace() const {
    double worst = 0.0;
    for (std::size_t k = 0; k < scene_.images.size(); ++k)
      worst = std::max(worst, (scene_.images[k].camera_from_world.OriginOfTarget() -
                               truth_.camera_from_world[k].OriginOfTarget())
                                  .norm());
    return worst;
  }

  static constexpr double kScale = 0.37;
  Survey truth_;
  Scene scene_;
  NavigationInput input_;
};

TEST_F(NavigationTest, PositionAndAttitudePlaceTheWorld) {
  AddSamples({NavField::kPosition, NavField::kAttitude});
  const NavigationAlignment alignment = AlignToNavigation(input_, &scene_);
  EXPECT_TRUE(alignment.attitude && alignment.position && alignment.scale);
  EXPECT_NEAR(alignment.scale_factor, 1.0 / kScale, 1e-6);
  EXPECT_LT(WorstPlace(), 1e-6);
  for (std::size_t p = 0; p < scene_.points.size(); ++p)
    EXPECT_LT((scene_.points[p].xyz - truth_.points[p]).norm(), 1e-5);
  for (const PosePrior& prior : NavigationPriors(input_, scene_)) {
    const Rigid3& pose = scene_.images[prior.a].camera_from_world;
    EXPECT_LT(EvaluatePrior(prior, pose, pose).residual.norm(), 1e-4);
  }
}

TEST_F(NavigationTest, PositionAloneTurnsTheWorldToo) {
  input_.body_from_camera = Rigid3();
  AddSamples({NavField::kPosition});
  const NavigationAlignment alignment = AlignToNavigation(input_, &scene_);
  EXPECT_TRUE(alignment.attitude && alignment.position && alignment.scale);
  EXPECT_LT(WorstPlace(), 1e-6);
}

TEST_F(NavigationTest, DepthAndAttitudeGiveTheVerticalOnly) {
  AddSamples({NavField::kDepth, NavField::kAttitude});
  const NavigationAlignment alignment = AlignToNavigation(input_, &scene_);
  EXPECT_TRUE(alignment.attitude && alignment.depth);
  EXPECT_FALSE(alignment.position || alignment.scale);
  EXPECT_EQ(alignment.scale_factor, 1.0);
  for (std::size_t k = 0; k < scene_.images.size(); ++k)
    EXPECT_LT(AngleBetween(scene_.images[k].camera_from_world.rotation,
                           truth_.camera_from_world[k].rotation),
              1e-6);
  int depths = 0;
  for (const PosePrior& prior : NavigationPriors(input_, scene_))
    depths += prior.kind == PriorKind::kDepth;
  EXPECT_EQ(depths, static_cast<int>(scene_.images.size()));
}

// A DVL and an attitude sensor: the path is dead-reckoned, and gives the scale.
TEST_F(NavigationTest, VelocityGivesTheScale) {
  constexpr int kSteps = 20;
  for (std::size_t k = 0; k + 1 < scene_.images.size(); ++k) {
    const Rigid3 a = NedFromBody(k), b = NedFromBody(k + 1);
    const double seconds = SecondsFromUs(scene_.images[k + 1].utime - scene_.images[k].utime);
    for (int i = 0; i <= kSteps; ++i) {
      NavSample s;
      s.utime = scene_.images[k].utime +
                (scene_.images[k + 1].utime - scene_.images[k].utime) * i / kSteps;
      if (i == kSteps && k + 2 < scene_.images.size()) continue;
      const Rigid3 body = Interpolate(a, b, static_cast<double>(i) / kSteps);
      s.Set(NavField::kVelocity);
      s.Set(NavField::kAttitude);
      s.ned_from_body = body.rotation;
      s.velocity_body_mps = body.rotation.conjugate() * (b.translation - a.translation) / seconds;
      s.sigma_attitude_rad = Vec3::Constant(0.01);
      s.sigma_velocity_mps = Vec3::Constant(0.01);
      input_.samples.push_back(s);
    }
  }
  const NavigationAlignment alignment = AlignToNavigation(input_, &scene_);
  EXPECT_TRUE(alignment.attitude && alignment.scale);
  EXPECT_FALSE(alignment.position);
  EXPECT_NEAR(alignment.scale_factor, 1.0 / kScale, 0.03 / kScale);
  int displacements = 0;
  for (const PosePrior& prior : NavigationPriors(input_, scene_))
    displacements += prior.kind == PriorKind::kDisplacement;
  EXPECT_EQ(displacements, static_cast<int>(scene_.images.size()) - 1);
}

TEST_F(NavigationTest, WithoutNavigationNothingMoves) {
  const Vec3 before = scene_.images[3].camera_from_world.OriginOfTarget();
  const NavigationAlignment alignment = AlignToNavigation(input_, &scene_);
  EXPECT_FALSE(alignment.attitude || alignment.position || alignment.scale);
  EXPECT_EQ(scene_.images[3].camera_from_world.OriginOfTarget(), before);
  EXPECT_TRUE(NavigationPriors(input_, scene_).empty());
}

}  // namespace
}  // namespace rsfm
