#include "rsfm/mapping/pose_graph.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "rsfm/base/rng.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

const Vec6 kVariance = (Vec6() << 1e-6, 1e-6, 4e-6, 1e-4, 1e-4, 1e-4).finished();

Vec6 Noise(Rng* rng, const Vec6& variance) {
  Vec6 noise;
  for (int i = 0; i < 6; ++i) noise[i] = std::sqrt(variance[i]) * rng->Gaussian();
  return noise;
}

// A turn about the world's axes at the camera, and a shift along them.
Rigid3 Disturbed(const Rigid3& pose, const Vec6& by) {
  return {ExpSo3(by.head<3>()) * pose.rotation, pose.translation + by.tail<3>()};
}

// A square of 40 m that is gone round again and again.
Rigid3 Truth(int node) {
  const double s = std::fmod(0.5 * node, 40.0);
  const int side = static_cast<int>(s / 10.0);
  const double on = s - 10.0 * side;
  const Vec3 corners[] = {{0, 0, 0}, {10, 0, 0}, {10, 10, 0}, {0, 10, 0}, {0, 0, 0}};
  const Vec3 place = corners[side] + on / 10.0 * (corners[side + 1] - corners[side]);
  return {ExpSo3(Vec3(0, 0, 0.5 * M_PI * side)), place + Vec3(3, -4, 12)};
}

// The way as odometry has it.
std::vector<Rigid3> Drifted(int count, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<Rigid3> poses{Truth(0)};
  for (int i = 1; i < count; ++i)
    poses.push_back(
        Disturbed(poses.back() * (Truth(i - 1).Inverse() * Truth(i)), Noise(&rng, kVariance)));
  return poses;
}

PoseGraph Graph(const std::vector<Rigid3>& poses, const PoseGraphOptions& options = {}) {
  PoseGraph graph(options);
  for (const Rigid3& pose : poses) EXPECT_TRUE(graph.AddNode(pose, kVariance));
  return graph;
}

PoseGraph::Loop LoopOf(int a, int b, const Rigid3& a_from_b) {
  return {a, b, a_from_b, 1e-6 * Mat6::Identity()};
}
PoseGraph::Loop TrueLoop(int a, int b) { return LoopOf(a, b, Truth(a).Inverse() * Truth(b)); }

double Rmse(const PoseGraph& graph) {
  double sum = 0.0;
  for (int i = 0; i < graph.size(); ++i)
    sum += (graph.world_from_camera(i).translation - Truth(i).translation).squaredNorm();
  return std::sqrt(sum / graph.size());
}

// Written from the cost alone: links as they were measured, loops as they are.
double Cost(const std::vector<Rigid3>& poses, const std::vector<Rigid3>& measured,
            const std::vector<PoseGraph::Loop>& loops) {
  double cost = 0.0;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    // In the camera's place, along the world's axes.
    const Rigid3 asked = poses[i - 1] * measured[i - 1].Inverse() * measured[i];
    Vec6 off;
    off.head<3>() = LogSo3(asked.rotation * poses[i].rotation.conjugate());
    off.tail<3>() = asked.translation - poses[i].translation;
    cost += off.cwiseAbs2().cwiseQuotient(kVariance).sum();
  }
  for (const PoseGraph::Loop& loop : loops) {
    const Vec6 off = LogSe3((poses[static_cast<std::size_t>(loop.a)] * loop.a_from_b).Inverse() *
                            poses[static_cast<std::size_t>(loop.b)]);
    cost += off.dot(loop.covariance.inverse() * off);
  }
  return cost;
}

TEST(PoseGraph, NoOtherChainIsMoreLikely) {
  const std::vector<Rigid3> drifted = Drifted(120, 3);
  PoseGraph graph = Graph(drifted);
  Rng rng(17);
  std::vector<PoseGraph::Loop> loops;
  for (const auto& [a, b] : {std::pair{5, 85}, {20, 100}, {30, 110}}) {
    loops.push_back(
        LoopOf(a, b, Truth(a).Inverse() * Truth(b) * ExpSe3(Noise(&rng, Vec6::Constant(1e-6)))));
    ASSERT_TRUE(graph.Close(loops.back()));
  }
  std::vector<Rigid3> poses;
  for (int i = 0; i < graph.size(); ++i) poses.push_back(graph.world_from_camera(i));
  const double best = Cost(poses, drifted, loops);
  EXPECT_LT(best, 0.2 * Cost(drifted, drifted, loops));
  for (int trial = 0; trial < 60; ++trial) {
    std::vector<Rigid3> other = poses;
    // One node, or all from one on: node 0 stays.
    const std::size_t from = 1 + rng.Index(static_cast<std::uint32_t>(other.size() - 1));
    const Rigid3 change = Disturbed(Rigid3(), Noise(&rng, Vec6::Constant(1e-8)));
    for (std::size_t i = from; i < (trial % 2 == 0 ? from + 1 : other.size()); ++i)
      other[i] = {change.rotation * other[i].rotation, other[i].translation + change.translation};
    EXPECT_GT(Cost(other, drifted, loops), best - 1e-6 * best) << trial;
  }
  EXPECT_EQ(graph.world_from_camera(0).translation, drifted[0].translation);
}

TEST(PoseGraph, ALoopCorrectsTheWayBetween) {
  PoseGraphOptions options;
  options.max_nodes = 4000;
  PoseGraph graph = Graph(Drifted(4000, 5), options);
  ASSERT_EQ(graph.size(), graph.capacity());
  EXPECT_FALSE(graph.AddNode(Rigid3(), kVariance));
  const double before = Rmse(graph);
  MallocTrap trap;
  for (int b = 400; b < 4000; b += 400) ASSERT_TRUE(graph.Close(TrueLoop(b - 400, b))) << b;
  EXPECT_EQ(trap.count(), 0u);
  EXPECT_LT(Rmse(graph), 0.3 * before);
}

TEST(PoseGraph, RefusesWhatContradictsTheWayAndStaysAsItWas) {
  PoseGraph graph = Graph(Drifted(200, 7));
  const Rigid3 last = graph.world_from_camera(199);
  PoseGraph::Loop wrong = TrueLoop(10, 170);
  wrong.a_from_b.translation.x() += 5.0;
  const auto status = graph.Close(wrong);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, Errc::kNotEnoughInliers);
  wrong.a_from_b.translation.x() = std::nan("");
  EXPECT_FALSE(graph.Close(wrong));
  EXPECT_FALSE(graph.Close(TrueLoop(10, 200)));
  EXPECT_FALSE(graph.Close(TrueLoop(10, 10)));
  EXPECT_EQ(graph.num_loops(), 0);
  EXPECT_EQ(graph.world_from_camera(199).translation, last.translation);
}

// Full of loops, it takes the old ones for settled and goes on.
TEST(PoseGraph, GoesOnWhenItIsFull) {
  PoseGraphOptions options;
  options.max_loops = 3;
  options.max_nodes = 400;
  PoseGraph graph = Graph(Drifted(400, 9), options);
  const double before = Rmse(graph);
  for (int b = 90; b < 400; b += 30) {
    ASSERT_TRUE(graph.Close(TrueLoop(b - 80, b))) << b;
    EXPECT_LE(graph.num_loops(), 3);
  }
  EXPECT_LT(Rmse(graph), 0.5 * before);
  const Rigid3 kept = graph.world_from_camera(150);
  graph.DropOldest(100);
  EXPECT_EQ(graph.size(), 300);
  EXPECT_EQ(graph.world_from_camera(50).translation, kept.translation);
  EXPECT_TRUE(graph.AddNode(Truth(400), kVariance));
  graph.Move({ExpSo3(Vec3(0, 0, 1.0)), Vec3(1, 2, 3)});
  EXPECT_NEAR((graph.world_from_camera(50).translation -
               (ExpSo3(Vec3(0, 0, 1.0)) * kept.translation + Vec3(1, 2, 3)))
                  .norm(),
              0.0, 1e-9);
}

}  // namespace
}  // namespace rsfm
