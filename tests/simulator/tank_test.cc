#include "tools/simulator/tank.h"

#include <gtest/gtest.h>

#include "tools/simulator/ray_caster.h"

namespace rsfm::simulator {
namespace {

TankOptions Coarse() {
  TankOptions options;
  options.texel_m = 0.004;
  return options;
}

class TankTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    scene_ = MakeTank(Coarse(), 2);
    caster_ = RayCaster::Create(scene_->meshes());
  }
  static void TearDownTestSuite() {
    caster_.reset();
    scene_.reset();
  }

  // From a place in the world; nothing above the walls.
  static std::optional<RayHit> Trace(const Vec3& from, const Vec3& direction) {
    return caster_->Trace((from - scene_->WorldOffset()).cast<float>(),
                          direction.normalized().cast<float>());
  }
  static Rgb AlbedoAt(const Scene& scene, const RayHit& hit, float footprint_m) {
    SurfacePoint point;
    point.footprint_m = footprint_m;
    point.mesh = hit.mesh;
    point.triangle = hit.triangle;
    point.u = hit.u;
    point.v = hit.v;
    Rgb albedo;
    scene.Albedo({&point, 1}, {&albedo, 1});
    return albedo;
  }

  static inline std::unique_ptr<Scene> scene_;
  static inline std::unique_ptr<RayCaster> caster_;
};

TEST_F(TankTest, WallsAndFloorStandWhereAskedFor) {
  const Vec3 middle(0.0, 0.0, 0.1);  // the floor is at 1 m
  EXPECT_NEAR(Trace(middle, Vec3(1, 0, 0))->range_m, 1.0, 1e-5);
  EXPECT_NEAR(Trace(middle, Vec3(-1, 0, 0))->range_m, 1.0, 1e-5);
  EXPECT_NEAR(Trace(middle, Vec3(0, 1, 0))->range_m, 0.5, 1e-5);
  EXPECT_NEAR(Trace(middle, Vec3(0, -1, 0))->range_m, 0.5, 1e-5);
  EXPECT_FALSE(Trace(middle, Vec3(0, 0, -1)));  // open above
  double mean_depth = 0.0;
  double highest = 10.0;
  int count = 0;
  for (double x = -0.95; x < 0.96; x += 0.05) {
    for (double y = -0.45; y < 0.46; y += 0.05, ++count) {
      const auto hit = Trace(Vec3(x, y, 0.05), Vec3(0, 0, 1));
      ASSERT_TRUE(hit);
      mean_depth += 0.05 + hit->range_m;
      highest = std::min(highest, 0.05 + static_cast<double>(hit->range_m));
    }
  }
  EXPECT_NEAR(mean_depth / count, 0.97, 0.05);  // objects stand on it
  EXPECT_LT(highest, 0.85);                     // and have height
}

TEST_F(TankTest, EverySurfaceLooksTowardsTheWater) {
  for (double angle = 0.0; angle < 6.28; angle += 0.05) {
    for (const double down : {-0.3, 0.3, 1.0, 3.0}) {
      const auto hit = Trace(Vec3(0.0, 0.0, 0.3), Vec3(std::cos(angle), std::sin(angle), down));
      if (!hit) continue;
      const TriangleMesh& mesh = scene_->meshes()[hit->mesh];
      const auto& [a, b, c] = mesh.triangles[hit->triangle];
      const Vec3f normal =
          (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]);
      EXPECT_LT(normal.dot(Vec3(std::cos(angle), std::sin(angle), down).cast<float>()), 0.0f);
    }
  }
}

// A texture that repeated would show the same values at places a period apart.
TEST_F(TankTest, TextureIsRichAndDoesNotRepeat) {
  std::vector<float> along;
  for (double x = -0.9; x < 0.9; x += 0.004) {
    const auto hit = Trace(Vec3(x, -0.4, 0.4), Vec3(0, -1, 0));
    ASSERT_TRUE(hit);
    along.push_back(AlbedoAt(*scene_, *hit, 0.004f)[1]);
  }
  const auto n = static_cast<int>(along.size());
  double mean = 0.0, variance = 0.0;
  for (const double v : along) mean += v / n;
  for (const double v : along) variance += (v - mean) * (v - mean) / n;
  EXPECT_GT(std::sqrt(variance), 0.15 * mean);
  for (int shift = 25; shift < n / 2; ++shift) {
    double product = 0.0;
    for (int i = 0; i + shift < n; ++i) product += (along[i] - mean) * (along[i + shift] - mean);
    EXPECT_LT(product / (n - shift) / variance, 0.7) << "at " << 0.004 * shift << " m";
  }
}

TEST(TankOptionsTest, ATankIsAFunctionOfItsOptionsAlone) {
  TankOptions options;
  options.texel_m = 0.01;
  options.stones = options.bricks = options.posts = 1;
  const auto first = MakeTank(options, 2);
  const auto same = MakeTank(options, 1);
  options.seed = 2;
  const auto other = MakeTank(options, 2);
  ASSERT_EQ(first->meshes().size(), 8u);
  ASSERT_EQ(same->meshes().size(), 8u);
  std::vector<SurfacePoint> points;
  for (std::size_t i = 0; i < first->meshes().size(); ++i) {
    EXPECT_EQ(first->meshes()[i].vertices, same->meshes()[i].vertices);
    SurfacePoint& point = points.emplace_back();
    point.footprint_m = 0.01f;
    point.mesh = static_cast<std::uint32_t>(i);
    point.triangle = 5;
    point.u = point.v = 0.3f;
  }
  EXPECT_NE(first->meshes()[0].vertices, other->meshes()[0].vertices);
  std::vector<Rgb> a(points.size()), b(points.size());
  first->Albedo(points, a);
  same->Albedo(points, b);
  EXPECT_EQ(a, b);
}

}  // namespace
}  // namespace rsfm::simulator
