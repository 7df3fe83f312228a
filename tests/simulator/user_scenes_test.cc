// What users bring: meshes, height grids and recorded paths.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <opencv2/core/mat.hpp>
#include <opencv2/imgcodecs.hpp>

#include "tests/support/temporary_folder.h"
#include "tools/simulator/height_grid.h"
#include "tools/simulator/mesh_scene.h"
#include "tools/simulator/ray_caster.h"
#include "tools/simulator/recorded.h"

namespace rsfm::simulator {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

fs::path Write(const fs::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
  return path;
}

std::string Square(const std::string& vertex_properties, const std::array<std::string, 4>& more) {
  return "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty "
         "float z\n" +
         vertex_properties +
         "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
         "-1 -2 5 " +
         more[0] + "\n-1 2 5 " + more[1] + "\n1 2 5 " + more[2] + "\n1 -2 5 " + more[3] +
         "\n4 0 1 2 3\n";
}

class MeshSceneTest : public ::testing::Test {
 protected:
  // Looking straight down on (north, east).
  static Rgb Seen(const Scene& scene, double north, double east) {
    const auto caster = RayCaster::Create(scene.meshes());
    const Vec3 from = Vec3(north, east, 0.0) - scene.WorldOffset();
    const auto hit = caster->Trace(from.cast<float>(), Vec3f::UnitZ());
    if (!hit) return {-1.0f, -1.0f, -1.0f};
    EXPECT_NEAR(hit->range_m, 5.0, 1e-5);
    SurfacePoint point;
    point.footprint_m = 1e-4f;
    point.mesh = hit->mesh;
    point.triangle = hit->triangle;
    point.u = hit->u;
    point.v = hit->v;
    Rgb albedo;
    scene.Albedo({&point, 1}, {&albedo, 1});
    return albedo;
  }
  // Left half red, right half blue above; left half green, right half white below.
  fs::path Picture() const {
    cv::Mat image(32, 64, CV_8UC3);
    for (int y = 0; y < 32; ++y) {
      for (int x = 0; x < 64; ++x) {
        const cv::Vec3b above = x < 32 ? cv::Vec3b(0, 0, 255) : cv::Vec3b(255, 0, 0);
        const cv::Vec3b below = x < 32 ? cv::Vec3b(0, 255, 0) : cv::Vec3b(255, 255, 255);
        image.at<cv::Vec3b>(y, x) = y < 16 ? above : below;
      }
    }
    cv::imwrite((folder_.path() / "picture.png").string(), image);
    return folder_.path() / "picture.png";
  }

  TemporaryFolder folder_;
  MeshOptions options_;
};

TEST_F(MeshSceneTest, AnImageLiesOverAMeshFromAbove) {
  options_.file = Write(folder_.path() / "m.ply", Square("", {"", "", "", ""}));
  options_.texture = Picture();
  options_.sky_light = 0.0;
  const auto scene = LoadMeshScene(options_, 2);
  ASSERT_TRUE(scene) << ToString(scene.error());
  EXPECT_EQ(Seen(**scene, 0.5, -1.0), (Rgb{1.0f, 0.0f, 0.0f}));   // north-west: upper left
  EXPECT_EQ(Seen(**scene, 0.5, 1.0), (Rgb{0.0f, 0.0f, 1.0f}));    // north-east: upper right
  EXPECT_EQ(Seen(**scene, -0.5, -1.0), (Rgb{0.0f, 1.0f, 0.0f}));  // south-west: lower left
  EXPECT_EQ(Seen(**scene, 3.0, 0.0)[0], -1.0f);
  EXPECT_NEAR(*MeshFloorDepth(options_), 5.0, 1e-9);
}

TEST_F(MeshSceneTest, TextureCoordinatesSayWhereTheImageLies) {
  // Turned by half a turn against the case above: the first corner (south-west) is the upper right.
  options_.file = Write(folder_.path() / "m.ply", Square("property float s\nproperty float t\n",
                                                         {"1 1", "0 1", "0 0", "1 0"}));
  options_.texture = Picture();
  options_.sky_light = 0.0;
  const auto scene = LoadMeshScene(options_, 1);
  ASSERT_TRUE(scene) << ToString(scene.error());
  EXPECT_EQ(Seen(**scene, -0.5, -1.0), (Rgb{0.0f, 0.0f, 1.0f}));
  EXPECT_EQ(Seen(**scene, -0.5, 1.0), (Rgb{1.0f, 0.0f, 0.0f}));
  EXPECT_EQ(Seen(**scene, 0.5, 1.0), (Rgb{0.0f, 1.0f, 0.0f}));
}

TEST_F(MeshSceneTest, WithoutAnImageColoursOrAGeneratedTextureAreSeen) {
  const std::string colours = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  options_.file = Write(folder_.path() / "m.ply",
                        Square(colours, {"255 0 0", "255 0 0", "255 0 0", "255 0 0"}));
  options_.sky_light = 0.0;
  EXPECT_EQ(Seen(**LoadMeshScene(options_, 1), 0.2, 0.3), (Rgb{1.0f, 0.0f, 0.0f}));
}

TEST_F(MeshSceneTest, BadFilesAreNamed) {
  options_.file = folder_.path() / "none.ply";
  EXPECT_EQ(LoadMeshScene(options_, 1).error().file, options_.file.string());
  options_.file = Write(folder_.path() / "m.ply", "solid cube");
  const auto no_ply = LoadMeshScene(options_, 1);
  ASSERT_FALSE(no_ply);
  EXPECT_THAT(ToString(no_ply.error()), HasSubstr("PLY"));
  EXPECT_EQ(ExitCode(no_ply.error()), 2);
  options_.file = Write(folder_.path() / "m.ply", Square("", {"", "", "", ""}));
  options_.texture = Write(folder_.path() / "t.png", "no picture");
  const auto no_image = LoadMeshScene(options_, 1);
  ASSERT_FALSE(no_image);
  EXPECT_EQ(no_image.error().file, options_.texture.string());
  EXPECT_EQ(ExitCode(no_image.error()), 2);
  options_.texture = folder_.path() / "none.png";
  EXPECT_EQ(LoadMeshScene(options_, 1).error().file, options_.texture.string());
}

constexpr const char* kGrid =
    "ncols 3\nnrows 2\nxllcorner 1000\nyllcorner 2000\ncellsize 2\nNODATA_value -9999\n"
    "-10 -9 -8\n-13 -9999 -11\n";

TEST(HeightGridTest, HeightsLieNorthUpAboutTheirMean) {
  const TemporaryFolder folder;
  const auto grid = HeightGrid::Read(Write(folder.path() / "g.asc", kGrid));
  ASSERT_TRUE(grid) << ToString(grid.error());
  const double mean = -51.0 / 5.0;
  EXPECT_NEAR(grid->At(1.0, -2.0), -10.0 - mean, 1e-5);   // north-west
  EXPECT_NEAR(grid->At(1.0, 2.0), -8.0 - mean, 1e-5);     // north-east
  EXPECT_NEAR(grid->At(-1.0, -2.0), -13.0 - mean, 1e-5);  // south-west
  EXPECT_NEAR(grid->At(-1.0, 0.0), -13.0 - mean, 1e-5);   // no data: as to the west
  EXPECT_NEAR(grid->At(0.0, 2.0), -9.5 - mean, 1e-5);     // between
  EXPECT_NEAR(grid->At(50.0, 50.0), -8.0 - mean, 1e-5);   // beyond the edge
  EXPECT_EQ(grid->HalfSize(), Vec2(1.0, 2.0));
  EXPECT_NEAR(grid->Lowest(), -13.0 - mean, 1e-5);
}

TEST(HeightGridTest, BadGridsAreNamed) {
  const TemporaryFolder folder;
  const struct {
    std::string text, message;
  } cases[] = {
      {"", "ncols"},
      {"ncols 3\nnrows 2\ncellsize 2\n1 2 3 4 5\n", "5 cells"},
      {"ncols 3\nnrows 2\ncellsize 2\n1 2 3 4 5 6 7\n", "6"},
      {"ncols 3\nnrows 2\ncellsize 2\n1 2 x 4 5 6\n", "'x'"},
      {"ncols three\n", "ncols"},
      {"ncols 3\nnrows 2\ncellsize 0\n1 2 3 4 5 6\n", "cellsize"},
      {"ncols 1e9\nnrows 1e9\ncellsize 1\n", "100 million"},
      {"ncols 3\nnrows 2\nsize 2\n", "size"},
      {"ncols 2\nnrows 2\ncellsize 1\nNODATA_value 1\n1 1 1 1\n", "no cell with data"},
      {"ncols 2\nnrows 2\ncellsize 1\n1 1 1 -32768\n", "NODATA_value"},
  };
  for (const auto& c : cases) {
    const auto grid = HeightGrid::Read(Write(folder.path() / "g.asc", c.text));
    ASSERT_FALSE(grid) << c.text;
    EXPECT_THAT(ToString(grid.error()), HasSubstr(c.message));
    EXPECT_THAT(grid.error().file, HasSubstr("g.asc"));
    EXPECT_EQ(ExitCode(grid.error()), 2);
    EXPECT_FALSE(grid.error().fix.empty());
  }
  EXPECT_EQ(ExitCode(HeightGrid::Read(folder.path() / "none.asc").error()), 2);
}

class RecordedTest : public ::testing::Test {
 protected:
  IoExpected<std::unique_ptr<Trajectory>> Load() {
    return LoadRecorded(options_, body_from_camera_, 20.0, &altitude_m_);
  }

  TemporaryFolder folder_;
  RecordedOptions options_;
  Rigid3 body_from_camera_{ExpSo3(Vec3(0.1, 0.2, 1.5)), Vec3(0.4, 0.1, 0.2)};
  double altitude_m_ = 0.0;
};

TEST_F(RecordedTest, ATumFilesPosesAreThoseOfTheCamera) {
  options_.file = Write(folder_.path() / "t.tum",
                        "# a comment\n10 1 2 15 0 0 0 1\n11 2 2 15 0 0 0.6 0.8\n"
                        "13 4 3 15.5 0 0 -0.8 -0.6\n");
  options_.center = false;
  const auto trajectory = Load();
  ASSERT_TRUE(trajectory) << ToString(trajectory.error());
  EXPECT_NEAR((*trajectory)->duration_s(), 3.0, 1e-6);
  const Rigid3 middle = (*trajectory)->WorldFromBody(1.0) * body_from_camera_;
  EXPECT_LT((middle.translation - Vec3(2, 2, 15)).norm(), 1e-9);
  EXPECT_LT(AngleBetween(middle.rotation, Quat(0.8, 0, 0, 0.6)), 1e-9);
  // The sign of a quaternion says nothing.
  const Rigid3 later = (*trajectory)->WorldFromBody(2.0) * body_from_camera_;
  EXPECT_LT(AngleBetween(later.rotation, Quat(0.7, 0, 0, 0.7).normalized()), 0.1);
  // Smooth: no jump of the velocity at a pose.
  const Vec3 before = (*trajectory)->MotionAt(0.998).velocity_in_body_mps;
  const Vec3 after = (*trajectory)->MotionAt(1.002).velocity_in_body_mps;
  EXPECT_LT((before - after).norm(), 0.05);
}

TEST_F(RecordedTest, ANavTableIsSmoothedCutAndMoved) {
  std::string table = "utime,north_m,east_m,down_m,roll_rad,pitch_rad,heading_rad\n";
  for (int i = 0; i <= 200; ++i) {
    const double noise = i % 2 == 0 ? 0.02 : -0.02;
    table += std::to_string(1'000'000 + 100'000 * i) + "," +
             std::to_string(100 + 0.05 * i + noise) + ",7,12,0,0,0.3\n";
  }
  options_.file = Write(folder_.path() / "nav.csv", table);
  options_.start_s = 5.0;
  options_.duration_s = 10.0;
  options_.altitude_m = 2.0;
  const auto trajectory = Load();
  ASSERT_TRUE(trajectory) << ToString(trajectory.error());
  EXPECT_NEAR((*trajectory)->duration_s(), 10.0, 0.6);
  EXPECT_NEAR(altitude_m_, 2.0, 1e-9);
  const BodyMotion motion = (*trajectory)->MotionAt(5.0);
  EXPECT_LT((motion.world_from_body.translation - Vec3(0.0, 0.0, 18.0)).norm(), 0.02);
  EXPECT_NEAR(motion.velocity_in_body_mps.norm(), 0.5, 0.03);
  EXPECT_NEAR(motion.velocity_in_body_mps.x(), 0.5 * std::cos(0.3), 0.03);
}

TEST_F(RecordedTest, WhatIsMissingIsNamed) {
  options_.file = folder_.path() / "none.tum";
  EXPECT_EQ(Load().error().file, options_.file.string());
  options_.file =
      Write(folder_.path() / "a.csv", "utime,north_m,east_m,down_m\n1,0,0,0\n2,0,0,0\n");
  EXPECT_THAT(ToString(Load().error()), HasSubstr("roll_rad"));
  options_.file =
      Write(folder_.path() / "b.csv", "utime,roll_rad,pitch_rad,heading_rad\n1,0,0,0\n2,0,0,0\n");
  EXPECT_THAT(ToString(Load().error()), HasSubstr("north_m"));
  options_.file = Write(folder_.path() / "c.tum", "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n");
  options_.start_s = 100.0;
  const auto late = Load();
  ASSERT_FALSE(late);
  EXPECT_THAT(ToString(late.error()), HasSubstr("start_s"));
  EXPECT_EQ(ExitCode(late.error()), 2);
}

// A hull-inspection vehicle's own path, where the recording is at hand.
TEST_F(RecordedTest, AnInspectionVehiclesPathIsFollowed) {
  const fs::path data = fs::path(RSFM_SHARED_DATA) / "data" / "hauv_nav";
  if (!fs::exists(data / "position.csv")) GTEST_SKIP() << data << " is absent";
  std::ifstream position(data / "position.csv"), depth(data / "depth.csv"), dvl(data / "dvl.csv");
  std::map<long long, std::string> rows;
  std::string line, other;
  std::getline(position, line);
  std::getline(depth, line);
  std::getline(dvl, line);
  while (std::getline(position, line) && std::getline(depth, other)) {
    double t, x, y, hull, t2, d;
    ASSERT_EQ(std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf", &t, &x, &y, &hull), 4);
    ASSERT_EQ(std::sscanf(other.c_str(), "%lf,%lf", &t2, &d), 2);
    ASSERT_NEAR(t, t2, 0.2);
    if (t > 120.0) break;
    rows[std::llround(t * 1e6)] =
        std::to_string(x) + "," + std::to_string(y) + "," + std::to_string(d) + ",,,";
  }
  while (std::getline(dvl, line)) {
    double v[8];
    ASSERT_EQ(std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf,%lf,%lf,%lf,%lf", v, v + 1, v + 2, v + 3,
                          v + 4, v + 5, v + 6, v + 7),
              8);
    if (v[0] > 120.0) break;
    std::string& row = rows[std::llround(v[0] * 1e6) + 1];
    row = ",,," + std::to_string(v[7]) + "," + std::to_string(v[6]) + "," + std::to_string(v[5]);
  }
  std::string table = "utime,north_m,east_m,down_m,roll_rad,pitch_rad,heading_rad\n";
  for (const auto& [utime, row] : rows) table += std::to_string(utime) + "," + row + "\n";
  options_.file = Write(folder_.path() / "hauv.csv", table);
  options_.smooth_s = 2.0;
  const auto trajectory = Load();
  ASSERT_TRUE(trajectory) << ToString(trajectory.error());
  EXPECT_GT((*trajectory)->duration_s(), 100.0);
  // The vehicle's own position jumps here and there; what lies between is a slow vehicle's path.
  std::vector<double> speeds;
  for (double t = 1.0; t < 100.0; t += 0.5) {
    const BodyMotion motion = (*trajectory)->MotionAt(t);
    speeds.push_back(motion.velocity_in_body_mps.norm());
    EXPECT_LT(motion.rate_in_body_radps.norm(), 0.6);
  }
  std::sort(speeds.begin(), speeds.end());
  EXPECT_GT(speeds[speeds.size() / 2], 0.02);
  EXPECT_LT(speeds[speeds.size() / 2], 0.6);
}

}  // namespace
}  // namespace rsfm::simulator
