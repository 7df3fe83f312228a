#include "rsfm/estimation/absolute_pose.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <limits>

#include "tests/estimation/scenes.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

AbsolutePoseOptions PaperOptions() {
  AbsolutePoseOptions options;
  options.ransac.max_error_px = 12.0;
  options.ransac.confidence = 0.99999;
  return options;
}

struct PortBounds {
  RigKind kind;
  double rotation_deg, position_mm;  // at 1 px of noise: the published figures where there are any
};

class AbsolutePoseTest : public ::testing::TestWithParam<PortBounds> {};

TEST_P(AbsolutePoseTest, IsExactWithoutNoise) {
  Rng rng(1);
  AbsolutePoseEstimator estimator(200);
  for (int k = 0; k < 20; ++k) {
    const AnyCamera camera = RandomRig(GetParam().kind, &rng);
    const AbsoluteScene scene = MakeAbsoluteScene(camera, 0.0, 0.3, 200, &rng);
    const auto report =
        estimator.Estimate(camera, scene.pixels, scene.points_in_world, PaperOptions());
    ASSERT_TRUE(report) << report.error().where;
    EXPECT_LT(AngleBetween(report->camera_from_world.rotation, scene.camera_from_world.rotation),
              1e-6);
    EXPECT_LT((report->camera_from_world.translation - scene.camera_from_world.translation).norm(),
              1e-6);
    EXPECT_GE(report->num_inliers, 140);
    for (int i = scene.num_outliers; i < 200; ++i) EXPECT_EQ(estimator.inlier_mask()[i], 1);
  }
}

// At one pixel of noise: accuracy, the inliers found, and a covariance that tells the error.
TEST_P(AbsolutePoseTest, IsAccurateAndKnowsHowAccurate) {
  Rng rng(2);
  AbsolutePoseEstimator estimator(200);
  double rotation = 0.0, position = 0.0, normalised = 0.0;
  constexpr int kCases = 100;
  for (int k = 0; k < kCases; ++k) {
    const AnyCamera camera = RandomRig(GetParam().kind, &rng);
    const AbsoluteScene scene = MakeAbsoluteScene(camera, 1.0, 0.3, 200, &rng);
    AbsolutePoseOptions options = PaperOptions();
    options.ransac.seed = k + 1;
    const auto report = estimator.Estimate(camera, scene.pixels, scene.points_in_world, options);
    ASSERT_TRUE(report) << report.error().where;
    rotation +=
        Degrees(AngleBetween(report->camera_from_world.rotation, scene.camera_from_world.rotation));
    position += 1e3 * (report->camera_from_world.OriginOfTarget() -
                       scene.camera_from_world.OriginOfTarget())
                          .norm();
    const Vec6 error = LogSe3(report->camera_from_world * scene.camera_from_world.Inverse());
    normalised += error.dot(report->covariance.inverse() * error);
    EXPECT_NEAR(report->num_inliers, 140, 3);
    EXPECT_NEAR(report->sigma_px, 1.0, 0.3);
  }
  EXPECT_LT(rotation / kCases, GetParam().rotation_deg);
  EXPECT_LT(position / kCases, GetParam().position_mm);
  EXPECT_NEAR(normalised / kCases, 6.0, 1.5);
}

INSTANTIATE_TEST_SUITE_P(Ports, AbsolutePoseTest,
                         ::testing::Values(PortBounds{RigKind::kNone, 0.0125, 0.48},
                                           PortBounds{RigKind::kFlat, 0.0125, 0.45},
                                           PortBounds{RigKind::kDome, 0.0125, 0.48},
                                           PortBounds{RigKind::kCentredDome, 0.0125, 0.48}));

TEST(AbsolutePose, SurvivesSixtyPercentOutliers) {
  Rng rng(3);
  AbsolutePoseEstimator estimator(200);
  for (int k = 0; k < 20; ++k) {
    const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
    const AbsoluteScene scene = MakeAbsoluteScene(camera, 0.5, 0.6, 200, &rng);
    const auto report =
        estimator.Estimate(camera, scene.pixels, scene.points_in_world, PaperOptions());
    ASSERT_TRUE(report) << report.error().where;
    EXPECT_LT(
        Degrees(AngleBetween(report->camera_from_world.rotation, scene.camera_from_world.rotation)),
        0.05);
  }
}

// Samples of two points instead of three: three in four points may be wrong.
TEST(AbsolutePose, TakesGravityFromAnAttitudeSensor) {
  Rng rng(31);
  AbsolutePoseEstimator estimator(200);
  int samples_of_two = 0, samples_of_three = 0;
  for (const RigKind kind :
       {RigKind::kNone, RigKind::kFlat, RigKind::kDome, RigKind::kCentredDome}) {
    for (int k = 0; k < 5; ++k) {
      const AnyCamera camera = RandomRig(kind, &rng);
      const AbsoluteScene scene = MakeAbsoluteScene(camera, 0.5, 0.75, 200, &rng);
      AbsolutePoseOptions options = PaperOptions();
      const auto plain = estimator.Estimate(camera, scene.pixels, scene.points_in_world, options);
      if (plain) samples_of_three += plain->ransac.iterations;
      options.down_in_world = Vec3(0.1, -0.1, 1.0).normalized();
      // An attitude that is off by a twentieth of a degree.
      options.down_in_camera = ExpSo3(Vec3(0.0009, 0.0, 0.0)) *
                               (scene.camera_from_world.rotation * options.down_in_world);
      const auto report = estimator.Estimate(camera, scene.pixels, scene.points_in_world, options);
      ASSERT_TRUE(report) << report.error().where;
      samples_of_two += report->ransac.iterations;
      EXPECT_LT(Degrees(AngleBetween(report->camera_from_world.rotation,
                                     scene.camera_from_world.rotation)),
                0.08);
    }
  }
  EXPECT_LT(2 * samples_of_two, samples_of_three);
  AbsolutePoseOptions options;
  options.down_in_camera = Vec3(0.0, 0.0, 1.0);
  EXPECT_STREQ(options.Validate().error().where, "down_in_world");
  options.down_in_world = Vec3(0.0, kNan, 1.0);
  EXPECT_STREQ(options.Validate().error().where, "down_in_world");
}

TEST(AbsolutePose, EveryScoringAndOrderGivesThePose) {
  Rng rng(32);
  AbsolutePoseEstimator estimator(200);
  for (int k = 0; k < 10; ++k) {
    const AnyCamera camera = RandomRig(k % 2 == 0 ? RigKind::kFlat : RigKind::kDome, &rng);
    AbsoluteScene scene = MakeAbsoluteScene(camera, 0.5, 0.5, 200, &rng);
    std::reverse(scene.pixels.begin(), scene.pixels.end());  // the outliers last
    std::reverse(scene.points_in_world.begin(), scene.points_in_world.end());
    for (const RansacScoring scoring : {RansacScoring::kMsac, RansacScoring::kMagsac}) {
      for (const bool sorted : {false, true}) {
        AbsolutePoseOptions options = PaperOptions();
        options.ransac.scoring = scoring;
        options.ransac.sorted_by_quality = sorted;
        const auto report =
            estimator.Estimate(camera, scene.pixels, scene.points_in_world, options);
        ASSERT_TRUE(report) << report.error().where;
        EXPECT_LT(Degrees(AngleBetween(report->camera_from_world.rotation,
                                       scene.camera_from_world.rotation)),
                  0.05);
      }
    }
  }
}

TEST(AbsolutePose, RefinesAPriorPose) {
  Rng rng(4);
  AbsolutePoseEstimator estimator(200);
  for (const RigKind kind :
       {RigKind::kNone, RigKind::kFlat, RigKind::kDome, RigKind::kCentredDome}) {
    for (int k = 0; k < 20; ++k) {
      const AnyCamera camera = RandomRig(kind, &rng);
      const AbsoluteScene scene = MakeAbsoluteScene(camera, 0.5, 0.2, 200, &rng);
      Vec6 offset;
      for (int i = 0; i < 6; ++i) offset[i] = rng.Gaussian(0.0, i < 3 ? 0.02 : 0.05);
      const auto report =
          estimator.Refine(camera, scene.pixels, scene.points_in_world,
                           Perturb(scene.camera_from_world, offset), PaperOptions());
      ASSERT_TRUE(report) << report.error().where << " " << report.error().detail;
      EXPECT_LT(Degrees(AngleBetween(report->camera_from_world.rotation,
                                     scene.camera_from_world.rotation)),
                0.05);
      EXPECT_NEAR(report->num_inliers, 160, 3);
      EXPECT_EQ(report->ransac.iterations, 0);
    }
  }
}

TEST(AbsolutePose, TellsAPoseThatIsWrongFromOneThatIsRight) {
  Rng rng(5);
  AbsolutePoseEstimator estimator(200);
  const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
  AbsoluteScene scene = MakeAbsoluteScene(camera, 0.5, 0.0, 200, &rng);
  for (Vec2& pixel : scene.pixels) pixel = Vec2(rng.Uniform(0.0, 1920.0), rng.Uniform(0.0, 1080.0));
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {  // all outliers
    AbsolutePoseOptions options = PaperOptions();
    options.ransac.seed = seed;
    options.ransac.max_iterations = 2000;
    const auto report = estimator.Estimate(camera, scene.pixels, scene.points_in_world, options);
    ASSERT_FALSE(report);
    EXPECT_EQ(report.error().code, Errc::kNotEnoughInliers);
  }
  EXPECT_EQ(estimator
                .Refine(camera, scene.pixels, scene.points_in_world, scene.camera_from_world,
                        PaperOptions())
                .error()
                .code,
            Errc::kNotEnoughInliers);
}

// Points on a line or in one place, exactly or nearly, do not determine the pose.
TEST(AbsolutePose, RefusesPointsThatDoNotDetermineThePose) {
  Rng rng(6);
  AbsolutePoseEstimator estimator(100);
  for (const RigKind kind :
       {RigKind::kNone, RigKind::kFlat, RigKind::kDome, RigKind::kCentredDome}) {
    for (const double thickness : {0.0, 1e-7, 1e-4}) {
      const AnyCamera camera = RandomRig(kind, &rng);
      for (const double length : {0.0, 2.0}) {
        std::vector<Vec2> pixels;
        std::vector<Vec3> points;
        for (int i = 0; i < 100; ++i) {
          const Vec3 point = Vec3(-0.2, 0.1, 3.0) +
                             length * rng.Uniform(-0.5, 0.5) * Vec3(1.0, 0.2, 0.3) +
                             thickness * Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian());
          Vec2 pixel;
          ASSERT_EQ(camera.Project(point, &pixel), Projection::kOk);
          points.push_back(point);
          pixels.push_back(pixel + GaussianPixel(&rng, 0.5));
        }
        const auto report = estimator.Estimate(camera, pixels, points, PaperOptions());
        ASSERT_FALSE(report) << "thickness " << thickness << " length " << length;
        EXPECT_TRUE(report.error().code == Errc::kDegenerate ||
                    report.error().code == Errc::kNotEnoughInliers)
            << ToString(report.error().code);
        EXPECT_FALSE(estimator.Refine(camera, pixels, points, Rigid3(), PaperOptions()));
      }
    }
  }
}

TEST(AbsolutePose, WorksOnAPlane) {
  Rng rng(7);
  AbsolutePoseEstimator estimator(100);
  const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
  std::vector<Vec2> pixels;
  std::vector<Vec3> points;
  while (points.size() < 100) {
    const Vec3 point(rng.Uniform(-1.5, 1.5), rng.Uniform(-1.0, 1.0), 3.0);
    Vec2 pixel;
    if (camera.Project(point, &pixel) != Projection::kOk) continue;
    points.push_back(point);
    pixels.push_back(pixel + GaussianPixel(&rng, 0.5));
  }
  const auto report = estimator.Estimate(camera, pixels, points, PaperOptions());
  ASSERT_TRUE(report);
  EXPECT_LT(Degrees(AngleBetween(report->camera_from_world.rotation, Quat::Identity())), 0.2);
}

TEST(AbsolutePose, NamesWhatIsWrong) {
  Rng rng(8);
  AbsolutePoseEstimator estimator(200);
  const AnyCamera camera = RandomRig(RigKind::kDome, &rng);
  const AbsoluteScene scene = MakeAbsoluteScene(camera, 0.5, 0.0, 200, &rng);
  const std::span<const Vec2> pixels = scene.pixels;
  const std::span<const Vec3> points = scene.points_in_world;
  EXPECT_EQ(
      estimator.Estimate(camera, pixels.first(7), points.first(7), PaperOptions()).error().code,
      Errc::kNotEnoughData);
  EXPECT_EQ(estimator.Estimate(camera, {}, {}, PaperOptions()).error().code, Errc::kNotEnoughData);
  EXPECT_EQ(estimator.Estimate(camera, pixels, points.first(7), PaperOptions()).error().code,
            Errc::kInvalidArgument);
  AbsolutePoseEstimator small(10);
  EXPECT_EQ(small.Estimate(camera, pixels, points, PaperOptions()).error().code,
            Errc::kOutOfCapacity);
  AbsolutePoseOptions options = PaperOptions();
  options.ransac.max_error_px = -1.0;
  EXPECT_STREQ(estimator.Estimate(camera, pixels, points, options).error().where, "max_error_px");
  Rigid3 start = scene.camera_from_world;
  start.translation.x() = kNan;
  EXPECT_EQ(estimator.Refine(camera, pixels, points, start, PaperOptions()).error().code,
            Errc::kInvalidArgument);
}

TEST(AbsolutePose, LeavesNanOut) {
  Rng rng(9);
  AbsolutePoseEstimator estimator(200);
  const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
  AbsoluteScene scene = MakeAbsoluteScene(camera, 0.5, 0.2, 200, &rng);
  for (int i = 50; i < 70; ++i) {
    if (i % 2 == 0) scene.pixels[i].x() = kNan;
    if (i % 2 == 1) scene.points_in_world[i].z() = std::numeric_limits<double>::infinity();
  }
  const auto report =
      estimator.Estimate(camera, scene.pixels, scene.points_in_world, PaperOptions());
  ASSERT_TRUE(report);
  EXPECT_EQ(report->num_unusable, 20);
  EXPECT_LT(
      Degrees(AngleBetween(report->camera_from_world.rotation, scene.camera_from_world.rotation)),
      0.05);
  for (int i = 50; i < 70; ++i) EXPECT_EQ(estimator.inlier_mask()[i], 0);
  for (Vec2& pixel : scene.pixels) pixel.x() = kNan;
  EXPECT_EQ(
      estimator.Estimate(camera, scene.pixels, scene.points_in_world, PaperOptions()).error().code,
      Errc::kNotEnoughData);
}

TEST(AbsolutePose, RepeatsBitForBitAndDoesNotTouchTheHeap) {
  Rng rng(10);
  AbsolutePoseEstimator first(200), second(300);
  const AnyCamera camera = RandomRig(RigKind::kDome, &rng);
  const AbsoluteScene scene = MakeAbsoluteScene(camera, 1.0, 0.3, 200, &rng);
  const AbsolutePoseOptions options = PaperOptions();
  const auto expected = second.Estimate(camera, scene.pixels, scene.points_in_world, options);
  const MallocTrap trap;
  const auto report = first.Estimate(camera, scene.pixels, scene.points_in_world, options);
  const auto refined =
      first.Refine(camera, scene.pixels, scene.points_in_world, scene.camera_from_world, options);
  EXPECT_EQ(trap.count(), 0u);
  ASSERT_TRUE(report && expected && refined);
  EXPECT_EQ(report->camera_from_world.translation, expected->camera_from_world.translation);
  EXPECT_EQ(report->camera_from_world.rotation.coeffs(),
            expected->camera_from_world.rotation.coeffs());
  EXPECT_EQ(report->covariance, expected->covariance);
}

}  // namespace
}  // namespace rsfm
