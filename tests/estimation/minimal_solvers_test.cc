// P3P, generalised P3P and the five-point solver: the true pose is among the solutions, and every
// solution satisfies the equations.
#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <numbers>
#include <vector>

#include "rsfm/base/rng.h"
#include "rsfm/estimation/five_point.h"
#include "rsfm/estimation/gp3p.h"
#include "rsfm/estimation/p3p.h"
#include "rsfm/estimation/polynomial.h"
#include "tests/estimation/scenes.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Vec3 RandomVector(Rng* rng, double size) {
  return {rng->Uniform(-size, size), rng->Uniform(-size, size), rng->Uniform(-size, size)};
}

Rigid3 RandomPose(Rng* rng) { return {ExpSo3(RandomVector(rng, 1.5)), RandomVector(rng, 2.0)}; }

struct Problem {
  std::array<Ray3, 3> rays;
  std::array<Vec3, 3> points;
  Rigid3 camera_from_world;
};

// Pixels anywhere in the image, ranges as in the paper's evaluation.
Problem RandomProblem(const AnyCamera& camera, Rng* rng) {
  Problem problem;
  problem.camera_from_world = RandomPose(rng);
  for (int i = 0; i < 3; ++i) {
    while (camera.Backproject({rng->Uniform(0, camera.width()), rng->Uniform(0, camera.height())},
                              &problem.rays[i]) != Projection::kOk) {
    }
    problem.points[i] =
        problem.camera_from_world.Inverse() * problem.rays[i].At(rng->Uniform(0.5, 10.0));
  }
  return problem;
}

class Gp3pTest : public ::testing::TestWithParam<RigKind> {};

TEST_P(Gp3pTest, FindsThePoseBehindEveryPort) {
  Rng rng(1);
  int found = 0;
  constexpr int kCases = 3000;
  for (int k = 0; k < kCases; ++k) {
    const Problem problem = RandomProblem(RandomRig(GetParam(), &rng), &rng);
    const Gp3pSolutions solutions = SolveGp3p(problem.rays, problem.points);
    found += Nearest(solutions, problem.camera_from_world) < 1e-5;
    for (const Rigid3& pose : solutions) {
      for (int i = 0; i < 3; ++i) {
        const Vec3 point = pose * problem.points[i];
        EXPECT_LT(problem.rays[i].Distance(point), 1e-9 * (1.0 + point.norm()));
        EXPECT_GT(problem.rays[i].RangeTo(point), 0.0);
      }
    }
  }
  // Where two solutions coincide to working precision the start may be lost; a sample in 200 at
  // most.
  EXPECT_GE(found, kCases * 199 / 200) << found;
}

INSTANTIATE_TEST_SUITE_P(Ports, Gp3pTest,
                         ::testing::Values(RigKind::kNone, RigKind::kFlat, RigKind::kDome,
                                           RigKind::kCentredDome));

// From a central camera to a rig of cameras metres apart.
TEST(Gp3p, FindsThePoseAtEveryDegreeOfNonCentrality) {
  for (const double offset : {0.0, 1e-13, 1e-9, 1e-5, 1e-3, 0.03, 0.3, 3.0}) {
    Rng rng(2);
    int found = 0;
    constexpr int kCases = 2000;
    for (int k = 0; k < kCases; ++k) {
      Problem problem;
      problem.camera_from_world = RandomPose(&rng);
      for (int i = 0; i < 3; ++i) {
        const Vec3 direction(rng.Uniform(-0.7, 0.7), rng.Uniform(-0.4, 0.4), 1.0);
        problem.rays[i] = {offset * RandomVector(&rng, 1.0), direction.normalized()};
        problem.points[i] =
            problem.camera_from_world.Inverse() * problem.rays[i].At(rng.Uniform(1.0, 10.0));
      }
      found += Nearest(SolveGp3p(problem.rays, problem.points), problem.camera_from_world) < 1e-4;
    }
    EXPECT_GE(found, kCases * 99 / 100) << "offset " << offset;
  }
}

TEST(Gp3p, AgreesWithP3pForACentralCamera) {
  Rng rng(3);
  for (int k = 0; k < 500; ++k) {
    const Problem problem = RandomProblem(RandomRig(RigKind::kNone, &rng), &rng);
    const std::array<Vec3, 3> bearings = {problem.rays[0].direction, problem.rays[1].direction,
                                          problem.rays[2].direction};
    const P3pSolutions central = SolveP3p(bearings, problem.points);
    const Gp3pSolutions general = SolveGp3p(problem.rays, problem.points);
    ASSERT_EQ(central.size(), general.size()) << k;
    for (const Rigid3& pose : central) EXPECT_LT(Nearest(general, pose), 1e-6) << k;
  }
}

TEST(P3p, FindsThePoseAndOnlyPosesThatFit) {
  Rng rng(4);
  int found = 0;
  constexpr int kCases = 5000;
  for (int k = 0; k < kCases; ++k) {
    const Problem problem = RandomProblem(RandomRig(RigKind::kNone, &rng), &rng);
    const std::array<Vec3, 3> bearings = {problem.rays[0].direction, problem.rays[1].direction,
                                          problem.rays[2].direction};
    const P3pSolutions solutions = SolveP3p(bearings, problem.points);
    found += Nearest(solutions, problem.camera_from_world) < 1e-5;
    for (const Rigid3& pose : solutions) {
      EXPECT_NEAR(pose.rotation.norm(), 1.0, 1e-12);
      for (int i = 0; i < 3; ++i) {
        EXPECT_LT((pose * problem.points[i]).normalized().cross(bearings[i]).norm(), 1e-9);
      }
    }
  }
  EXPECT_GE(found, kCases - 2) << found;
}

// A symmetric set-up: an equilateral triangle seen from above its centre, where coefficients
// vanish.
TEST(P3p, SolvesTheSymmetricPyramid) {
  std::array<Vec3, 3> points, bearings;
  const Rigid3 truth(Quat::Identity(), Vec3(0.0, 0.0, 2.0));
  for (int i = 0; i < 3; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / 3.0;
    points[i] = {std::cos(angle), std::sin(angle), 0.0};
    bearings[i] = (truth * points[i]).normalized();
  }
  EXPECT_LT(Nearest(SolveP3p(bearings, points), truth), 1e-6);
}

TEST(AbsoluteSolvers, GiveNothingForBadInput) {
  Rng rng(5);
  const Problem good = RandomProblem(RandomRig(RigKind::kFlat, &rng), &rng);
  Problem collinear = good;
  collinear.points[2] = 2.0 * collinear.points[1] - collinear.points[0];
  EXPECT_TRUE(SolveGp3p(collinear.rays, collinear.points).empty());
  Problem coincident = good;
  coincident.points[1] = coincident.points[0];
  EXPECT_TRUE(SolveGp3p(coincident.rays, coincident.points).empty());
  Problem same = good;
  same.points[1] = same.points[2] = same.points[0];
  EXPECT_TRUE(SolveGp3p(same.rays, same.points).empty());
  for (int i = 0; i < 3; ++i) {
    Problem bad = good;
    bad.points[i].y() = kNan;
    EXPECT_TRUE(SolveGp3p(bad.rays, bad.points).empty());
    bad = good;
    bad.rays[i].origin.x() = kNan;
    EXPECT_TRUE(SolveGp3p(bad.rays, bad.points).empty());
    bad = good;
    bad.rays[i].direction.z() = std::numeric_limits<double>::infinity();
    EXPECT_TRUE(SolveGp3p(bad.rays, bad.points).empty());
    std::array<Vec3, 3> bearings = {good.rays[0].direction, good.rays[1].direction,
                                    good.rays[2].direction};
    bearings[i].x() = kNan;
    EXPECT_TRUE(SolveP3p(bearings, good.points).empty());
  }
}

struct FivePoints {
  std::array<Vec3, 5> a, b;
  Rigid3 b_from_a;
};

FivePoints RandomFive(Rng* rng) {
  FivePoints five;
  five.b_from_a = Rigid3(ExpSo3(RandomVector(rng, 0.5)), RandomVector(rng, 1.0).normalized());
  for (int i = 0; i < 5; ++i) {
    const Vec3 point(rng->Uniform(-3, 3), rng->Uniform(-2, 2), rng->Uniform(4, 8));
    five.a[i] = point.normalized();
    five.b[i] = (five.b_from_a * point).normalized();
  }
  return five;
}

TEST(FivePoint, FindsThePoseInFrontOfBothCameras) {
  Rng rng(6);
  int found = 0, inexact = 0;
  constexpr int kCases = 1000;
  for (int k = 0; k < kCases; ++k) {
    const FivePoints five = RandomFive(&rng);
    double nearest = std::numeric_limits<double>::infinity();
    for (const Mat3& essential : SolveFivePoint(five.a, five.b)) {
      EXPECT_NEAR(essential.norm(), 1.0, 1e-9);
      for (int i = 0; i < 5; ++i) EXPECT_NEAR(five.b[i].dot(essential * five.a[i]), 0.0, 1e-9);
      for (const Rigid3& pose : DecomposeEssential(essential)) {
        const Mat3 rebuilt =
            Hat(pose.translation) * pose.rotation.toRotationMatrix() / std::sqrt(2.0);
        inexact += std::min((rebuilt - essential).norm(), (rebuilt + essential).norm()) > 1e-5;
        bool is_in_front = true;
        for (int i = 0; i < 5; ++i) is_in_front &= IsInFront(pose, five.a[i], five.b[i]);
        if (is_in_front) nearest = std::min(nearest, Difference(pose, five.b_from_a));
      }
    }
    found += nearest < 1e-4;
  }
  EXPECT_GE(found, kCases * 99 / 100);
  EXPECT_LE(inexact, 4 * kCases / 100);  // near double roots
}

TEST(FivePoint, GivesNothingForNan) {
  Rng rng(7);
  FivePoints five = RandomFive(&rng);
  five.b[3].x() = kNan;
  EXPECT_TRUE(SolveFivePoint(five.a, five.b).empty());
}

TEST(MinimalSolvers, DoNotTouchTheHeap) {
  Rng rng(8);
  const Problem near = RandomProblem(RandomRig(RigKind::kFlat, &rng), &rng);
  Problem wide = near;
  wide.rays[0].origin.x() += 3.0;
  const FivePoints five = RandomFive(&rng);
  const std::array<Vec3, 3> bearings = {near.rays[0].direction, near.rays[1].direction,
                                        near.rays[2].direction};
  const MallocTrap trap;
  (void)SolveGp3p(near.rays, near.points);
  (void)SolveGp3p(wide.rays, wide.points);
  (void)SolveP3p(bearings, near.points);
  for (const Mat3& essential : SolveFivePoint(five.a, five.b)) (void)DecomposeEssential(essential);
  EXPECT_EQ(trap.count(), 0u);
}

TEST(Polynomial, FindsAllRealRoots) {
  Rng rng(9);
  for (int k = 0; k < 200; ++k) {
    // (x - r_1) ... (x - r_4) (x^2 + 1)^2, roots over six decades.
    std::array<double, 4> roots;
    std::array<double, 9> coefficients{1.0};
    const auto multiply = [&coefficients](std::array<double, 3> factor) {
      std::array<double, 9> product{};
      for (int i = 0; i < 9; ++i) {
        for (int j = 0; j < 3 && i + j < 9; ++j) product[i + j] += coefficients[i] * factor[j];
      }
      coefficients = product;
    };
    for (int i = 0; i < 4; ++i) {
      roots[i] = (rng.Uniform() < 0.5 ? -1.0 : 1.0) * std::pow(10.0, 1.5 * i - 3.0 + rng.Uniform());
      multiply({-roots[i], 1.0, 0.0});
    }
    multiply({1.0, 0.0, 1.0});
    multiply({1.0, 0.0, 1.0});
    const auto found = RealRoots<8>(coefficients);
    ASSERT_EQ(found.size(), 4u);
    for (const double root : roots) {
      double nearest = std::numeric_limits<double>::infinity();
      for (const double x : found) nearest = std::min(nearest, std::abs(x - root) / std::abs(root));
      EXPECT_LT(nearest, 1e-9);
    }
  }
}

TEST(Polynomial, GivesNoRootForBadCoefficients) {
  EXPECT_TRUE(RealRoots<3>({0.0, 0.0, 0.0, 0.0}).empty());
  EXPECT_TRUE(RealRoots<3>({1.0, kNan, 0.0, 1.0}).empty());
  EXPECT_TRUE(RealRoots<2>({1.0, 0.0, 1.0}).empty());
}

}  // namespace
}  // namespace rsfm
