// The exact projection vectors, made with 40-digit arithmetic: agreement to 1e-9 px.
#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "rsfm/refraction/any_camera.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

Vec3 ReadVec3(const YAML::Node& node) {
  return {node[0].as<double>(), node[1].as<double>(), node[2].as<double>()};
}

CameraConfig ReadCamera(const fs::path& file) {
  const YAML::Node root = YAML::LoadFile(file.string());
  const YAML::Node camera = root["camera"], port = root["port"];
  CameraConfig config;
  config.lens = LensModelFromName(camera["model"].as<std::string>()).value();
  config.width = camera["width"].as<int>();
  config.height = camera["height"].as<int>();
  for (const YAML::Node& value : camera["params"])
    EXPECT_TRUE(config.lens_params.TryPushBack(value.as<double>()));
  const auto type = port["type"].as<std::string>();
  if (type == "none") return config;
  config.port.type = type == "flat" ? PortType::kFlat : PortType::kDome;
  if (port["normal"]) config.port.normal = ReadVec3(port["normal"]);
  if (port["distance_m"]) config.port.distance_m = port["distance_m"].as<double>();
  if (port["center_m"]) config.port.center_m = ReadVec3(port["center_m"]);
  if (port["radius_m"]) config.port.radius_m = port["radius_m"].as<double>();
  config.port.thickness_m = port["thickness_m"].as<double>();
  config.port.index_air = port["index_air"].as<double>();
  config.port.index_glass = port["index_glass"].as<double>();
  config.port.index_water = port["index_water"].as<double>();
  return config;
}

template <int kSize>
std::vector<Eigen::Matrix<double, kSize, 1>> ReadRows(const fs::path& file) {
  std::ifstream in(file);
  std::vector<Eigen::Matrix<double, kSize, 1>> rows;
  Eigen::Matrix<double, kSize, 1> row;
  while (true) {
    for (int i = 0; i < kSize; ++i) in >> row[i];
    if (!in) return rows;
    rows.push_back(row);
  }
}

TEST(Vectors, ProjectionAgreesTo1e9PixelsAndBackprojectionMeetsThePoint) {
  const fs::path folder = fs::path(RSFM_SHARED_DATA) / "vectors";
  if (!fs::exists(folder)) GTEST_SKIP() << "no " << folder;
  int cameras = 0;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    if (!entry.is_directory()) continue;
    SCOPED_TRACE(entry.path().filename());
    const Expected<AnyCamera> camera = AnyCamera::Create(ReadCamera(entry.path() / "camera.yaml"));
    ASSERT_TRUE(camera) << camera.error().where;
    const auto points = ReadRows<3>(entry.path() / "points.csv");
    const auto pixels = ReadRows<2>(entry.path() / "pixels.csv");
    ASSERT_EQ(points.size(), pixels.size());
    ASSERT_FALSE(points.empty());
    double worst_px = 0.0, worst_m = 0.0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      Vec2 pixel;
      ASSERT_EQ(camera->Project(points[i], &pixel), Projection::kOk) << points[i].transpose();
      worst_px = std::max(worst_px, (pixel - pixels[i]).norm());
      Ray3 ray;
      ASSERT_EQ(camera->Backproject(pixels[i], &ray), Projection::kOk) << pixels[i].transpose();
      worst_m = std::max(worst_m, ray.Distance(points[i]) / points[i].norm());
    }
    EXPECT_LT(worst_px, 1e-9);
    EXPECT_LT(worst_m, 1e-12);
    ++cameras;
  }
  EXPECT_GE(cameras, 1);
}

}  // namespace
}  // namespace rsfm
