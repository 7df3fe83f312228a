#include "tools/report/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "rsfm/base/rng.h"
#include "rsfm/base/so3.h"
#include "rsfm/io/atomic_output.h"
#include "rsfm/refraction/any_camera.h"
#include "tests/support/temporary_folder.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr double kPixelNoise = 0.3;

// A survey of three legs over a wavy floor, its features with noise.
Model Survey() {
  Rng rng(5);
  Model model;
  CameraConfig& camera = model.rig.camera;
  camera.lens = LensModel::kPinhole;
  camera.width = 800;
  camera.height = 600;
  camera.lens_params = {600.0, 600.0, 400.0, 300.0};
  camera.port.type = PortType::kFlat;
  camera.port.distance_m = 0.03;
  camera.port.thickness_m = 0.02;
  model.rig.world.frame = WorldFrame::kNed;
  model.cameras.push_back({1, camera});
  for (int i = 0; i < 2500; ++i) {
    const double north = rng.Uniform(-3.5, 3.5), east = rng.Uniform(-2.0, 2.0);
    ModelPoint point;
    point.xyz = Vec3(north, east, 20.0 + 0.2 * std::sin(1.5 * north) * std::cos(2.0 * east));
    const auto tone = static_cast<std::uint8_t>(rng.Uniform(40.0, 220.0));
    point.rgb = {tone, static_cast<std::uint8_t>(tone * 9 / 10),
                 static_cast<std::uint8_t>(tone / 2)};
    model.points.push_back(point);
  }
  const AnyCamera any = *AnyCamera::Create(camera);
  for (int i = 0; i < 45; ++i) {
    const int leg = i / 15;
    const int along = leg % 2 == 0 ? i % 15 : 14 - i % 15;
    ModelImage image;
    char name[32];
    std::snprintf(name, sizeof name, "%06d.jpg", i);
    image.name = name;
    image.utime = 1'700'000'000'000'000 + 1'000'000LL * i;
    const Vec3 place(0.4 * along - 2.8, 1.0 * leg - 1.0, 18.3 + 0.1 * std::sin(0.4 * i));
    image.camera_from_world = Rigid3(ExpSo3(Vec3(0.0, 0.0, 1.5707963)), place).Inverse();
    for (std::size_t p = 0; p < model.points.size(); ++p) {
      Vec2 pixel;
      const Vec3 in_camera = image.camera_from_world * model.points[p].xyz;
      if (any.Project(in_camera, &pixel) != Projection::kOk || !any.IsInImage(pixel)) continue;
      model.points[p].track.push_back({i, static_cast<std::int32_t>(image.features.size())});
      image.features.push_back(pixel + kPixelNoise * Vec2(rng.Gaussian(), rng.Gaussian()));
      image.points.push_back(static_cast<std::int32_t>(p));
    }
    model.images.push_back(std::move(image));
  }
  return model;
}

// The same with its poses a little off.
Model Disturbed(Model model) {
  Rng rng(6);
  for (ModelImage& image : model.images) {
    const Vec6 delta = 0.002 * Vec6(rng.Gaussian(), rng.Gaussian(), rng.Gaussian(), rng.Gaussian(),
                                    rng.Gaussian(), rng.Gaussian());
    image.camera_from_world = Perturb(image.camera_from_world, delta);
  }
  return model;
}

// Written where RSFM_KEEP_REPORT says, for a look at the figures.
fs::path Out(const TemporaryFolder& folder) {
  const char* keep = std::getenv("RSFM_KEEP_REPORT");
  return keep != nullptr ? fs::path(keep) : folder.path() / "report";
}

TEST(ReportTest, WritesPageAndFigures) {
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteModel(Survey(), folder.path() / "truth"));
  ASSERT_TRUE(WriteModel(Disturbed(Survey()), folder.path() / "model"));
  ASSERT_TRUE(WriteFileAtomically(
      folder.path() / "model" / "report.json",
      R"({"iterations": 12, "warnings": ["a bent map & more"],
          "parameters": [{"name": "port.distance_m", "initial": 0.02,
          "refined": 0.0301, "standard_deviation": 0.0002, "determined": true}]})"));
  const fs::path out = Out(folder);
  const auto data =
      WriteReport({folder.path() / "model", "", folder.path() / "truth", std::nullopt}, out);
  ASSERT_TRUE(data) << ToString(data.error());
  EXPECT_EQ(data->alignment, Alignment::kSe3);
  EXPECT_EQ(data->num_images, 45u);
  ASSERT_EQ(data->tracks.size(), 1u);
  EXPECT_EQ(data->tracks[0].name, "refined");
  EXPECT_EQ(data->tracks[0].position_error_mm.size(), 45u);
  ASSERT_TRUE(data->tracks[0].evaluation);
  EXPECT_GT(data->tracks[0].evaluation->position_error_mm, 1.0);

  for (const char* name : {"trajectory", "depth", "map_depth", "map_colour", "position_error",
                           "rotation_error", "image_residuals", "residuals"}) {
    const fs::path png = out / (std::string(name) + ".png");
    const cv::Mat image = cv::imread(png.string());
    ASSERT_FALSE(image.empty()) << png;
    EXPECT_GT(image.cols, 390);
    EXPECT_TRUE(fs::exists(out / (std::string(name) + ".svg"))) << name;
  }
  const auto html = ReadWholeFile(out / "index.html");
  ASSERT_TRUE(html);
  EXPECT_THAT(*html, HasSubstr("port.distance_m"));
  EXPECT_THAT(*html, HasSubstr("standard deviation"));
  EXPECT_THAT(*html, HasSubstr("<li>a bent map &amp; more</li>"));
  EXPECT_THAT(*html, HasSubstr("Accuracy against the ground truth"));
  EXPECT_THAT(*html, HasSubstr("Alignment: rotation and translation."));
  EXPECT_THAT(*html, ::testing::Not(HasSubstr("href=\"http")));
}

TEST(ReportTest, ResidualsAreThoseOfTheTrueProjection) {
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteModel(Survey(), folder.path() / "model"));
  const auto data = ReadReportData({folder.path() / "model", "", "", std::nullopt});
  ASSERT_TRUE(data) << ToString(data.error());
  double squares = 0.0;
  for (const double error : data->residuals_px) squares += error * error;
  const double variance = squares / (2.0 * static_cast<double>(data->residuals_px.size()));
  EXPECT_NEAR(std::sqrt(variance), kPixelNoise, 0.01);
  EXPECT_TRUE(data->truth.empty());
}

TEST(ReportTest, ASimilarityIsTakenOutWhereTheWorldIsNotMetric) {
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteModel(Survey(), folder.path() / "truth"));
  Model other = Survey();
  other.rig.world.frame = WorldFrame::kFirstCamera;
  other.rig.world.scale_is_metric = false;
  // world = 2 * truth, turned and moved.
  const Rigid3 turn(ExpSo3(Vec3(0.3, -0.5, 1.0)), Vec3(4.0, -2.0, 9.0));
  for (ModelImage& image : other.images) {
    const Rigid3 pose = image.camera_from_world.Inverse();
    image.camera_from_world =
        Rigid3(turn.rotation * pose.rotation, turn * (2.0 * pose.translation)).Inverse();
  }
  for (ModelPoint& point : other.points) point.xyz = turn * (2.0 * point.xyz);
  ASSERT_TRUE(WriteModel(other, folder.path() / "model"));
  const auto data =
      ReadReportData({folder.path() / "model", "", folder.path() / "truth", std::nullopt});
  ASSERT_TRUE(data) << ToString(data.error());
  EXPECT_EQ(data->alignment, Alignment::kSim3);
  EXPECT_TRUE(data->is_ned);
  for (const double error : data->tracks[0].position_error_mm) EXPECT_LT(error, 1e-3);
  for (const double error : data->tracks[0].rotation_error_deg) EXPECT_LT(error, 1e-5);
  const Model truth = Survey();
  EXPECT_LT((data->points[7] - truth.points[7].xyz).norm(), 1e-6);
}

TEST(ReportTest, BadInputIsNamed) {
  const TemporaryFolder folder;
  const auto missing = WriteReport({folder.path() / "none", "", "", std::nullopt}, folder.path());
  ASSERT_FALSE(missing);
  EXPECT_THAT(ToString(missing.error()), HasSubstr("none"));
  ASSERT_TRUE(WriteModel(Survey(), folder.path() / "model"));
  ASSERT_TRUE(WriteFileAtomically(folder.path() / "model" / "report.json", "{broken"));
  const auto broken = ReadReportData({folder.path() / "model", "", "", std::nullopt});
  ASSERT_FALSE(broken);
  EXPECT_THAT(broken.error().file, HasSubstr("report.json"));
}

}  // namespace
}  // namespace rsfm
