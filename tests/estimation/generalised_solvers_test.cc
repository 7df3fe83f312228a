// The solvers beside P3P, GP3P and five points: exact data, bad data, no heap.
#include <gtest/gtest.h>

#include <limits>

#include "rsfm/estimation/generalised_eight_point.h"
#include "rsfm/estimation/generalised_pnp.h"
#include "rsfm/estimation/seventeen_point.h"
#include "rsfm/estimation/upright_absolute_pose.h"
#include "rsfm/estimation/upright_relative_pose.h"
#include "tests/estimation/scenes.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

template <int kSize>
struct RayPairs {
  std::array<Ray3, kSize> a, b;
};

// Rays of the paper's two views, exact.
template <int kSize>
RayPairs<kSize> MakeRayPairs(const AnyCamera& camera, const Rigid3& b_from_a, Rng* rng) {
  const RelativeScene scene = MakeRelativeScene(
      camera, b_from_a, [](Rng* r, const Ray3&) { return r->Uniform(6.0, 8.0); }, 0.0, 0.0, kSize,
      rng);
  RayPairs<kSize> rays;
  for (int i = 0; i < kSize; ++i) {
    EXPECT_EQ(camera.Backproject(scene.pixels_a[i], &rays.a[i]), Projection::kOk);
    EXPECT_EQ(camera.Backproject(scene.pixels_b[i], &rays.b[i]), Projection::kOk);
  }
  return rays;
}

// A rig of cameras: rays that meet nowhere, offsets of a third of the baseline.
template <int kSize>
RayPairs<kSize> MakeWideRayPairs(const Rigid3& b_from_a, Rng* rng) {
  const auto random = [rng](double size) {
    const double x = rng->Uniform(-size, size), y = rng->Uniform(-size, size);
    return Vec3(x, y, rng->Uniform(-size, size));
  };
  RayPairs<kSize> rays;
  for (int i = 0; i < kSize; ++i) {
    const Vec3 point = random(2.0) + Vec3(0.0, 0.0, 6.0);
    rays.a[i].origin = random(0.5);
    rays.b[i].origin = random(0.5);
    rays.a[i].direction = (point - rays.a[i].origin).normalized();
    rays.b[i].direction = (b_from_a * point - rays.b[i].origin).normalized();
  }
  return rays;
}

class AxialSolverTest : public ::testing::TestWithParam<RigKind> {};

TEST_P(AxialSolverTest, SeventeenPointsFindPoseAndLengthWithoutNoise) {
  Rng rng(1);
  int found = 0;
  constexpr int kCases = 50;
  for (int k = 0; k < kCases; ++k) {
    const Rigid3 b_from_a = PaperSecondCamera(&rng);
    const auto rays = MakeRayPairs<17>(RandomRig(GetParam(), &rng), b_from_a, &rng);
    found += Nearest(SolveSeventeenPoint(rays.a, rays.b), b_from_a) < 1e-2;
  }
  EXPECT_GE(found, kCases * 9 / 10);
}

TEST_P(AxialSolverTest, EightPointsFindPoseWithoutNoiseFromANearStart) {
  Rng rng(2);
  int found = 0;
  constexpr int kCases = 50;
  for (int k = 0; k < kCases; ++k) {
    const Rigid3 b_from_a = PaperSecondCamera(&rng);
    const auto rays = MakeRayPairs<8>(RandomRig(GetParam(), &rng), b_from_a, &rng);
    const Mat3 start = ExpSo3(Vec3(0.002, -0.002, 0.001)).toRotationMatrix() *
                       b_from_a.rotation.toRotationMatrix();
    Rigid3 pose;
    found += SolveGeneralisedEightPoint(rays.a, rays.b, start, &pose) &&
             AngleBetween(pose.rotation, b_from_a.rotation) < 1e-3 &&
             DirectionError(pose, b_from_a) < 1e-2;
  }
  EXPECT_GE(found, kCases / 2);
}

INSTANTIATE_TEST_SUITE_P(Ports, AxialSolverTest, ::testing::Values(RigKind::kFlat, RigKind::kDome));

TEST(GeneralisedRelativeSolvers, AreExactForARigOfCameras) {
  Rng rng(3);
  int seventeen = 0, eight = 0;
  constexpr int kCases = 100;
  for (int k = 0; k < kCases; ++k) {
    const Rigid3 b_from_a(ExpSo3(Vec3(0.1, -0.2, 0.15)), Vec3(1.0, 0.3, -0.4));
    const auto many = MakeWideRayPairs<17>(b_from_a, &rng);
    seventeen += Nearest(SolveSeventeenPoint(many.a, many.b), b_from_a) < 1e-6;
    const auto few = MakeWideRayPairs<8>(b_from_a, &rng);
    const Mat3 start =
        ExpSo3(Vec3(0.01, 0.01, -0.01)).toRotationMatrix() * b_from_a.rotation.toRotationMatrix();
    Rigid3 pose;
    eight +=
        SolveGeneralisedEightPoint(few.a, few.b, start, &pose) && Difference(pose, b_from_a) < 1e-6;
  }
  EXPECT_GE(seventeen, kCases * 95 / 100);
  EXPECT_GE(eight, kCases * 80 / 100);  // the rest are other minima close by
}

TEST(GeneralisedRelativeSolvers, GiveNothingForACentralCameraOrBadInput) {
  Rng rng(4);
  const Rigid3 b_from_a = PaperSecondCamera(&rng);
  for (const RigKind kind : {RigKind::kNone, RigKind::kCentredDome}) {
    const auto many = MakeRayPairs<17>(RandomRig(kind, &rng), b_from_a, &rng);
    EXPECT_TRUE(SolveSeventeenPoint(many.a, many.b).empty());
    const auto few = MakeRayPairs<8>(RandomRig(kind, &rng), b_from_a, &rng);
    Rigid3 pose(Quat::Identity(), Vec3(7.0, 7.0, 7.0));
    EXPECT_FALSE(SolveGeneralisedEightPoint(few.a, few.b, Mat3::Identity(), &pose));
    EXPECT_EQ(pose.translation, Vec3(7.0, 7.0, 7.0));
  }
  auto many = MakeWideRayPairs<17>(b_from_a, &rng);
  auto few = MakeWideRayPairs<8>(b_from_a, &rng);
  Rigid3 pose;
  many.a[3].direction.y() = kNan;
  few.b[5].origin.z() = kNan;
  EXPECT_TRUE(SolveSeventeenPoint(many.a, many.b).empty());
  EXPECT_FALSE(SolveGeneralisedEightPoint(few.a, few.b, Mat3::Identity(), &pose));
  // One correspondence many times over.
  many = MakeWideRayPairs<17>(b_from_a, &rng);
  few = MakeWideRayPairs<8>(b_from_a, &rng);
  many.a.fill(many.a[0]);
  many.b.fill(many.b[0]);
  EXPECT_TRUE(SolveSeventeenPoint(many.a, many.b).empty());
}

TEST(UprightRelative, FindsThePose) {
  Rng rng(5);
  int found = 0;
  constexpr int kCases = 1000;
  for (int k = 0; k < kCases; ++k) {
    const AnyCamera camera = RandomRig(RigKind::kNone, &rng);
    const Rigid3 b_from_a = PaperSecondCamera(&rng);
    const auto rays = MakeRayPairs<3>(camera, b_from_a, &rng);
    const Vec3 down_in_a = Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian()).normalized();
    std::array<Vec3, 3> a, b;
    for (int i = 0; i < 3; ++i) {
      a[i] = 3.0 * rays.a[i].direction;
      b[i] = rays.b[i].direction;
    }
    const Vec3 down_in_b = b_from_a.rotation * down_in_a;
    const auto solutions = SolveUprightRelativePose(a, b, down_in_a, down_in_b);
    const Rigid3 unit(b_from_a.rotation, b_from_a.translation.normalized());
    found += Nearest(solutions, unit) < 1e-6;
    for (const Rigid3& pose : solutions)
      EXPECT_LT((pose.rotation * down_in_a - down_in_b).norm(), 1e-9);
  }
  EXPECT_GE(found, kCases * 99 / 100) << found;
}

TEST(UprightRelative, GivesNothingForBadInput) {
  const std::array<Vec3, 3> same = {Vec3::UnitZ(), Vec3::UnitZ(), Vec3::UnitZ()};
  EXPECT_TRUE(SolveUprightRelativePose(same, same, Vec3::UnitY(), Vec3::UnitY()).empty());
  std::array<Vec3, 3> a = {Vec3(0.1, 0.2, 1.0), Vec3(-0.3, 0.1, 1.0), Vec3(0.2, -0.2, 1.0)};
  // Pure rotation: no direction of the baseline is better than another.
  for (const Rigid3& pose : SolveUprightRelativePose(a, a, Vec3::UnitY(), Vec3::UnitY()))
    EXPECT_TRUE(pose.translation.allFinite());
  a[1].x() = kNan;
  EXPECT_TRUE(SolveUprightRelativePose(a, a, Vec3::UnitY(), Vec3::UnitY()).empty());
}

class PoseOfPointsTest : public ::testing::TestWithParam<RigKind> {};

TEST_P(PoseOfPointsTest, TwoUprightPointsGiveThePose) {
  Rng rng(6);
  int found = 0;
  constexpr int kCases = 1000;
  for (int k = 0; k < kCases; ++k) {
    const AnyCamera camera = RandomRig(GetParam(), &rng);
    const AbsoluteScene scene = MakeAbsoluteScene(camera, 0.0, 0.0, 2, &rng);
    std::array<Ray3, 2> rays;
    for (int i = 0; i < 2; ++i)
      ASSERT_EQ(camera.Backproject(scene.pixels[i], &rays[i]), Projection::kOk);
    const Vec3 down = Vec3(0.1, -0.2, 1.0).normalized();
    const Vec3 down_in_camera = scene.camera_from_world.rotation * down;
    const auto solutions = SolveUprightAbsolutePose(
        rays, std::array<Vec3, 2>{scene.points_in_world[0], scene.points_in_world[1]},
        down_in_camera, down);
    found += Nearest(solutions, scene.camera_from_world) < 1e-6;
    for (const Rigid3& pose : solutions) {
      EXPECT_LT((pose.rotation * down - down_in_camera).norm(), 1e-9);
      for (int i = 0; i < 2; ++i) {
        const Vec3 point = pose * scene.points_in_world[i];
        EXPECT_LT(rays[i].Distance(point), 1e-6 * (1.0 + point.norm()));
      }
    }
  }
  EXPECT_GE(found, kCases * 99 / 100) << found;
}

TEST_P(PoseOfPointsTest, AllPointsAtOnceGiveThePose) {
  Rng rng(7);
  for (const int count : {5, 8, 20, 100}) {
    int found = 0;
    constexpr int kCases = 50;
    for (int k = 0; k < kCases; ++k) {
      const AnyCamera camera = RandomRig(GetParam(), &rng);
      const AbsoluteScene scene = MakeAbsoluteScene(camera, 0.0, 0.0, count, &rng);
      std::vector<Ray3> rays(scene.pixels.size());
      for (std::size_t i = 0; i < rays.size(); ++i)
        ASSERT_EQ(camera.Backproject(scene.pixels[i], &rays[i]), Projection::kOk);
      const auto report = SolveGeneralisedPnp(rays, scene.points_in_world);
      found += report && Difference(report->camera_from_world, scene.camera_from_world) < 1e-4;
    }
    EXPECT_GE(found, kCases * 9 / 10) << count;
  }
}

TEST_P(PoseOfPointsTest, AllPointsAtOnceSurviveNoiseAndPlanes) {
  Rng rng(8);
  int found = 0;
  constexpr int kCases = 40;
  for (int k = 0; k < kCases; ++k) {
    const AnyCamera camera = RandomRig(GetParam(), &rng);
    AbsoluteScene scene = MakeAbsoluteScene(camera, 1.0, 0.0, 50, &rng);
    std::vector<Ray3> rays(scene.pixels.size());
    for (std::size_t i = 0; i < rays.size(); ++i) {
      Ray3 exact;
      ASSERT_EQ(camera.Backproject(scene.pixels[i], &rays[i]), Projection::kOk);
      if (k % 2 == 0) continue;
      // Onto a tilted plane 4 m ahead; the pixel's ray stays, so that the noise is gone here.
      const Vec3 normal = Vec3(0.3, -0.2, 1.0).normalized();
      const double range = (4.0 - normal.dot(rays[i].origin)) / normal.dot(rays[i].direction);
      scene.points_in_world[i] = scene.camera_from_world.Inverse() * rays[i].At(range);
    }
    const auto report = SolveGeneralisedPnp(rays, scene.points_in_world);
    found += report && Difference(report->camera_from_world, scene.camera_from_world) < 0.05;
  }
  EXPECT_GE(found, kCases * 95 / 100) << found;
}

INSTANTIATE_TEST_SUITE_P(Ports, PoseOfPointsTest,
                         ::testing::Values(RigKind::kNone, RigKind::kFlat, RigKind::kDome,
                                           RigKind::kCentredDome));

TEST(UprightAbsolute, GivesNothingForBadInput) {
  std::array<Ray3, 2> rays;
  rays[1].direction = Vec3(0.1, 0.2, 1.0).normalized();
  std::array<Vec3, 2> points = {Vec3(0.0, 0.0, 4.0), Vec3(1.0, 0.0, 5.0)};
  const Vec3 down = Vec3::UnitY();
  const auto solve = [&] { return SolveUprightAbsolutePose(rays, points, down, down); };
  points[1] = points[0];
  EXPECT_TRUE(solve().empty());  // coincident
  points[1] = points[0] + 2.0 * down;
  EXPECT_TRUE(solve().empty());  // one above the other: any heading
  points[1] = Vec3(kNan, 0.0, 0.0);
  EXPECT_TRUE(solve().empty());
  points[1] = Vec3(1.0, 0.0, 5.0);
  rays[0].origin.x() = kNan;
  EXPECT_TRUE(solve().empty());
}

TEST(GeneralisedPnp, NamesWhatIsWrong) {
  Rng rng(9);
  const AnyCamera camera = RandomRig(RigKind::kFlat, &rng);
  const AbsoluteScene scene = MakeAbsoluteScene(camera, 0.0, 0.0, 10, &rng);
  std::vector<Ray3> rays(10);
  for (int i = 0; i < 10; ++i) (void)camera.Backproject(scene.pixels[i], &rays[i]);
  const std::span<const Ray3> all(rays);
  std::vector<Vec3> points = scene.points_in_world;
  EXPECT_EQ(SolveGeneralisedPnp(all.first(3), std::span(points).first(3)).error().code,
            Errc::kNotEnoughData);
  EXPECT_EQ(SolveGeneralisedPnp(all, std::span(points).first(3)).error().code,
            Errc::kInvalidArgument);
  std::vector<Vec3> line(10);
  for (int i = 0; i < 10; ++i) line[i] = Vec3(0.0, 0.0, 3.0) + 0.1 * i * Vec3(1.0, 0.3, 0.2);
  EXPECT_EQ(SolveGeneralisedPnp(all, line).error().code, Errc::kDegenerate);
  const std::vector<Vec3> same(10, Vec3(0.0, 0.0, 3.0));
  EXPECT_EQ(SolveGeneralisedPnp(all, same).error().code, Errc::kDegenerate);
  points[4].z() = kNan;
  const auto error = SolveGeneralisedPnp(all, points).error();
  EXPECT_EQ(error.code, Errc::kInvalidArgument);
  EXPECT_EQ(error.detail, 4);
}

TEST(GeneralisedSolvers, DoNotTouchTheHeap) {
  Rng rng(10);
  const Rigid3 b_from_a = PaperSecondCamera(&rng);
  const AnyCamera camera = RandomRig(RigKind::kDome, &rng);
  const auto many = MakeRayPairs<17>(camera, b_from_a, &rng);
  const auto few = MakeRayPairs<8>(camera, b_from_a, &rng);
  const auto three = MakeRayPairs<3>(camera, b_from_a, &rng);
  const AbsoluteScene scene = MakeAbsoluteScene(camera, 0.0, 0.0, 20, &rng);
  std::vector<Ray3> rays(20);
  for (int i = 0; i < 20; ++i) (void)camera.Backproject(scene.pixels[i], &rays[i]);
  const Vec3 down = Vec3::UnitY(), down_in_b = b_from_a.rotation * down;
  const Vec3 down_in_camera = scene.camera_from_world.rotation * down;
  Rigid3 pose;
  std::size_t solutions = 0;
  const MallocTrap trap;
  solutions += SolveSeventeenPoint(many.a, many.b).size();
  solutions += SolveGeneralisedEightPoint(few.a, few.b, Mat3::Identity(), &pose);
  solutions +=
      SolveUprightRelativePose(
          std::array<Vec3, 3>{three.a[0].direction, three.a[1].direction, three.a[2].direction},
          std::array<Vec3, 3>{three.b[0].direction, three.b[1].direction, three.b[2].direction},
          down, down_in_b)
          .size();
  solutions += SolveUprightAbsolutePose(
                   std::array<Ray3, 2>{rays[0], rays[1]},
                   std::array<Vec3, 2>{scene.points_in_world[0], scene.points_in_world[1]},
                   down_in_camera, down)
                   .size();
  solutions += SolveGeneralisedPnp(rays, scene.points_in_world).has_value();
  EXPECT_EQ(trap.count(), 0u);
  EXPECT_GT(solutions, 3u);
}

}  // namespace
}  // namespace rsfm
