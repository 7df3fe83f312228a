#include "tools/offline/bundle.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/offline/alignment.h"
#include "tests/support/ceres_costs.h"
#include "tests/support/rigs.h"
#include "tests/support/survey.h"
#include "tools/offline/camera_unknowns.h"

namespace rsfm {
namespace {

BundleProblem ToProblem(const CameraConfig& camera, const Survey& survey) {
  BundleProblem problem;
  problem.cameras = {camera};
  for (const Rigid3& pose : survey.camera_from_world) problem.images.push_back({pose, 0, false});
  problem.points = survey.points;
  for (const SurveyObservation& o : survey.observations)
    problem.observations.push_back({o.image, o.point, o.pixel});
  return problem;
}

Alignment Align(const BundleProblem& found, const Survey& truth) {
  std::vector<Vec3> from, to;
  for (const BundleImage& image : found.images)
    from.push_back(image.camera_from_world.OriginOfTarget());
  for (const Rigid3& pose : truth.camera_from_world) to.push_back(pose.OriginOfTarget());
  return AlignPlaces(from, to);
}

double PairDistance(const BundleProblem& problem, const std::array<int, 2>& pair) {
  return (problem.images[pair[0]].camera_from_world.OriginOfTarget() -
          problem.images[pair[1]].camera_from_world.OriginOfTarget())
      .norm();
}

SurveyOptions Small() {
  SurveyOptions options;
  options.lines = 4;
  options.images_per_line = 6;
  options.num_points = 700;
  return options;
}

class BundleTest : public testing::TestWithParam<RigKind> {
 protected:
  Rng rng_{4};
  AnyCamera camera_ = RandomRig(GetParam(), &rng_);
};

TEST_P(BundleTest, CalibratedReachesTheNoise) {
  const Survey truth = MakeSurvey(camera_, Small());
  Survey start = truth;
  Disturb(&start, 0, 0.005, 0.02, 0.05, 2);
  const BundleProblem before = ToProblem(camera_.config(), start);
  BundleProblem problem = before;
  const auto report = AdjustBundle({}, &problem);
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->converged);
  EXPECT_TRUE(report->gauge.position && report->gauge.attitude && report->gauge.scale);
  // Two-dimensional noise of 0.5 px: a mean length of 0.627 px, less what the unknowns absorb.
  EXPECT_LT(report->final_mean_error_px, 0.64);
  EXPECT_GT(report->final_mean_error_px, 0.45);
  const Alignment alignment = Align(problem, truth);
  EXPECT_LT(alignment.rms_m, 0.004);
  EXPECT_NEAR(alignment.scale, 1.0, 0.01);  // that of the far pair as it started
  // What was held has not moved.
  const std::array<int, 2> pair = FarPair(before);
  EXPECT_NEAR(PairDistance(problem, pair), PairDistance(before, pair),
              1e-3 * PairDistance(before, pair));
  const Rigid3 moved =
      problem.images[0].camera_from_world * before.images[0].camera_from_world.Inverse();
  EXPECT_LT(LogSe3(moved).norm(), 1e-6);
}

TEST_P(BundleTest, InterruptionKeepsWhatWasReached) {
  Survey start = MakeSurvey(camera_, Small());
  Disturb(&start, 0, 0.005, 0.02, 0.05, 2);
  BundleProblem problem = ToProblem(camera_.config(), start);
  BundleOptions options;
  int calls = 0;
  options.progress = [&calls](const BundleProgress& progress) {
    EXPECT_TRUE(std::isfinite(progress.cost));
    return ++calls < 2;
  };
  const auto report = AdjustBundle(options, &problem);
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->interrupted);
  EXPECT_LT(report->final_cost, report->initial_cost);
}

INSTANTIATE_TEST_SUITE_P(Ports, BundleTest,
                         testing::Values(RigKind::kNone, RigKind::kFlat, RigKind::kDome,
                                         RigKind::kCentredDome));

// The peer's failures in small: there, refining lens and port collapses or loses the scale.
class SelfCalibrationTest : public testing::TestWithParam<RigKind> {};

TEST_P(SelfCalibrationTest, KeepsFocalLengthAndScale) {
  CameraConfig truth_config = PaperLens();
  truth_config.port.type = GetParam() == RigKind::kFlat ? PortType::kFlat : PortType::kDome;
  truth_config.port.normal = Vec3(0.1, -0.05, 1.0).normalized();
  truth_config.port.distance_m = 0.025;
  truth_config.port.center_m = Vec3(0.004, -0.003, 0.008);
  truth_config.port.radius_m = 0.06;
  truth_config.port.thickness_m = 0.01;
  const Survey truth = MakeSurvey(*AnyCamera::Create(truth_config), Small());
  Survey start = truth;
  Disturb(&start, 0, 0.005, 0.02, 0.05, 2);
  CameraConfig config = truth_config;
  config.lens_params[0] *= 1.01;
  config.lens_params[1] *= 1.01;
  config.port.normal = Vec3::UnitZ();
  config.port.center_m = Vec3::Zero();
  config.port.distance_m = 0.02;
  BundleProblem problem = ToProblem(config, start);
  BundleOptions options;
  options.lens.focal = true;
  options.port.normal = options.port.distance = options.port.center = true;
  options.max_iterations = 100;
  const auto report = AdjustBundle(options, &problem);
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->converged);
  EXPECT_LT(report->final_mean_error_px, 0.64);
  const CameraConfig& found = problem.cameras[0];
  EXPECT_NEAR(found.lens_params[0] / truth_config.lens_params[0], 1.0, 0.005);
  EXPECT_NEAR(found.lens_params[1] / truth_config.lens_params[1], 1.0, 0.005);
  const Alignment alignment = Align(problem, truth);
  EXPECT_NEAR(alignment.scale, 1.0, 0.01);
  EXPECT_LT(alignment.rms_m, 0.01);
  if (GetParam() == RigKind::kFlat) {
    EXPECT_NEAR(found.port.normal.norm(), 1.0, 1e-9);
    EXPECT_LT((found.port.normal - truth_config.port.normal).norm(), 0.01);
    EXPECT_GT(found.port.distance_m, 0.0);
    EXPECT_LT(found.port.distance_m, 0.05);
  } else {
    EXPECT_LT((found.port.center_m - truth_config.port.center_m).norm(), 0.004);
  }
}

INSTANTIATE_TEST_SUITE_P(Ports, SelfCalibrationTest,
                         testing::Values(RigKind::kFlat, RigKind::kDome));

// A hundred images, the dome and the flat port of the peer's failures: refining focal length and
// port it finds a scale of 7.7. Here navigation gives the scale.
class HundredImagesTest : public testing::TestWithParam<RigKind> {};

TEST_P(HundredImagesTest, ScaleAndFocalLengthHold) {
  CameraConfig truth_config = PaperLens();
  truth_config.port.type = GetParam() == RigKind::kFlat ? PortType::kFlat : PortType::kDome;
  truth_config.port.normal = Vec3(0.1, -0.05, 1.0).normalized();
  truth_config.port.distance_m = 0.025;
  truth_config.port.center_m = Vec3(0.004, -0.003, 0.008);
  truth_config.port.radius_m = 0.06;
  truth_config.port.thickness_m = 0.01;
  SurveyOptions options;
  options.lines = options.images_per_line = 10;
  options.num_points = 3000;
  options.forward_m = 0.5;
  options.sideways_m = 0.8;
  const Survey truth = MakeSurvey(*AnyCamera::Create(truth_config), options);
  Survey start = truth;
  Disturb(&start, 0, 0.005, 0.02, 0.05, 2);
  CameraConfig config = truth_config;
  config.lens_params[0] *= 1.02;
  config.lens_params[1] *= 1.02;
  config.port.normal = Vec3::UnitZ();
  config.port.center_m = Vec3::Zero();
  config.port.distance_m = 0.02;
  BundleProblem problem = ToProblem(config, start);
  Rng rng(3);
  for (int k = 0; k < static_cast<int>(problem.images.size()); ++k) {
    const Vec3 noise(rng.Gaussian(0.0, 0.05), rng.Gaussian(0.0, 0.05), rng.Gaussian(0.0, 0.05));
    problem.priors.push_back(*MakePositionPrior(
        k, Rigid3(), truth.camera_from_world[k].OriginOfTarget() + noise, Vec3::Constant(0.05)));
  }
  BundleOptions bundle;
  bundle.lens.focal = true;
  bundle.port.normal = bundle.port.distance = bundle.port.center = true;
  const auto report = AdjustBundle(bundle, &problem);
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->converged);
  EXPECT_LT(report->iterations, 25);
  EXPECT_EQ(report->num_impossible, 0);
  EXPECT_LT(report->final_mean_error_px, 0.64);
  for (const int i : {0, 1})
    EXPECT_NEAR(problem.cameras[0].lens_params[i] / truth_config.lens_params[i], 1.0, 0.005);
  const Alignment alignment = Align(problem, truth);
  EXPECT_NEAR(alignment.scale, 1.0, 0.01);
  EXPECT_LT(alignment.rms_m, 0.01);
}

INSTANTIATE_TEST_SUITE_P(Ports, HundredImagesTest, testing::Values(RigKind::kFlat, RigKind::kDome));

TEST(BundleGaugeTest, NavigationHoldsWhatItMeasures) {
  Rng rng(1);
  const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
  const Survey survey = MakeSurvey(camera, Small());
  BundleProblem problem = ToProblem(camera.config(), survey);
  const int count = static_cast<int>(problem.images.size());
  EXPECT_TRUE(HoldGauge(problem).gauge.scale);
  EXPECT_FALSE(HoldGauge(problem, kSoftScale).gauge.scale);
  // A DVL: scale, nothing else.
  for (int k = 1; k < count; ++k) {
    const Rigid3 a = survey.camera_from_world[k - 1], b = survey.camera_from_world[k];
    problem.priors.push_back(*MakeDisplacementPrior(
        k - 1, k, Rigid3(), (a * b.Inverse()).translation, Vec3::Constant(0.05)));
  }
  BundleGauge gauge = HoldGauge(problem).gauge;
  EXPECT_FALSE(gauge.scale);
  EXPECT_TRUE(gauge.position && gauge.attitude);
  // Attitude besides.
  for (int k = 0; k < count; ++k)
    problem.priors.push_back(*MakeAttitudePrior(
        k, Rigid3(), survey.camera_from_world[k].rotation.conjugate(), Vec3::Constant(0.02)));
  gauge = HoldGauge(problem).gauge;
  EXPECT_TRUE(gauge.position);
  EXPECT_FALSE(gauge.attitude || gauge.scale);
  // Position alone holds everything.
  problem.priors.clear();
  for (int k = 0; k < count; ++k)
    problem.priors.push_back(*MakePositionPrior(
        k, Rigid3(), survey.camera_from_world[k].OriginOfTarget(), Vec3::Constant(0.5)));
  gauge = HoldGauge(problem).gauge;
  EXPECT_FALSE(gauge.position || gauge.attitude || gauge.scale);
}

TEST(BundleGaugeTest, NavigationCorrectsTheScale) {
  Rng rng(1);
  const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
  const Survey truth = MakeSurvey(camera, Small());
  Survey start = truth;
  for (Rigid3& pose : start.camera_from_world) pose.translation *= 1.2;
  for (Vec3& point : start.points) point *= 1.2;
  BundleProblem problem = ToProblem(camera.config(), start);
  const Rigid3 body_from_camera(ExpSo3(Vec3(0.0, 0.1, 1.5)), Vec3(0.2, 0.1, 0.3));
  for (std::size_t k = 0; k < problem.images.size(); ++k) {
    const Rigid3 body = truth.camera_from_world[k].Inverse() * body_from_camera.Inverse();
    problem.priors.push_back(*MakePositionPrior(static_cast<int>(k), body_from_camera,
                                                body.translation, Vec3::Constant(0.02)));
  }
  BundleOptions options;
  options.max_iterations = 100;
  const auto report = AdjustBundle(options, &problem);
  ASSERT_TRUE(report);
  EXPECT_FALSE(report->gauge.scale);
  EXPECT_NEAR(Align(problem, truth).scale, 1.0, 0.003);
}

// A dome that is off sideways by more than half its radius bends the rays enough to tell the scale.
// Held at a wrong scale its centre would go wrong with it.
TEST(BundleGaugeTest, DomesCentreAndScaleAreFoundTogether) {
  CameraConfig rig = PaperLens();
  rig.port.type = PortType::kDome;
  rig.port.center_m = Vec3(0.03, 0.0, 0.0);
  rig.port.radius_m = 0.05;
  rig.port.thickness_m = 0.007;
  SurveyOptions survey = Small();
  survey.altitude_m = 0.5;
  survey.forward_m = 0.1;
  survey.sideways_m = 0.15;
  survey.relief_m = 0.1;
  survey.noise_px = 0.2;
  const Survey truth = MakeSurvey(*AnyCamera::Create(rig), survey);
  Survey start = truth;
  Disturb(&start, 0, 0.005, 0.005, 0.01, 2);
  for (Rigid3& pose : start.camera_from_world) pose.translation *= 0.5;
  for (Vec3& point : start.points) point *= 0.5;
  CameraConfig wrong = rig;
  wrong.port.center_m += Vec3(0.003, 0.003, -0.003);
  const auto refined = [&](double scale_sigma) {
    BundleProblem problem = ToProblem(wrong, start);
    BundleOptions options;
    options.port.center = true;
    options.scale_sigma = scale_sigma;
    // As from round to round: the soft hold moves with the result.
    for (int round = 0; round < 6; ++round) {
      const auto report = AdjustBundle(options, &problem);
      EXPECT_TRUE(report);
      EXPECT_EQ(report->gauge.scale_from_refraction, scale_sigma == kSoftScale);
    }
    return problem;
  };
  const BundleProblem soft = refined(kSoftScale), held = refined(kHeldScale);
  EXPECT_LT((soft.cameras[0].port.center_m - rig.port.center_m).norm(), 2e-4);
  EXPECT_NEAR(Align(soft, truth).scale, 1.0, 0.05);
  EXPECT_GT((held.cameras[0].port.center_m - rig.port.center_m).norm(), 1e-3);
}

TEST(BundleGaugeTest, WhatTakesTheBendingOverLeavesNoScale) {
  BundleOptions options;
  EXPECT_FALSE(RaysTellScale(PortType::kNone, options));
  EXPECT_TRUE(RaysTellScale(PortType::kFlat, options));
  options.port.distance = true;  // what is expected of it tells
  EXPECT_TRUE(RaysTellScale(PortType::kFlat, options));
  EXPECT_TRUE(RaysTellScale(PortType::kDome, options));
  options.lens.focal = true;
  EXPECT_FALSE(RaysTellScale(PortType::kFlat, options));
  EXPECT_FALSE(RaysTellScale(PortType::kDome, options));
}

CameraConfig BehindWindow() {
  CameraConfig rig = PaperLens();
  rig.port.type = PortType::kFlat;
  rig.port.distance_m = 0.02;
  rig.port.thickness_m = 0.01;
  return rig;
}

TEST(CameraUnknownsTest, ADistancesPriorCountsRatios) {
  BundleOptions options;
  options.port.distance = true;
  const CameraConfig rig = BehindWindow();
  const CameraUnknowns unknowns(options, {rig});
  const auto cost = [&](double distance_m) {
    CameraConfig now = rig;
    now.port.distance_m = distance_m;
    return unknowns.PriorCost({now});
  };
  const double sigma = options.port.sigma_distance;
  EXPECT_NEAR(cost(0.02), 0.0, 1e-24);
  EXPECT_NEAR(cost(0.04), cost(0.01), 1e-12);
  EXPECT_NEAR(cost(0.04), 0.5 * std::pow(std::log(2.0) / sigma, 2), 1e-12);
  for (const double distance_m : {1e-4, 0.003, 0.02, 0.3}) {
    CameraConfig now = rig;
    now.port.distance_m = distance_m;
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(1, 1);
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(1);
    unknowns.AddPriors({now}, &information, &gradient);
    constexpr double kStep = 1e-7;
    EXPECT_NEAR(gradient[0], (cost(distance_m + kStep) - cost(distance_m - kStep)) / (2 * kStep),
                1e-4 * std::max(1.0, std::abs(gradient[0])));
    EXPECT_NEAR(information(0, 0), std::pow(PortSigmas(now, options.port)[3], -2),
                1e-9 * information(0, 0));
  }
}

// Adjustments that follow one another hold to what was expected, not each to the last one's result.
TEST(ExpectedCameraTest, HoldsThroughManyAdjustments) {
  const Survey survey = MakeSurvey(*AnyCamera::Create(BehindWindow()), Small());
  BundleOptions options;
  options.port.distance = true;
  options.sigma_px = 5.0;  // the data say little, the prior as much
  CameraConfig expected = BehindWindow();
  expected.port.distance_m = 0.06;
  BundleProblem once = ToProblem(expected, survey);
  once.expected_cameras = {expected};
  ASSERT_TRUE(AdjustBundle(options, &once));
  EXPECT_LT(once.cameras[0].port.distance_m, 0.058);
  EXPECT_GT(once.cameras[0].port.distance_m, 0.03);
  BundleProblem again = once;
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(AdjustBundle(options, &again));
  EXPECT_NEAR(again.cameras[0].port.distance_m, once.cameras[0].port.distance_m, 5e-4);
  again.expected_cameras.resize(2, expected);
  const auto wrong = AdjustBundle(options, &again);
  ASSERT_FALSE(wrong);
  EXPECT_STREQ(wrong.error().where, "expected_cameras");
}

TEST(FitNoiseTest, TakesTheMedianWithinBounds) {
  BundleOptions asked;
  asked.sigma_px = 1.0;
  asked.loss = {LossType::kCauchy, 2.0};
  ErrorSummary errors;
  errors.median_px = 0.3;
  BundleOptions fitted = FitNoise(asked, errors);
  EXPECT_NEAR(fitted.sigma_px, 0.3 / 1.1774, 1e-12);
  EXPECT_NEAR(fitted.loss.scale * fitted.sigma_px, 0.3, 1e-12);
  errors.median_px = 0.01;
  fitted = FitNoise(asked, errors);
  EXPECT_NEAR(fitted.sigma_px, 0.1, 1e-12);
  EXPECT_NEAR(fitted.loss.scale, 1.1774, 1e-12);
  errors.median_px = 5.0;  // worse than what was asked: as it was asked
  fitted = FitNoise(asked, errors);
  EXPECT_EQ(fitted.sigma_px, 1.0);
  EXPECT_EQ(fitted.loss.scale, 2.0);
  asked.loss.scale = 0.1;  // a loss that bends before the median stays there
  errors.median_px = 0.5;
  fitted = FitNoise(asked, errors);
  EXPECT_NEAR(fitted.loss.scale * fitted.sigma_px, 0.1, 1e-12);
}

// A tenth of the observations displaced by a few tenths of a pixel, all the same way, among others
// of 0.05 px: with the loss at one pixel they pull, with the noise as it shows they do not.
TEST(FitNoiseTest, KeepsWhatSlidesFromPulling) {
  const CameraConfig rig = PaperLens();
  SurveyOptions survey = Small();
  survey.noise_px = 0.05;
  const Survey truth = MakeSurvey(*AnyCamera::Create(rig), survey);
  BundleProblem problem = ToProblem(rig, truth);
  for (std::size_t i = 0; i < problem.observations.size(); i += 10)
    problem.observations[i].pixel += Vec2(0.5, 0.0) * (problem.observations[i].image % 3);
  const BundleOptions asked;
  ASSERT_TRUE(AdjustBundle(asked, &problem));
  const double before = Align(problem, truth).rms_m;
  const BundleOptions fitted = FitNoise(asked, *SummariseErrors(problem));
  EXPECT_LT(fitted.sigma_px, 0.2);
  ASSERT_TRUE(AdjustBundle(fitted, &problem));
  EXPECT_LT(Align(problem, truth).rms_m, 0.7 * before);
}

TEST(BundleInputTest, RefusesWithReasons) {
  const CameraConfig lens = PaperLens();
  const Survey survey = MakeSurvey(*AnyCamera::Create(lens), {});
  const auto where = [](BundleProblem problem) {
    const auto report = AdjustBundle({}, &problem);
    return report ? std::string() : std::string(report.error().where);
  };
  const BundleProblem good = ToProblem(lens, survey);
  BundleProblem bad = good;
  bad.points[3].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(where(bad), "point");
  bad = good;
  bad.observations[7].image = 1000;
  EXPECT_EQ(where(bad), "observation");
  bad = good;
  bad.observations.clear();
  EXPECT_EQ(where(bad), "observations");
  bad = good;
  bad.images[2].camera = 1;
  EXPECT_EQ(where(bad), "camera");
  bad = good;
  bad.images[2].camera_from_world.rotation.coeffs().setZero();
  EXPECT_EQ(where(bad), "camera_from_world");
  bad = good;
  bad.cameras[0].lens_params[0] = -1.0;
  EXPECT_EQ(where(bad), "params");
  bad = good;
  bad.priors.push_back(*MakeDepthPrior(500, Rigid3(), 1.0, 1.0));
  EXPECT_EQ(where(bad), "prior");
  bad = good;
  BundleOptions options;
  options.sigma_px = 0.0;
  EXPECT_EQ(AdjustBundle(options, &bad).error().code, Errc::kInvalidArgument);
}

TEST(PortManifoldTest, PlusAndMinusAreInverse) {
  RefinePort refine;
  refine.normal = refine.distance = refine.index_water = true;
  const PortManifold manifold(PortType::kFlat, refine);
  ASSERT_EQ(manifold.TangentSize(), 4);
  const Vec3 normal = Vec3(0.1, 0.2, -1.0).normalized();
  const double x[] = {normal.x(), normal.y(), normal.z(), 0.02, 0.01, 1.0, 1.5, 1.33};
  const double delta[] = {0.01, -0.02, 0.003, 0.001};
  double y[kNumPortParams], back[4];
  ASSERT_TRUE(manifold.Plus(x, delta, y));
  EXPECT_NEAR(Vec3(y[0], y[1], y[2]).norm(), 1.0, 1e-12);
  ASSERT_TRUE(manifold.Minus(y, x, back));
  for (int i = 0; i < 4; ++i) EXPECT_NEAR(back[i], delta[i], 1e-12);
  EXPECT_EQ(y[4], x[4]);
}

}  // namespace
}  // namespace rsfm
