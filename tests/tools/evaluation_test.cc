// Alignment and mesh distance against what they must give.
#include <gtest/gtest.h>

#include "rsfm/base/rng.h"
#include "rsfm/base/so3.h"
#include "rsfm/io/atomic_output.h"
#include "tests/support/temporary_folder.h"
#include "tools/evaluation/alignment.h"
#include "tools/evaluation/consistency.h"
#include "tools/evaluation/evaluate.h"
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

// A vehicle on a circle whose log is a per cent long and whose heading is off by a constant: after
// alignment in position and yaw only the per cent is left; a camera on a lever rides along.
class DeadReckoningTest : public testing::Test {
 protected:
  static constexpr double kRadius_m = 10.0, kTurn_radps = 0.1, kOff_rad = 0.3, kLong = 1.01,
                          kHeave_radps = 0.3;
  static constexpr Utime kStartUs = 1'000'000'000;

  DeadReckoningTest() {
    input_.body_from_camera = Rigid3(ExpSo3(Vec3(0, 0, 1.5)), Vec3(0.4, 0.1, 0.2));
    for (int i = -4; i <= 604; ++i) {
      const double seconds = 0.1 * i;
      NavSample s;
      s.utime = kStartUs + UsFromSeconds(seconds);
      s.Set(NavField::kAttitude);
      s.Set(NavField::kVelocity);
      s.Set(NavField::kDepth);
      s.ned_from_body = ExpSo3(Vec3(0, 0, kOff_rad)) * Body(seconds).rotation;
      s.velocity_body_mps =
          Vec3(kLong * kTurn_radps * kRadius_m, 0, kHeave_radps * std::cos(kHeave_radps * seconds));
      s.depth_m = Body(seconds).translation.z();
      input_.samples.push_back(s);
    }
    for (int i = 0; i <= 60; ++i) {
      const Rigid3 camera = Body(i) * input_.body_from_camera;
      truth_.poses.push_back({kStartUs + UsFromSeconds(i), "", camera});
      utimes_.push_back(truth_.poses.back().utime);
    }
  }
  static Rigid3 Body(double seconds) {
    const double a = kTurn_radps * seconds;
    return {ExpSo3(Vec3(0, 0, a)), Vec3(kRadius_m * std::sin(a), -kRadius_m * std::cos(a),
                                        5.0 + std::sin(kHeave_radps * seconds))};
  }

  NavigationInput input_;
  GroundTruth truth_;
  std::vector<Utime> utimes_;
};

TEST_F(DeadReckoningTest, OnlyTheLogsErrorIsLeft) {
  const ImageNavigation at_images(input_, utimes_);
  const auto found = EvaluateDeadReckoning(at_images, truth_.poses, truth_, Alignment::kYaw);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->num_images, 61);
  // A circle of 10 m that is drawn with 10.1 m; the camera's lever is not drawn larger.
  EXPECT_NEAR(found->position_rmse_mm, 1e3 * (kLong - 1.0) * kRadius_m, 2.0);
  EXPECT_NEAR(*found->rotation_error_deg, 0.0, 0.05);  // the circle is not closed
  // 6 rad of a circle through the lever's end, up and down by a metre.
  EXPECT_NEAR(found->distance_m, 60.0, 3.0);
}

TEST_F(DeadReckoningTest, NotWhereTheLogIsSilentOrNothingIsAligned) {
  const ImageNavigation whole(input_, utimes_);
  EXPECT_FALSE(EvaluateDeadReckoning(whole, truth_.poses, truth_, Alignment::kNone));
  for (std::size_t i = 300; i < 340; ++i)
    input_.samples[i].valid &= ~static_cast<std::uint32_t>(NavField::kVelocity);
  const ImageNavigation gap(input_, utimes_);
  EXPECT_FALSE(EvaluateDeadReckoning(gap, truth_.poses, truth_, Alignment::kYaw));
}

// Ten frames tracked, three reckoned, ten tracked after a jump that is announced.
Mission FlownMission(double sigma_m, double error_m) {
  Mission mission;
  mission.rig.body_from_camera = Rigid3(ExpSo3(Vec3(0, 0, 1.5)), Vec3(0.4, 0.1, 0.2));
  Rng rng(8);
  for (int i = 0; i < 23; ++i) {
    pose_t pose{};
    pose.utime = 1'000'000 * (i + 1);
    pose.frame_id = "ned";
    pose.state = pose_t::STATE_TRACKING;
    if (i >= 10 && i < 13) pose.state = pose_t::STATE_DEAD_RECKONING;
    pose.reset_counter = i < 13 ? 0 : 1;
    pose.frame_from_body_q[0] = 1.0;
    for (int k = 0; k < 3; ++k)  // the first is where it says it is
      pose.position_m[k] = (k == 0 ? i : 0.0) + (i > 0 ? error_m * rng.Gaussian() : 0.0);
    for (int k = 0; k < 6; ++k) pose.covariance[7 * k] = sigma_m * sigma_m;
    mission.poses.push_back(pose);
  }
  return mission;
}

GroundTruth TruthOf(const Mission& mission) {
  GroundTruth truth;
  for (int i = 0; i < 23; ++i) {
    const Rigid3 body(Quat::Identity(), Vec3(i, 5.0, 0.0));  // the world lies elsewhere
    truth.poses.push_back({1'000'000 * (i + 1), "", body * mission.rig.body_from_camera});
  }
  return truth;
}

TEST(ConsistencyTest, TellsStatesJumpsAndWhetherTheCovarianceIsRight) {
  const Mission mission = FlownMission(0.02, 0.02);
  const auto found = EvaluateConsistency(mission, TruthOf(mission));
  ASSERT_TRUE(found);
  ASSERT_EQ(found->spells.size(), 3u);
  const auto& reckoned = found->spells[1];
  EXPECT_EQ(reckoned.state, pose_t::STATE_DEAD_RECKONING);
  EXPECT_EQ(reckoned.begin, 11'000'000);
  EXPECT_EQ(reckoned.end, 14'000'000);
  EXPECT_EQ(reckoned.num_frames, 3);
  EXPECT_EQ(reckoned.num_jumps, 0);
  EXPECT_EQ(found->spells[2].num_jumps, 1);
  EXPECT_EQ(found->num_judged, 23);
  EXPECT_NEAR(found->nees, 3.0 * 22 / 23, 1.2);  // three of six are without error here
  EXPECT_GT(found->within_95, 0.9);

  const Mission sure = FlownMission(0.002, 0.02);  // ten times too sure of itself
  const auto wrong = EvaluateConsistency(sure, TruthOf(sure));
  ASSERT_TRUE(wrong);
  EXPECT_NEAR(wrong->nees, 100.0 * found->nees, 1e-6 * wrong->nees);
  EXPECT_LT(wrong->within_95, 0.2);
}

TEST(ConsistencyTest, NothingIsJudgedWithoutCovarianceTruthOrNed) {
  Mission mission = FlownMission(0.02, 0.02);
  EXPECT_FALSE(EvaluateConsistency(mission, GroundTruth()));
  const GroundTruth truth = TruthOf(mission);
  for (std::size_t i = 0; i < 12; ++i) mission.poses[i].covariance[0] = -1.0;
  ASSERT_TRUE(EvaluateConsistency(mission, truth));
  EXPECT_EQ(EvaluateConsistency(mission, truth)->num_judged, 11);
  for (pose_t& pose : mission.poses) pose.frame_id = "first_camera";
  EXPECT_FALSE(EvaluateConsistency(mission, truth));
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

// A few wrong points would bend a flat floor by metres; a floor that is bent stays so.
TEST(BendTest, WhatIsFarOffIsLeftOut) {
  Rng rng(8);
  const Vec3 up = Vec3(0.1, -0.2, 1.0).normalized();
  const Quat turn = Quat::FromTwoVectors(Vec3::UnitZ(), up);
  std::vector<Vec3> bowl, points;
  for (int i = 0; i < 2000; ++i) {
    const Vec2 p(rng.Uniform(-20, 20), rng.Uniform(-15, 15));
    bowl.push_back(turn * Vec3(p.x(), p.y(), 5.0 - 1e-3 * p.squaredNorm() + 0.02 * rng.Gaussian()));
  }
  points = bowl;
  for (int i = 0; i < 5; ++i)
    points.push_back(turn * Vec3(rng.Uniform(-20, 20), rng.Uniform(-15, 15), 4000.0));
  points.push_back(turn * Vec3(9000.0, 0.0, 5.0));
  EXPECT_GT(std::abs(FitBend(points, up)->sagitta_m - FitBend(bowl, up)->sagitta_m), 0.3);
  EXPECT_EQ(WithoutFarOff(points, up), bowl);
  EXPECT_TRUE(WithoutFarOff({}, up).empty());
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
