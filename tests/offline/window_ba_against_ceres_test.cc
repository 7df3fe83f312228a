// One residual, two solvers: the on-board window adjustment and Ceres reach the same optimum.
#include <gtest/gtest.h>

#include <vector>

#include "rsfm/estimation/window_ba.h"
#include "tests/support/ceres_bundle.h"
#include "tests/support/rigs.h"
#include "tests/support/survey.h"
#include "tools/offline/bundle.h"

namespace rsfm {
namespace {

struct Case {
  RigKind rig;
  LossType loss;
  bool priors;
};

class WindowBaAgainstCeresTest : public testing::TestWithParam<Case> {};

// A DVL's displacements and a depth sensor, with noise.
std::vector<PosePrior> NoisyPriors(const Survey& truth, Rng* rng) {
  const Rigid3 body_from_camera(ExpSo3(Vec3(0.1, -0.2, 0.3)), Vec3(0.4, 0.0, 0.1));
  std::vector<PosePrior> priors;
  for (int k = 1; k < static_cast<int>(truth.camera_from_world.size()); ++k) {
    const Rigid3 a = truth.camera_from_world[k - 1].Inverse() * body_from_camera.Inverse();
    const Rigid3 b = truth.camera_from_world[k].Inverse() * body_from_camera.Inverse();
    const Vec3 noise(rng->Gaussian(0.0, 0.02), rng->Gaussian(0.0, 0.02), rng->Gaussian(0.0, 0.02));
    priors.push_back(*MakeDisplacementPrior(
        k - 1, k, body_from_camera, (a.Inverse() * b).translation + noise, Vec3::Constant(0.02)));
    priors.push_back(*MakeDepthPrior(k, body_from_camera, b.translation.z() + noise.x(), 0.02));
    priors.back().loss = {LossType::kCauchy, 1.0};
  }
  return priors;
}

TEST_P(WindowBaAgainstCeresTest, SameOptimum) {
  Rng rng(21);
  const std::vector<AnyCamera> cameras = {RandomRig(GetParam().rig, &rng)};
  Survey survey = MakeSurvey(cameras[0], {});
  for (std::size_t i = 0; i < survey.observations.size(); i += 30)
    survey.observations[i].pixel += Vec2(15.0, -10.0);
  BundleProblem bundle;
  if (GetParam().priors) bundle.priors = NoisyPriors(survey, &rng);
  Disturb(&survey, 2, 0.004, 0.02, 0.03, 8);

  WindowBa window =
      *WindowBa::Create({.keyframes = 12, .landmarks = 500, .observations = 5000, .priors = 64});
  bundle.cameras = {cameras[0].config()};
  bundle.points = survey.points;
  for (std::size_t k = 0; k < survey.camera_from_world.size(); ++k) {
    const bool fixed = k < (GetParam().priors ? 1 : 2);
    ASSERT_TRUE(window.AddKeyframe(survey.camera_from_world[k], 0, fixed));
    bundle.images.push_back({survey.camera_from_world[k], 0, fixed});
  }
  for (const Vec3& point : survey.points) ASSERT_TRUE(window.AddLandmark(point));
  for (const SurveyObservation& o : survey.observations) {
    ASSERT_TRUE(window.AddObservation(o.image, o.point, o.pixel));
    bundle.observations.push_back({o.image, o.point, o.pixel});
  }
  for (const PosePrior& prior : bundle.priors) ASSERT_TRUE(window.AddPrior(prior));

  WindowBaOptions window_options;
  window_options.max_iterations = 100;
  window_options.function_tolerance = 1e-14;
  window_options.loss = {GetParam().loss, 1.0};
  const auto window_report = window.Solve(cameras, window_options);
  ASSERT_TRUE(window_report);
  BundleOptions bundle_options;
  bundle_options.max_iterations = 100;
  bundle_options.function_tolerance = 1e-14;
  bundle_options.loss = window_options.loss;
  const auto bundle_report = AdjustBundleByCeres(bundle_options, &bundle);
  ASSERT_TRUE(bundle_report);

  EXPECT_NEAR(window_report->initial_cost, bundle_report->initial_cost,
              1e-9 * bundle_report->initial_cost);
  EXPECT_LT(window_report->final_cost, 0.5 * window_report->initial_cost);
  EXPECT_NEAR(window_report->final_cost, bundle_report->final_cost,
              1e-6 * bundle_report->final_cost);
  for (int k = 0; k < window.num_keyframes(); ++k) {
    const Rigid3 between =
        window.camera_from_world(k) * bundle.images[k].camera_from_world.Inverse();
    EXPECT_LT(LogSe3(between).norm(), 1e-4) << k;
  }
}

INSTANTIATE_TEST_SUITE_P(Problems, WindowBaAgainstCeresTest,
                         testing::Values(Case{RigKind::kNone, LossType::kNone, false},
                                         Case{RigKind::kFlat, LossType::kHuber, false},
                                         Case{RigKind::kFlat, LossType::kCauchy, true},
                                         Case{RigKind::kDome, LossType::kHuber, true},
                                         Case{RigKind::kCentredDome, LossType::kCauchy, false}));

}  // namespace
}  // namespace rsfm
