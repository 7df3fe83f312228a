#include "tools/offline/navigation_fit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "rsfm/base/rng.h"
#include "rsfm/base/so3.h"
#include "tests/offline/made_scene.h"
#include "tests/support/rigs.h"

namespace rsfm {
namespace {

constexpr double kAheadS = 0.15, kPositionSigmaM = 0.02, kAttitudeSigmaRad = 0.003;

// A survey whose navigation, ten samples from image to image, has a clock that runs ahead, and a
// rig that has the camera's mount wrong.
class NavigationFitTest : public testing::Test {
 protected:
  NavigationFitTest() {
    SurveyOptions options;
    options.lines = 5;
    options.images_per_line = 8;
    options.num_points = 60;
    options.tilt_rad = 0.2;
    const Survey survey = MakeSurvey(*AnyCamera::Create(PaperLens()), options);
    scene_ = MakeScene(PaperLens(), survey);
    Rng rng(5);
    constexpr int kSteps = 10;
    for (std::size_t k = 0; k + 1 < scene_.images.size(); ++k) {
      const Rigid3 a = survey.camera_from_world[k].Inverse() * true_mount_.Inverse();
      const Rigid3 b = survey.camera_from_world[k + 1].Inverse() * true_mount_.Inverse();
      const Utime from = scene_.images[k].utime, to = scene_.images[k + 1].utime;
      for (int i = 0; i < kSteps; ++i) {
        NavSample s;
        s.utime = from + (to - from) * i / kSteps + UsFromSeconds(kAheadS);
        const Rigid3 body = Interpolate(a, b, static_cast<double>(i) / kSteps);
        s.Set(NavField::kPosition);
        s.Set(NavField::kAttitude);
        s.position_ned_m = body.translation + kPositionSigmaM * Noise(&rng);
        s.ned_from_body = ExpSo3(kAttitudeSigmaRad * Noise(&rng)) * body.rotation;
        s.sigma_position_m = Vec3::Constant(kPositionSigmaM);
        s.sigma_attitude_rad = Vec3::Constant(kAttitudeSigmaRad);
        input_.samples.push_back(s);
      }
    }
    input_.body_from_camera = Rigid3((ExpSo3(-turn_) * true_mount_.rotation).normalized(),
                                     true_mount_.translation - lever_error_);
  }

  static Vec3 Noise(Rng* rng) { return {rng->Gaussian(), rng->Gaussian(), rng->Gaussian()}; }
  // Of the whitened residuals, robustly: the two or three images of each turn are off the straight
  // way between them.
  double MedianOfPriors() const {
    std::vector<double> norms;
    for (const PosePrior& prior : scene_.priors) {
      const Rigid3& a = scene_.images[prior.a].camera_from_world;
      const Rigid3& b = scene_.images[prior.IsRelative() ? prior.b : prior.a].camera_from_world;
      norms.push_back(EvaluatePrior(prior, a, b).residual.norm());
    }
    std::nth_element(norms.begin(), norms.begin() + norms.size() / 2, norms.end());
    return norms[norms.size() / 2];
  }

  const Rigid3 true_mount_{ExpSo3(Vec3(0.1, 0.0, 1.5)), Vec3(0.4, -0.2, 0.3)};
  const Vec3 lever_error_{0.15, -0.2, 0.05}, turn_{0.02, -0.015, 0.03};
  Scene scene_;
  NavigationInput input_;
};

TEST_F(NavigationFitTest, FindsMountAndClock) {
  MountOptions options;
  options.mount = options.clock = true;
  NavigationFit fit(input_, options);
  const NavigationAlignment alignment = fit.Apply(&scene_);
  EXPECT_TRUE(alignment.attitude && alignment.position && alignment.scale);
  ASSERT_EQ(fit.estimates().size(), 7u);
  const Vec6 truth = (Vec6() << true_mount_.translation, turn_).finished();
  for (int i = 0; i < 7; ++i) {
    const ParameterEstimate& e = fit.estimates()[i];
    EXPECT_NEAR(e.value, i < 6 ? truth[i] : kAheadS, 4.0 * e.sigma) << e.name;
    EXPECT_LT(e.sigma, 0.2 * e.prior_sigma) << e.name;
  }
  EXPECT_EQ(fit.estimates()[0].start, input_.body_from_camera.translation.x());
  EXPECT_LT((fit.input().body_from_camera.translation - true_mount_.translation).norm(), 0.06);
  EXPECT_EQ(input_.samples[0].utime - fit.input().samples[0].utime,
            UsFromSeconds(fit.estimates()[6].value));
  EXPECT_FALSE(scene_.priors.empty());
  EXPECT_LT(MedianOfPriors(), 2.5);
  // Again from what was found: nothing moves.
  const std::vector<ParameterEstimate> before = fit.estimates();
  fit.Apply(&scene_);
  for (int i = 0; i < 7; ++i) EXPECT_NEAR(fit.estimates()[i].value, before[i].value, 1e-4);
}

TEST_F(NavigationFitTest, WithoutBeingAskedTheRigIsTakenAtItsWord) {
  NavigationFit fit(input_, {});
  EXPECT_TRUE(fit.Apply(&scene_).attitude);
  EXPECT_TRUE(fit.estimates().empty());
  EXPECT_EQ(fit.input().body_from_camera.translation, input_.body_from_camera.translation);
  EXPECT_GT(MedianOfPriors(), 5.0);
}

// One heading, no tilt: a lever arm moves the whole map, and nothing tells the two apart.
TEST_F(NavigationFitTest, WhatTheTrackDoesNotShowStaysAndSaysSo) {
  for (NavSample& s : input_.samples) s.ned_from_body = Quat::Identity();
  for (SceneImage& image : scene_.images) {
    const Vec3 place = image.camera_from_world.OriginOfTarget();
    const Quat level = true_mount_.rotation.conjugate();
    image.camera_from_world = Rigid3(level, -(level * place));
  }
  MountOptions options;
  options.mount = true;
  NavigationFit fit(input_, options);
  EXPECT_TRUE(fit.Apply(&scene_).attitude);
  ASSERT_EQ(fit.estimates().size(), 6u);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(fit.estimates()[i].verdict, "not determined") << fit.estimates()[i].sigma;
    EXPECT_NEAR(fit.estimates()[i].value, fit.estimates()[i].start, 0.01);
  }
}

}  // namespace
}  // namespace rsfm
