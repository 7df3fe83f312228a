// Alignment and mesh distance against what they must give.
#include <gtest/gtest.h>

#include "rsfm/base/rng.h"
#include "rsfm/base/so3.h"
#include "rsfm/io/atomic_output.h"
#include "tests/support/temporary_folder.h"
#include "tools/evaluation/alignment.h"
#include "tools/evaluation/mesh.h"

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
    EXPECT_DOUBLE_EQ(mesh.Distance(point), best);
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
  EXPECT_DOUBLE_EQ(mesh->Distance(Vec3(0.2, 0.9, 3.0)), 3.0);
  EXPECT_DOUBLE_EQ(mesh->Distance(Vec3(2.0, 0.5, 0.0)), 1.0);
  for (const char* body : {"0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 9\n", "0 0 0\n1 0 0\n",
                           "0 0 0\n1 0 0\n1 1 0\n0 nan 0\n4 0 1 2 3\n"}) {
    ASSERT_TRUE(WriteFileAtomically(path, header + body));
    EXPECT_FALSE(TriangleMesh::ReadPly(path));
  }
}

}  // namespace
}  // namespace rsfm
