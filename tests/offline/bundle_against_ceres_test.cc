// The desk's own solver against Ceres on the same residuals: the same optimum, and the same bytes
// whatever the number of threads.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/ceres_bundle.h"
#include "tests/support/rigs.h"
#include "tests/support/survey.h"
#include "tools/offline/bundle.h"

namespace rsfm {
namespace {

struct Case {
  const char* name;
  RigKind rig;
  RobustLoss loss;
  bool refines_camera = false;
  bool navigation = false;
  int num_fixed = 0;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

BundleProblem MakeProblem(const Case& c) {
  Rng rng(4);
  const AnyCamera camera = RandomRig(c.rig, &rng);
  SurveyOptions options;
  options.lines = 3;
  options.images_per_line = 5;
  options.num_points = 400;
  const Survey truth = MakeSurvey(camera, options);
  Survey start = truth;
  Disturb(&start, c.num_fixed, 0.004, 0.02, 0.03, 2);
  BundleProblem problem;
  problem.cameras = {camera.config()};
  if (c.refines_camera) {
    problem.cameras[0].lens_params[0] *= 1.01;
    problem.cameras[0].port.distance_m *= 0.8;
    problem.cameras[0].port.center_m *= 0.5;
  }
  for (std::size_t k = 0; k < truth.camera_from_world.size(); ++k)
    problem.images.push_back({start.camera_from_world[k], 0, static_cast<int>(k) < c.num_fixed});
  problem.points = start.points;
  Rng wrong(5);
  for (const SurveyObservation& o : truth.observations) {
    Vec2 pixel = o.pixel;
    if (wrong.Uniform() < 0.02) pixel += Vec2(wrong.Uniform(-30.0, 30.0), 12.0);
    problem.observations.push_back({o.image, o.point, pixel});
  }
  const Rigid3 body_from_camera(ExpSo3(Vec3(0.0, 0.1, 1.5)), Vec3(0.2, 0.1, 0.3));
  for (int k = 0; c.navigation && k < static_cast<int>(problem.images.size()); ++k) {
    const Rigid3 body = (body_from_camera * truth.camera_from_world[k]).Inverse();
    problem.priors.push_back(
        *MakeDepthPrior(k, body_from_camera, body.translation.z() + 0.01, 0.02));
    problem.priors.push_back(
        *MakeAttitudePrior(k, body_from_camera, body.rotation, Vec3::Constant(0.01)));
    if (k == 0) continue;
    const Rigid3 last = (body_from_camera * truth.camera_from_world[k - 1]).Inverse();
    problem.priors.push_back(*MakeDisplacementPrior(
        k - 1, k, body_from_camera, (last.Inverse() * body).translation, Vec3::Constant(0.01)));
    problem.priors.back().loss = {LossType::kCauchy, 2.0};
  }
  return problem;
}

BundleOptions Options(const Case& c) {
  BundleOptions options;
  options.loss = c.loss;
  options.function_tolerance = 1e-11;
  options.max_iterations = 200;
  if (c.refines_camera) {
    options.lens.focal = true;
    options.port.normal = options.port.distance = options.port.center = true;
    options.port.index_water = true;
  }
  return options;
}

class BundleAgainstCeresTest : public testing::TestWithParam<Case> {};

TEST_P(BundleAgainstCeresTest, SameOptimum) {
  const Case c = GetParam();
  BundleProblem ours = MakeProblem(c), theirs = ours;
  const auto report = AdjustBundle(Options(c), &ours);
  const auto oracle = AdjustBundleByCeres(Options(c), &theirs);
  ASSERT_TRUE(report && oracle);
  EXPECT_TRUE(report->converged);
  EXPECT_NEAR(report->initial_cost, oracle->initial_cost, 1e-9 * oracle->initial_cost);
  EXPECT_LT(report->final_cost, 0.5 * report->initial_cost);
  EXPECT_NEAR(report->final_cost, oracle->final_cost, 1e-6 * oracle->final_cost);
  double off = 0.0;
  for (std::size_t k = 0; k < ours.images.size(); ++k)
    off = std::max(off, (ours.images[k].camera_from_world.OriginOfTarget() -
                         theirs.images[k].camera_from_world.OriginOfTarget())
                            .norm());
  EXPECT_LT(off, c.refines_camera ? 2e-3 : 5e-4);
}

TEST_P(BundleAgainstCeresTest, DoesNotDependOnThreads) {
  BundleOptions options = Options(GetParam());
  options.max_iterations = 4;
  BundleProblem one = MakeProblem(GetParam()), three = one;
  options.num_threads = 1;
  ASSERT_TRUE(AdjustBundle(options, &one));
  options.num_threads = 3;
  ASSERT_TRUE(AdjustBundle(options, &three));
  for (std::size_t k = 0; k < one.images.size(); ++k) {
    EXPECT_EQ(one.images[k].camera_from_world.translation,
              three.images[k].camera_from_world.translation);
    EXPECT_EQ(one.images[k].camera_from_world.rotation.coeffs(),
              three.images[k].camera_from_world.rotation.coeffs());
  }
  for (std::size_t p = 0; p < one.points.size(); ++p) EXPECT_EQ(one.points[p], three.points[p]);
  EXPECT_EQ(one.cameras[0].lens_params[0], three.cameras[0].lens_params[0]);
}

const RobustLoss kCauchyLoss{LossType::kCauchy, 1.0}, kHuberLoss{LossType::kHuber, 1.0};
INSTANTIATE_TEST_SUITE_P(
    Problems, BundleAgainstCeresTest,
    testing::Values(Case{"flat", RigKind::kFlat, kCauchyLoss},
                    Case{"dome, Huber", RigKind::kDome, kHuberLoss},
                    Case{"no port, no loss, fixed", RigKind::kNone, {}, false, false, 2},
                    Case{"flat, lens and port", RigKind::kFlat, kCauchyLoss, true},
                    Case{"flat, lens, port, navigation", RigKind::kFlat, kCauchyLoss, true, true},
                    Case{"dome, lens, port, navigation", RigKind::kDome, kCauchyLoss, true, true}));

}  // namespace
}  // namespace rsfm
