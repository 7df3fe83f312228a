#include "rsfm/estimation/window_ba.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <limits>
#include <vector>

#include "rsfm/estimation/reprojection_residual.h"
#include "tests/support/malloc_trap.h"
#include "tests/support/rigs.h"
#include "tests/support/survey.h"

namespace rsfm {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

WindowBaOptions TightOptions() {
  WindowBaOptions options;
  options.max_iterations = 50;
  options.function_tolerance = 1e-14;
  return options;
}

void Fill(const Survey& survey, int num_fixed, WindowBa* ba) {
  ba->Clear();
  for (std::size_t k = 0; k < survey.camera_from_world.size(); ++k)
    ASSERT_TRUE(ba->AddKeyframe(survey.camera_from_world[k], 0, static_cast<int>(k) < num_fixed));
  for (const Vec3& point : survey.points) ASSERT_TRUE(ba->AddLandmark(point));
  for (const SurveyObservation& o : survey.observations)
    ASSERT_TRUE(ba->AddObservation(o.image, o.point, o.pixel));
}

class WindowBaTest : public testing::TestWithParam<RigKind> {
 protected:
  WindowBa MakeBa() {
    return *WindowBa::Create({.keyframes = 12, .landmarks = 500, .observations = 5000});
  }
  Rng rng_{3};
  std::vector<AnyCamera> cameras_{RandomRig(GetParam(), &rng_)};
};

TEST_P(WindowBaTest, FindsTheTruthWithoutNoise) {
  SurveyOptions options;
  options.noise_px = 0.0;
  const Survey truth = MakeSurvey(cameras_[0], options);
  Survey start = truth;
  Disturb(&start, 2, 0.005, 0.02, 0.05, 5);
  WindowBa ba = MakeBa();
  Fill(start, 2, &ba);
  const auto report = ba.Solve(cameras_, TightOptions());
  ASSERT_TRUE(report);
  EXPECT_EQ(report->end, WindowBaEnd::kConverged);
  EXPECT_EQ(report->num_impossible, 0);
  EXPECT_LT(report->rms_error_px, 1e-5);
  for (int k = 0; k < ba.num_keyframes(); ++k) {
    EXPECT_LT(LogSe3(ba.camera_from_world(k) * truth.camera_from_world[k].Inverse()).norm(), 1e-6);
  }
  for (int l = 0; l < ba.num_landmarks(); ++l)
    EXPECT_LT((ba.point_in_world(l) - truth.points[l]).norm(), 1e-5);
}

TEST_P(WindowBaTest, OutliersDoNotPull) {
  SurveyOptions options;
  options.noise_px = 0.3;
  Survey truth = MakeSurvey(cameras_[0], options);
  for (std::size_t i = 0; i < truth.observations.size(); i += 20)
    truth.observations[i].pixel += Vec2(60.0, -40.0);
  Survey start = truth;
  Disturb(&start, 2, 0.003, 0.01, 0.02, 5);
  WindowBa ba = MakeBa();
  Fill(start, 2, &ba);
  WindowBaOptions robust = TightOptions();
  robust.loss = {LossType::kCauchy, 1.0};
  ASSERT_TRUE(ba.Solve(cameras_, robust));
  for (int k = 0; k < ba.num_keyframes(); ++k) {
    const Vec3 off =
        ba.camera_from_world(k).OriginOfTarget() - truth.camera_from_world[k].OriginOfTarget();
    EXPECT_LT(off.norm(), 0.006) << k;
  }
}

TEST_P(WindowBaTest, ImpossibleObservationsAreReportedAndPullNothing) {
  SurveyOptions options;
  options.noise_px = 0.2;
  const Survey survey = MakeSurvey(cameras_[0], options);
  WindowBa ba = MakeBa();
  Fill(survey, 2, &ba);
  WindowBa with = MakeBa();
  Fill(survey, 2, &with);
  // A landmark behind every camera, above the vehicle.
  const int behind = *with.AddLandmark(Vec3(1.0, 1.0, -40.0));
  std::vector<int> impossible;
  for (int k = 0; k < 4; ++k)
    impossible.push_back(*with.AddObservation(k, behind, Vec2(960.0, 540.0)));
  const auto report = with.Solve(cameras_, TightOptions());
  ASSERT_TRUE(report);
  ASSERT_TRUE(ba.Solve(cameras_, TightOptions()));
  EXPECT_EQ(report->num_impossible, 4);
  for (const int i : impossible) {
    EXPECT_NE(with.observation_status(i), Projection::kOk);
    EXPECT_EQ(with.observation_error_px(i), 0.0);
  }
  EXPECT_EQ(with.point_in_world(behind), Vec3(1.0, 1.0, -40.0));
  for (int k = 0; k < ba.num_keyframes(); ++k) {
    EXPECT_LT((with.camera_from_world(k).translation - ba.camera_from_world(k).translation).norm(),
              1e-6);
  }
}

TEST_P(WindowBaTest, SameCallsGiveTheSameBits) {
  Survey survey = MakeSurvey(cameras_[0], {});
  Disturb(&survey, 1, 0.003, 0.01, 0.02, 5);
  WindowBa first = MakeBa(), second = MakeBa();
  Fill(survey, 1, &first);
  Fill(survey, 1, &second);
  ASSERT_TRUE(first.Solve(cameras_, {}));
  ASSERT_TRUE(second.Solve(cameras_, {}));
  // And again in used memory.
  Fill(survey, 1, &first);
  ASSERT_TRUE(first.Solve(cameras_, {}));
  for (int k = 0; k < first.num_keyframes(); ++k) {
    EXPECT_EQ(first.camera_from_world(k).translation, second.camera_from_world(k).translation);
    EXPECT_EQ(first.camera_from_world(k).rotation.coeffs(),
              second.camera_from_world(k).rotation.coeffs());
  }
}

TEST_P(WindowBaTest, DoesNotAllocateAfterCreate) {
  Survey survey = MakeSurvey(cameras_[0], {});
  Disturb(&survey, 1, 0.003, 0.01, 0.02, 5);
  WindowBa ba = MakeBa();
  MallocTrap trap;
  Fill(survey, 1, &ba);
  ASSERT_TRUE(ba.AddPrior(*MakeBaselinePrior(0, 5, Rigid3(), 2.0, 0.1)));
  ASSERT_TRUE(ba.Solve(cameras_, {}));
  ASSERT_TRUE(ba.PoseCovariance(ba.num_keyframes() - 1));
  EXPECT_EQ(trap.count(), 0u);
}

TEST_P(WindowBaTest, AllPriorsAndNoFixedPose) {
  SurveyOptions options;
  options.noise_px = 0.3;
  const Survey truth = MakeSurvey(cameras_[0], options);
  Survey start = truth;
  Disturb(&start, 0, 0.01, 0.05, 0.05, 9);
  const Rigid3 body_from_camera(ExpSo3(Vec3(0.1, 0.2, 1.5)), Vec3(0.3, 0.1, 0.2));
  WindowBa ba = MakeBa();
  Fill(start, 0, &ba);
  const auto world_from_body = [&](int k) {
    return truth.camera_from_world[k].Inverse() * body_from_camera.Inverse();
  };
  const int last = ba.num_keyframes() - 1;
  const Vec3 sigma = Vec3::Constant(0.01);
  for (int k = 0; k <= last; ++k) {
    const Rigid3 body = world_from_body(k);
    ASSERT_TRUE(ba.AddPrior(*MakePositionPrior(k, body_from_camera, body.translation, sigma)));
    ASSERT_TRUE(ba.AddPrior(*MakeDepthPrior(k, body_from_camera, body.translation.z(), 0.005)));
    ASSERT_TRUE(ba.AddPrior(*MakeAttitudePrior(k, body_from_camera, body.rotation, sigma)));
    if (k == 0) continue;
    const Rigid3 before_from_body = world_from_body(k - 1).Inverse() * body;
    ASSERT_TRUE(ba.AddPrior(
        *MakeDisplacementPrior(k - 1, k, body_from_camera, before_from_body.translation, sigma)));
    ASSERT_TRUE(ba.AddPrior(*MakeRelativePosePrior(
        k, k - 1, body_from_camera, before_from_body.Inverse(), 1e-4 * Mat6::Identity())));
  }
  const auto report = ba.Solve(cameras_, TightOptions());
  ASSERT_TRUE(report);
  EXPECT_LT(report->rms_error_px, 0.5);
  for (int k = 0; k <= last; ++k) {
    EXPECT_LT(
        (ba.camera_from_world(k).OriginOfTarget() - truth.camera_from_world[k].OriginOfTarget())
            .norm(),
        0.01);
  }
}

// Against the inverse of the whole normal matrix, made here from the residual's derivatives.
TEST_P(WindowBaTest, CovarianceIsTheMarginalOfTheWholeSystem) {
  SurveyOptions options;
  options.images_per_line = 2;
  options.num_points = 60;
  options.noise_px = 0.4;
  const Survey survey = MakeSurvey(cameras_[0], options);
  WindowBa ba = MakeBa();
  Fill(survey, 2, &ba);
  WindowBaOptions plain = TightOptions();
  plain.loss.type = LossType::kNone;
  ASSERT_TRUE(ba.Solve(cameras_, plain));
  const int poses = ba.num_keyframes() - 2;
  const int size = 6 * poses + 3 * ba.num_landmarks();
  Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(size, size);
  for (const SurveyObservation& o : survey.observations) {
    Vec2 error;
    Mat26 d_pose;
    Mat23 d_point;
    ASSERT_EQ(ReprojectionError(cameras_[0], ba.camera_from_world(o.image),
                                ba.point_in_world(o.point), o.pixel, &error, &d_pose, &d_point),
              Projection::kOk);
    const int p = 6 * poses + 3 * o.point, c = 6 * (o.image - 2);
    hessian.block<3, 3>(p, p) += d_point.transpose() * d_point;
    if (o.image < 2) continue;
    hessian.block<6, 6>(c, c) += d_pose.transpose() * d_pose;
    hessian.block<6, 3>(c, p) += d_pose.transpose() * d_point;
    hessian.block<3, 6>(p, c) += d_point.transpose() * d_pose;
  }
  const Eigen::MatrixXd inverse = hessian.ldlt().solve(Eigen::MatrixXd::Identity(size, size));
  const auto covariance = ba.PoseCovariance(ba.num_keyframes() - 1);
  ASSERT_TRUE(covariance);
  const Mat6 expected = inverse.block<6, 6>(6 * (poses - 1), 6 * (poses - 1));
  EXPECT_LT((*covariance - expected).norm(), 1e-6 * expected.norm());
  EXPECT_EQ(ba.PoseCovariance(0)->norm(), 0.0);
}

TEST_P(WindowBaTest, IterationsAreBounded) {
  Survey survey = MakeSurvey(cameras_[0], {});
  Disturb(&survey, 1, 0.01, 0.05, 0.1, 5);
  WindowBa ba = MakeBa();
  Fill(survey, 1, &ba);
  WindowBaOptions options;
  options.max_iterations = 1;
  const auto report = ba.Solve(cameras_, options);
  ASSERT_TRUE(report);
  EXPECT_EQ(report->iterations, 1);
  EXPECT_EQ(report->end, WindowBaEnd::kIterationLimit);
  EXPECT_LE(report->final_cost, report->initial_cost);
}

INSTANTIATE_TEST_SUITE_P(Ports, WindowBaTest,
                         testing::Values(RigKind::kNone, RigKind::kFlat, RigKind::kDome,
                                         RigKind::kCentredDome));

TEST(WindowBaInputTest, MixedCamerasInOneProblem) {
  Rng rng(5);
  const std::vector<AnyCamera> cameras = {RandomRig(RigKind::kFlat, &rng),
                                          RandomRig(RigKind::kDome, &rng)};
  SurveyOptions options;
  options.noise_px = 0.0;
  options.num_points = 200;
  const Survey flat = MakeSurvey(cameras[0], options);
  WindowBa ba = *WindowBa::Create({.keyframes = 10, .landmarks = 500, .observations = 5000});
  for (std::size_t k = 0; k < flat.camera_from_world.size(); ++k)
    ASSERT_TRUE(ba.AddKeyframe(k < 2 ? flat.camera_from_world[k]
                                     : Perturb(flat.camera_from_world[k], Vec6::Constant(0.002)),
                               static_cast<int>(k % 2), k < 2));
  for (const Vec3& point : flat.points) ASSERT_TRUE(ba.AddLandmark(point));
  for (const SurveyObservation& o : flat.observations) {
    Vec2 pixel = o.pixel;
    if (o.image % 2 == 1 &&
        cameras[1].Project(flat.camera_from_world[o.image] * flat.points[o.point], &pixel) !=
            Projection::kOk)
      continue;
    ASSERT_TRUE(ba.AddObservation(o.image, o.point, pixel));
  }
  const auto report = ba.Solve(cameras, TightOptions());
  ASSERT_TRUE(report);
  EXPECT_LT(report->rms_error_px, 1e-5);
}

TEST(WindowBaInputTest, RefusesWithReasons) {
  EXPECT_EQ(WindowBa::Create({.keyframes = 0}).error().code, Errc::kInvalidArgument);
  WindowBa ba = *WindowBa::Create({.keyframes = 2, .landmarks = 1, .observations = 1, .priors = 1});
  const std::vector<AnyCamera> cameras = {*AnyCamera::Create(PaperLens())};
  Rigid3 bad;
  bad.translation.x() = kNan;
  EXPECT_STREQ(ba.AddKeyframe(bad).error().where, "camera_from_world");
  EXPECT_STREQ(ba.AddLandmark(Vec3(0.0, kNan, 0.0)).error().where, "point_in_world");
  EXPECT_EQ(ba.AddObservation(0, 0, Vec2(1.0, 1.0)).error().code, Errc::kNotFound);
  ASSERT_TRUE(ba.AddKeyframe(Rigid3()));
  EXPECT_EQ(ba.Solve(cameras, {}).error().code, Errc::kNotEnoughData);
  ASSERT_TRUE(ba.AddLandmark(Vec3(0.0, 0.0, 3.0)));
  EXPECT_EQ(ba.AddLandmark(Vec3(0.0, 0.0, 3.0)).error().code, Errc::kOutOfCapacity);
  EXPECT_STREQ(ba.AddObservation(0, 0, Vec2(kNan, 1.0)).error().where, "pixel");
  EXPECT_STREQ(ba.AddObservation(0, 0, Vec2(1.0, 1.0), 0.0).error().where, "sigma_px");
  ASSERT_TRUE(ba.AddObservation(0, 0, Vec2(960.0, 540.0)));
  EXPECT_EQ(ba.AddObservation(0, 0, Vec2(960.0, 540.0)).error().code, Errc::kOutOfCapacity);
  EXPECT_EQ(ba.Solve(cameras, {}).error().code, Errc::kDegenerate);  // nothing holds the gauge
  EXPECT_EQ(ba.AddPrior(*MakeBaselinePrior(0, 1, Rigid3(), 1.0, 0.1)).error().code,
            Errc::kNotFound);
  ASSERT_TRUE(ba.AddKeyframe(Rigid3(), 3, true));
  EXPECT_STREQ(ba.Solve(cameras, {}).error().where, "camera");
  EXPECT_EQ(ba.AddKeyframe(Rigid3()).error().code, Errc::kOutOfCapacity);
  EXPECT_EQ(ba.PoseCovariance(0).error().code, Errc::kNotFound);
  WindowBaOptions options;
  options.max_iterations = 0;
  EXPECT_STREQ(ba.Solve(cameras, options).error().where, "max_iterations");
}

// One fixed pose and a central camera: the scale is free, and the covariance must say so.
TEST(WindowBaInputTest, FreeScaleHasNoCovariance) {
  const std::vector<AnyCamera> cameras = {*AnyCamera::Create(PaperLens())};
  const Survey survey = MakeSurvey(cameras[0], {});
  WindowBa ba = *WindowBa::Create({});
  Fill(survey, 1, &ba);
  ASSERT_TRUE(ba.Solve(cameras, TightOptions()));
  EXPECT_EQ(ba.PoseCovariance(5).error().code, Errc::kDegenerate);
  const double length =
      (survey.camera_from_world[5].OriginOfTarget() - survey.camera_from_world[0].OriginOfTarget())
          .norm();
  Fill(survey, 1, &ba);
  ASSERT_TRUE(ba.AddPrior(*MakeBaselinePrior(0, 5, Rigid3(), length, 0.01)));
  ASSERT_TRUE(ba.Solve(cameras, TightOptions()));
  EXPECT_TRUE(ba.PoseCovariance(5));
}

}  // namespace
}  // namespace rsfm
