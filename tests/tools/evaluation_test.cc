// Alignment and mesh distance against what they must give.
#include <gtest/gtest.h>

#include "rsfm/base/rng.h"
#include "rsfm/base/so3.h"
#include "rsfm/io/atomic_output.h"
#include "tests/support/temporary_folder.h"
#include "tools/evaluation/alignment.h"
#include "tools/evaluation/mesh.h"
#include "tools/offline/bend.h"

namespace rsfm {
namespace {

Vec3 RandomVector(Rng* rng) { return {rng->Gaussian(), rng->Gaussian(), rng->Gaussian()}; }

TEST(AlignmentTest, RecoversASimilarity) {
  Rng rng(1);
  const Similarity truth{2.5, Rigid3(ExpSo3(Vec3(0.3, -2.0, 1.0)), Vec3(10, -20, 30))};
  std::vector<Vec3> from, to;
  for (int i = 0; i < 10; ++i) {
    from.push_back(RandomVector(&rng));
    to.push_back(truth * from.back());
  }
  const auto found = AlignPoints(from, to, Alignment::kSim3);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->scale, 2.5, 1e-12);
  EXPECT_LT(AngleBetween(found->transform.rotation, truth.transform.rotation), 1e-7);
  EXPECT_LT((found->transform.translation - truth.transform.translation).norm(), 1e-11);
  EXPECT_EQ(AlignPoints(from, to, Alignment::kSe3)->scale, 1.0);
  EXPECT_EQ(AlignPoints(from, to, Alignment::kNone)->transform.translation, Vec3::Zero());
}

// Planar positions have a mirror image: the result must be a rotation all the same.
TEST(AlignmentTest, PlanarPositionsGiveARotation) {
  Rng rng(2);
  const Quat rotation = ExpSo3(Vec3(1.0, 0.2, 0.1));
  std::vector<Vec3> from, to;
  for (int i = 0; i < 6; ++i) {
    from.emplace_back(rng.Gaussian(), rng.Gaussian(), 0.0);
    to.push_back(rotation * from.back());
  }
  const auto found = AlignPoints(from, to, Alignment::kSe3);
  ASSERT_TRUE(found);
  EXPECT_LT(AngleBetween(found->transform.rotation, rotation), 1e-7);
}

TEST(AlignmentTest, TheOptimumIsAMinimum) {
  Rng rng(3);
  std::vector<Vec3> from, to;
  for (int i = 0; i < 20; ++i) {
    from.push_back(RandomVector(&rng));
    to.push_back(2.0 * from.back() + 0.1 * RandomVector(&rng));
  }
  const auto cost = [&](const Similarity& s) {
    double sum = 0.0;
    for (std::size_t i = 0; i < from.size(); ++i) sum += (s * from[i] - to[i]).squaredNorm();
    return sum;
  };
  const Similarity best = *AlignPoints(from, to, Alignment::kSim3);
  for (int trial = 0; trial < 100; ++trial) {
    Similarity other = best;
    Vec6 delta;
    delta << 1e-3 * RandomVector(&rng), 1e-3 * RandomVector(&rng);
    other.transform = Perturb(other.transform, delta);
    other.scale *= 1.0 + 1e-3 * rng.Gaussian();
    EXPECT_GT(cost(other), cost(best));
  }
}

TEST(AlignmentTest, WhatIsNotDeterminedIsRefused) {
  const std::vector<Vec3> line = {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(2, 0, 0)};
  const std::vector<Vec3> two = {Vec3(0, 0, 0), Vec3(1, 0, 0)};
  EXPECT_EQ(AlignPoints(line, line, Alignment::kSim3).error().code, Errc::kDegenerate);
  EXPECT_EQ(AlignPoints(two, two, Alignment::kSe3).error().code, Errc::kNotEnoughData);
}

TEST(AlignmentTest, AStraightTrackIsAlignedByItsAttitudes) {
  const Similarity truth{0.5, Rigid3(ExpSo3(Vec3(0.3, -1.0, 2.0)), Vec3(1, 2, 3))};
  std::vector<Rigid3> from, to;
  for (int i = 0; i < 5; ++i) {
    from.emplace_back(ExpSo3(Vec3(0.1 * i, 0, 0.2)), Vec3(i, 0, 0));
    to.emplace_back(truth.transform.rotation * from.back().rotation,
                    truth * from.back().translation);
  }
  const auto found = AlignPoses(from, to, Alignment::kSim3);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->scale, 0.5, 1e-9);
  EXPECT_LT(AngleBetween(found->transform.rotation, truth.transform.rotation), 1e-7);
}

// Attitude and depth are sensed: only heading and place may be aligned, and a tilt remains.
TEST(AlignmentTest, YawTurnsAboutTheVerticalAlone) {
  Rng rng(6);
  const Rigid3 truth(ExpSo3(Vec3(0, 0, 2.5)), Vec3(10, -20, 3));
  std::vector<Vec3> from, to, tilted;
  for (int i = 0; i < 10; ++i) {
    from.push_back(RandomVector(&rng));
    to.push_back(truth * from.back());
    tilted.push_back(ExpSo3(Vec3(0.1, 0, 0)) * from.back());
  }
  const auto found = AlignPoints(from, to, Alignment::kYaw);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->scale, 1.0);
  EXPECT_LT(AngleBetween(found->transform.rotation, truth.rotation), 1e-7);
  EXPECT_LT((found->transform.translation - truth.translation).norm(), 1e-11);
  const auto left = AlignPoints(from, tilted, Alignment::kYaw);
  ASSERT_TRUE(left);
  EXPECT_EQ(left->transform.rotation.vec().head<2>(), Vec2::Zero());
  const std::vector<Vec3> upright = {Vec3(1, 1, 0), Vec3(1, 1, 1), Vec3(1, 1, 2)};
  EXPECT_EQ(AlignPoints(upright, upright, Alignment::kYaw).error().code, Errc::kDegenerate);
}

TEST(AlignmentTest, IsNamed) {
  EXPECT_EQ(AlignmentNamed("yaw"), Alignment::kYaw);
  EXPECT_EQ(AlignmentNamed("sim3"), Alignment::kSim3);
  EXPECT_EQ(AlignmentNamed("Sim3"), std::nullopt);
}

// A bowl of 2 cm over 3 m, turned, with a tilt and a height: all of it found, none on the flat.
TEST(BendTest, FindsTheParaboloid) {
  Rng rng(7);
  const Rigid3 turned(ExpSo3(Vec3(0.4, -0.3, 1.0)), Vec3(5, 6, 7));
  const Vec3 up = turned.rotation * Vec3::UnitZ();
  std::vector<Vec3> bowl, flat;
  for (int i = 0; i < 4000; ++i) {
    const Vec2 p(rng.Uniform(-3, 3), rng.Uniform(-3, 3));
    const double tilt = 0.2 * p.x() - 0.1 * p.y() + 4.0;
    bowl.push_back(turned * Vec3(p.x(), p.y(), tilt - 0.02 * p.squaredNorm() / 9.0));
    flat.push_back(turned * Vec3(p.x(), p.y(), tilt));
  }
  const auto found = FitBend(bowl, up);
  ASSERT_TRUE(found);
  EXPECT_FALSE(found->along_line);
  EXPECT_NEAR(found->sagitta_m, 0.02 * std::pow(found->radius_m / 3.0, 2), 1e-5);
  EXPECT_NEAR(FitBend(bowl, -up)->sagitta_m, -found->sagitta_m, 1e-12);
  EXPECT_NEAR(FitBend(flat, up)->sagitta_m, 0.0, 1e-9);
  // The weights are the sagitta's derivative.
  double sum = 0.0;
  for (std::size_t i = 0; i < bowl.size(); ++i) sum += found->weights[i].dot(bowl[i]);
  EXPECT_NEAR(sum, found->sagitta_m, 1e-9);
}

TEST(BendTest, OfALineIsAlongIt) {
  std::vector<Vec3> line;
  for (int i = 0; i <= 20; ++i)
    line.emplace_back(i - 10, 0.01 * (i % 3), -1e-3 * (i - 10) * (i - 10));
  const auto found = FitBend(line, Vec3::UnitZ());
  ASSERT_TRUE(found);
  EXPECT_TRUE(found->along_line);
  EXPECT_NEAR(found->sagitta_m, 1e-3 * found->radius_m * found->radius_m, 1e-5);
  EXPECT_EQ(FitBend(line, Vec3::Zero()).error().code, Errc::kDegenerate);
  EXPECT_EQ(FitBend(std::vector<Vec3>(5, Vec3::Zero()), Vec3::UnitZ()).error().code,
            Errc::kNotEnoughData);
  EXPECT_EQ(FitBend(std::vector<Vec3>(9, Vec3::Zero()), Vec3::UnitZ()).error().code,
            Errc::kDegenerate);
}

TEST(MeshTest, DistanceAgreesWithBruteForce) {
  Rng rng(4);
  std::vector<Vec3> vertices;
  std::vector<std::array<std::int32_t, 3>> triangles;
  for (std::int32_t i = 0; i < 300; ++i) {
    const Vec3 corner = 5.0 * RandomVector(&rng);
    for (int k = 0; k < 3; ++k) vertices.push_back(corner + RandomVector(&rng));
    triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  const TriangleMesh mesh(vertices, triangles);
  for (int trial = 0; trial < 200; ++trial) {
    const Vec3 point = 6.0 * RandomVector(&rng);
    double best = 1e9;
    for (const auto& t : triangles) {
      // A dense sampling bounds the distance from above, the closest point must not exceed it.
      best = std::min(
          best,
          (ClosestPointOnTriangle(point, vertices[t[0]], vertices[t[1]], vertices[t[2]]) - point)
              .norm());
    }
    EXPECT_DOUBLE_EQ((mesh.Closest(point) - point).norm(), best);
  }
}

TEST(MeshTest, ClosestPointIsNoFartherThanAnySample) {
  Rng rng(5);
  for (int trial = 0; trial < 500; ++trial) {
    const Vec3 a = RandomVector(&rng), b = RandomVector(&rng), c = RandomVector(&rng);
    const Vec3 p = 2.0 * RandomVector(&rng);
    const double distance = (ClosestPointOnTriangle(p, a, b, c) - p).norm();
    double sampled = 1e9;
    for (int i = 0; i <= 40; ++i) {
      for (int j = 0; i + j <= 40; ++j) {
        const Vec3 q = a + i / 40.0 * (b - a) + j / 40.0 * (c - a);
        sampled = std::min(sampled, (q - p).norm());
      }
    }
    EXPECT_LE(distance, sampled + 1e-12);
    EXPECT_GE(distance, sampled - 0.15);  // the samples' spacing
  }
}

TEST(MeshTest, ReadsPly) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "m.ply";
  const std::string header =
      "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty float y\n"
      "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
  ASSERT_TRUE(WriteFileAtomically(path, header + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"));
  const auto mesh = TriangleMesh::ReadPly(path);
  ASSERT_TRUE(mesh) << ToString(mesh.error());
  EXPECT_EQ(mesh->num_triangles(), 2u);
  EXPECT_LT((mesh->Closest(Vec3(0.2, 0.9, 3.0)) - Vec3(0.2, 0.9, 0.0)).norm(), 1e-15);
  EXPECT_LT((mesh->Closest(Vec3(2.0, 0.5, 0.0)) - Vec3(1.0, 0.5, 0.0)).norm(), 1e-15);
  for (const char* body : {"0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 9\n", "0 0 0\n1 0 0\n",
                           "0 0 0\n1 0 0\n1 1 0\n0 nan 0\n4 0 1 2 3\n"}) {
    ASSERT_TRUE(WriteFileAtomically(path, header + body));
    EXPECT_FALSE(TriangleMesh::ReadPly(path));
  }
}

}  // namespace
}  // namespace rsfm
