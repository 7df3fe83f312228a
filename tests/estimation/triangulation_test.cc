#include "rsfm/estimation/triangulation.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <limits>
#include <vector>

#include "tests/estimation/scenes.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// Cameras in a row that see a point some metres ahead.
std::vector<TriangulationView> MakeViews(const AnyCamera& camera, const Vec3& point, int count,
                                         double noise_px, Rng* rng) {
  std::vector<TriangulationView> views;
  for (int tries = 0; static_cast<int>(views.size()) < count && tries < 10000; ++tries) {
    TriangulationView view;
    view.camera = &camera;
    const Vec3 turn(rng->Uniform(-0.2, 0.2), rng->Uniform(-0.2, 0.2), rng->Uniform(-1.0, 1.0));
    const Rigid3 world_from_camera(ExpSo3(turn),
                                   Vec3(rng->Uniform(-1.0, 1.0), rng->Uniform(-1.0, 1.0), 0.0));
    view.camera_from_world = world_from_camera.Inverse();
    if (camera.Project(view.camera_from_world * point, &view.pixel) != Projection::kOk) continue;
    if (!camera.IsInImage(view.pixel)) continue;
    view.pixel += GaussianPixel(rng, noise_px);
    views.push_back(view);
  }
  return views;
}

class TriangulationTest : public ::testing::TestWithParam<RigKind> {};

TEST_P(TriangulationTest, IsExactWithoutNoise) {
  Rng rng(1);
  for (int k = 0; k < 100; ++k) {
    const AnyCamera camera = RandomRig(GetParam(), &rng);
    const Vec3 point(rng.Uniform(-0.5, 0.5), rng.Uniform(-0.5, 0.5), rng.Uniform(2.0, 6.0));
    const auto views = MakeViews(camera, point, 2 + k % 5, 0.0, &rng);
    TriangulationOptions options;
    options.min_angle_rad = 0.0;
    const auto report = Triangulate(views, options);
    ASSERT_TRUE(report) << ToString(report.error().code) << " " << report.error().where;
    const double precision = 1e-11 / std::max(1e-3, report->max_angle_rad);
    EXPECT_LT((report->point_in_world - point).norm(), precision * 10.0);
    EXPECT_LT(report->max_error_px, 1e-7);
  }
}

// The normalised squared error is chi-square with three degrees of freedom.
TEST_P(TriangulationTest, CovarianceTellsTheError) {
  Rng rng(2);
  double sum = 0.0;
  int count = 0;
  for (int k = 0; k < 400; ++k) {
    const AnyCamera camera = RandomRig(GetParam(), &rng);
    const Vec3 point(rng.Uniform(-0.5, 0.5), rng.Uniform(-0.5, 0.5), rng.Uniform(2.0, 4.0));
    TriangulationOptions options;
    options.sigma_px = 0.5;
    options.min_angle_rad = 0.1;
    const auto report = Triangulate(MakeViews(camera, point, 4, 0.5, &rng), options);
    if (!report) continue;
    const Vec3 error = report->point_in_world - point;
    sum += error.dot(report->covariance.inverse() * error);
    ++count;
  }
  ASSERT_GT(count, 300);
  EXPECT_NEAR(sum / count, 3.0, 0.5);
}

TEST_P(TriangulationTest, RobustLeavesOutWrongObservations) {
  Rng rng(3);
  for (int k = 0; k < 50; ++k) {
    const AnyCamera camera = RandomRig(GetParam(), &rng);
    const Vec3 point(0.1, -0.2, 3.0);
    auto views = MakeViews(camera, point, 8, 0.3, &rng);
    views[1].pixel += Vec2(70.0, 40.0);
    views[6].pixel -= Vec2(30.0, 90.0);
    std::vector<std::uint8_t> inliers(views.size());
    const auto report = TriangulateRobust(views, TriangulationOptions{}, 3, inliers);
    ASSERT_TRUE(report) << ToString(report.error().code) << " " << report.error().where;
    EXPECT_EQ(inliers[1], 0);
    EXPECT_EQ(inliers[6], 0);
    EXPECT_EQ(std::count(inliers.begin(), inliers.end(), 1), 6);
    EXPECT_LT((report->point_in_world - point).norm(), 0.05);
    EXPECT_FALSE(Triangulate(views));
  }
}

INSTANTIATE_TEST_SUITE_P(Ports, TriangulationTest,
                         ::testing::Values(RigKind::kNone, RigKind::kFlat, RigKind::kDome,
                                           RigKind::kCentredDome));

// Views of different cameras in one problem.
TEST(Triangulation, MixesCameras) {
  Rng rng(4);
  const AnyCamera flat = RandomRig(RigKind::kFlat, &rng), dome = RandomRig(RigKind::kDome, &rng);
  const Vec3 point(0.2, 0.1, 3.0);
  auto views = MakeViews(flat, point, 3, 0.0, &rng);
  for (const TriangulationView& view : MakeViews(dome, point, 2, 0.0, &rng)) views.push_back(view);
  const auto report = Triangulate(views);
  ASSERT_TRUE(report);
  EXPECT_LT((report->point_in_world - point).norm(), 1e-9);
}

TEST(Triangulation, NamesWhatIsWrong) {
  Rng rng(5);
  const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
  const Vec3 point(0.0, 0.0, 3.0);
  const auto good = MakeViews(camera, point, 3, 0.2, &rng);
  ASSERT_TRUE(Triangulate(good));
  EXPECT_EQ(Triangulate({good.data(), 1}).error().code, Errc::kNotEnoughData);

  auto views = good;
  views[2].pixel.y() = kNan;
  EXPECT_EQ(Triangulate(views).error().code, Errc::kInvalidArgument);
  EXPECT_EQ(Triangulate(views).error().detail, 2);
  views = good;
  views[1].camera_from_world.translation.x() = kNan;
  EXPECT_EQ(Triangulate(views).error().code, Errc::kInvalidArgument);
  views = good;
  views[1].camera = nullptr;
  EXPECT_EQ(Triangulate(views).error().code, Errc::kInvalidArgument);

  // The same view twice: no parallax.
  views = {good[0], good[0]};
  EXPECT_EQ(Triangulate(views).error().code, Errc::kDegenerate);
  EXPECT_STREQ(Triangulate(views).error().where, "angle");
  TriangulationOptions any_angle;
  any_angle.min_angle_rad = 0.0;
  EXPECT_EQ(Triangulate(views, any_angle).error().code, Errc::kDegenerate);

  // Rays that diverge: they meet behind the cameras.
  views = {good[0], good[0]};
  views[0].camera_from_world = Rigid3(Quat::Identity(), Vec3(0.5, 0.0, 0.0));
  views[1].camera_from_world = Rigid3(Quat::Identity(), Vec3(-0.5, 0.0, 0.0));
  views[0].pixel = Vec2(600.0, 540.0);
  views[1].pixel = Vec2(1300.0, 540.0);
  EXPECT_FALSE(Triangulate(views));
  EXPECT_EQ(Triangulate(views).error().code, Errc::kDegenerate);

  views = good;
  views[0].pixel.x() += 50.0;
  EXPECT_EQ(Triangulate(views).error().code, Errc::kNotEnoughInliers);
  TriangulationOptions bad;
  bad.max_range_m = -1.0;
  EXPECT_STREQ(Triangulate(good, bad).error().where, "max_range_m");

  const std::vector<TriangulationView> many(kMaxTriangulationViews + 1, good[0]);
  EXPECT_EQ(Triangulate(many).error().code, Errc::kOutOfCapacity);
}

TEST(Triangulation, MidpointOfParallelRaysIsDegenerate) {
  const std::array<Ray3, 2> parallel = {Ray3{Vec3(0, 0, 0), Vec3::UnitZ()},
                                        Ray3{Vec3(1, 0, 0), Vec3::UnitZ()}};
  EXPECT_EQ(TriangulateMidpoint(parallel).error().code, Errc::kDegenerate);
  std::array<Ray3, 2> bad = parallel;
  bad[1].direction.x() = kNan;
  EXPECT_EQ(TriangulateMidpoint(bad).error().code, Errc::kInvalidArgument);
}

TEST(Triangulation, DoesNotTouchTheHeap) {
  Rng rng(6);
  const AnyCamera camera = RandomRig(RigKind::kDome, &rng);
  const auto views = MakeViews(camera, Vec3(0.0, 0.0, 3.0), 6, 0.3, &rng);
  std::vector<std::uint8_t> inliers(views.size());
  const MallocTrap trap;
  const bool plain = Triangulate(views).has_value();
  const bool robust = TriangulateRobust(views, TriangulationOptions{}, 3, inliers).has_value();
  EXPECT_EQ(trap.count(), 0u);
  EXPECT_TRUE(plain && robust);
}

}  // namespace
}  // namespace rsfm
