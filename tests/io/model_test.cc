// Models: COLMAP's text and binary files out and in, with the port beside; damage is found.
#include "rsfm/io/model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rsfm/base/rng.h"
#include "rsfm/base/so3.h"
#include "rsfm/io/atomic_output.h"
#include "rsfm/io/trajectory.h"
#include "tests/support/temporary_folder.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

Model SampleModel() {
  Rng rng(11);
  Model model;
  CameraConfig camera;
  camera.lens = LensModel::kOpenCV;
  camera.width = 800;
  camera.height = 600;
  for (const double v : {700.1, 701.2, 400.0, 300.5, -0.1, 0.02, 1e-4, -1.0 / 3e4}) {
    EXPECT_TRUE(camera.lens_params.TryPushBack(v));
  }
  camera.port.type = PortType::kFlat;
  camera.port.distance_m = 0.02;
  camera.port.thickness_m = 0.01;
  model.cameras = {{3, camera}};
  model.rig.camera = camera;
  model.rig.world.frame = WorldFrame::kNed;
  model.rig.world.origin = Geodetic{54.0, 10.0, 2.0};
  const auto vector = [&] { return Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian()); };
  for (int i = 0; i < 3; ++i) {
    ModelImage image;
    image.name = "image " + std::to_string(i) + ".jpg";  // with a blank
    image.utime = 1'600'000'000'000'000 + 500'000 * i;
    image.camera_from_world = Rigid3(ExpSo3(vector()), vector());
    model.images.push_back(image);
  }
  for (int p = 0; p < 5; ++p) {
    ModelPoint point;
    point.xyz = vector();
    point.rgb = {static_cast<std::uint8_t>(p), 100, 255};
    point.error_px = 0.5 / (p + 1);
    for (int i = 0; i < 3; ++i) {
      if (i == p % 3) continue;
      point.track.push_back({i, static_cast<std::int32_t>(model.images[i].features.size())});
      model.images[i].features.emplace_back(800 * rng.Uniform(), 600 * rng.Uniform());
      model.images[i].points.push_back(p);
      model.images[i].features.emplace_back(1.25, 2.5);  // without a point
      model.images[i].points.push_back(kNoPoint);
    }
    model.points.push_back(point);
  }
  EXPECT_TRUE(Validate(model));
  return model;
}

void ExpectSame(const Model& a, const Model& b) {
  ASSERT_EQ(a.images.size(), b.images.size());
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.images.size(); ++i) {
    EXPECT_EQ(a.images[i].name, b.images[i].name);
    EXPECT_EQ(a.images[i].utime, b.images[i].utime);
    EXPECT_EQ(a.images[i].features, b.images[i].features);
    EXPECT_EQ(a.images[i].points, b.images[i].points);
    EXPECT_EQ(a.images[i].camera_from_world.rotation.coeffs(),
              b.images[i].camera_from_world.rotation.coeffs());
    EXPECT_EQ(a.images[i].camera_from_world.translation, b.images[i].camera_from_world.translation);
  }
  for (std::size_t p = 0; p < a.points.size(); ++p) {
    EXPECT_EQ(a.points[p].xyz, b.points[p].xyz);
    EXPECT_EQ(a.points[p].rgb, b.points[p].rgb);
    EXPECT_EQ(a.points[p].error_px, b.points[p].error_px);
    EXPECT_EQ(a.points[p].track.size(), b.points[p].track.size());
  }
  EXPECT_EQ(a.cameras[0].config.port.Params(), b.cameras[0].config.port.Params());
  EXPECT_EQ(a.cameras[0].config.port.type, b.cameras[0].config.port.type);
}

class ModelTest : public ::testing::Test {
 protected:
  TemporaryFolder folder_;
  fs::path path_ = folder_.path() / "model";
};

TEST_F(ModelTest, EveryFormatReadsBackExactly) {
  const Model model = SampleModel();
  for (const ModelFormat format :
       {ModelFormat::kColmapBinary, ModelFormat::kColmapText, ModelFormat::kColmapUnderwater,
        ModelFormat::kColmapUnderwaterBinary}) {
    ASSERT_TRUE(WriteModel(model, path_, format));
    const auto back = ReadModel(path_);
    ASSERT_TRUE(back) << ToString(back.error());
    EXPECT_TRUE(Validate(*back));
    ExpectSame(model, *back);
    EXPECT_EQ(back->rig.world.frame, WorldFrame::kNed);
    ASSERT_TRUE(back->rig.world.origin);
    EXPECT_EQ(back->cameras[0].id, 3u);
  }
}

TEST_F(ModelTest, UnderwaterColumnsHoldThePortWithoutRigYaml) {
  ASSERT_TRUE(WriteModel(SampleModel(), path_, ModelFormat::kColmapUnderwater));
  EXPECT_THAT(*ReadWholeFile(path_ / "cameras.txt"),
              HasSubstr(" FLATPORT 0 0 1 0.02 0.01 1 1.52 1.334"));
  fs::remove(path_ / "rig.yaml");
  const auto back = ReadModel(path_);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->rig.camera.port.type, PortType::kFlat);
  const fs::path second = folder_.path() / "binary";
  ASSERT_TRUE(WriteModel(SampleModel(), second, ModelFormat::kColmapUnderwaterBinary));
  fs::remove(second / "rig.yaml");
  const auto binary = ReadModel(second);
  ASSERT_TRUE(binary) << ToString(binary.error());
  EXPECT_EQ(binary->rig.camera.port.Params(), back->rig.camera.port.Params());
}

TEST_F(ModelTest, EveryTruncationOfTheBinaryFilesIsFound) {
  ASSERT_TRUE(WriteModel(SampleModel(), path_));
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const std::string bytes = *ReadWholeFile(path_ / name);
    for (std::size_t size = 0; size < bytes.size(); size += 7) {
      ASSERT_TRUE(WriteFileAtomically(path_ / name, bytes.substr(0, size)));
      const auto model = ReadModel(path_);
      ASSERT_FALSE(model) << name << " " << size;
      EXPECT_EQ(ExitCode(model.error()), 2);
      EXPECT_THAT(model.error().file, HasSubstr(name));
    }
    ASSERT_TRUE(WriteFileAtomically(path_ / name, bytes));
  }
}

TEST_F(ModelTest, RandomDamageIsHarmless) {
  ASSERT_TRUE(WriteModel(SampleModel(), path_));
  Rng rng(5);
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const std::string good = *ReadWholeFile(path_ / name);
    for (int trial = 0; trial < 100; ++trial) {
      std::string bytes = good;
      for (int k = 0; k < 3; ++k) {
        bytes[rng.Index(static_cast<std::uint32_t>(bytes.size()))] =
            static_cast<char>(rng.Index(256));
      }
      ASSERT_TRUE(WriteFileAtomically(path_ / name, bytes));
      const auto model = ReadModel(path_);
      if (model) {
        EXPECT_TRUE(Validate(*model));
      }
    }
    ASSERT_TRUE(WriteFileAtomically(path_ / name, good));
  }
}

TEST_F(ModelTest, FilesThatDoNotBelongTogetherAreRefused) {
  ASSERT_TRUE(WriteModel(SampleModel(), path_, ModelFormat::kColmapText));
  ASSERT_TRUE(WriteFileAtomically(path_ / "points3D.txt", "# none\n"));
  const auto model = ReadModel(path_);
  ASSERT_FALSE(model);
  EXPECT_THAT(model.error().fix, HasSubstr("do not belong together"));
}

TEST_F(ModelTest, TextErrorsNameTheLine) {
  ASSERT_TRUE(WriteModel(SampleModel(), path_, ModelFormat::kColmapText));
  const std::string points = *ReadWholeFile(path_ / "points3D.txt");
  ASSERT_TRUE(WriteFileAtomically(path_ / "points3D.txt", points + "9 1 2 nan 0 0 0 1\n"));
  const auto model = ReadModel(path_);
  ASSERT_FALSE(model);
  EXPECT_EQ(model.error().line, 9);
  EXPECT_EQ(model.error().field, "X Y Z");
}

TEST_F(ModelTest, NoModelAtAll) {
  const auto model = ReadModel(folder_.path());
  ASSERT_FALSE(model);
  EXPECT_EQ(ExitCode(model.error()), 2);
}

TEST_F(ModelTest, InconsistentModelsAreNotWritten) {
  Model model = SampleModel();
  model.points[0].track[0].feature = 999;
  EXPECT_FALSE(WriteModel(model, path_));
  EXPECT_FALSE(fs::exists(path_));
}

TEST_F(ModelTest, TumReadsBack) {
  const auto poses = TrajectoryOf(SampleModel());
  ASSERT_TRUE(WriteFileAtomically(folder_.path() / "t.tum", FormatTum(poses)));
  const auto back = ReadTum(folder_.path() / "t.tum");
  ASSERT_TRUE(back) << ToString(back.error());
  ASSERT_EQ(back->size(), poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ((*back)[i].utime, poses[i].utime);
    EXPECT_EQ((*back)[i].world_from_camera.translation, poses[i].world_from_camera.translation);
  }
  // Before 1970, as a log that begins at 0 has it.
  const std::vector<TrajectoryPose> early = {{-500'000, "", Rigid3()}, {-2'000'001, "", Rigid3()}};
  ASSERT_TRUE(WriteFileAtomically(folder_.path() / "t.tum", FormatTum(early)));
  const auto before = ReadTum(folder_.path() / "t.tum");
  ASSERT_TRUE(before) << ToString(before.error());
  EXPECT_EQ((*before)[0].utime, -500'000);
  EXPECT_EQ((*before)[1].utime, -2'000'001);
  ASSERT_TRUE(WriteFileAtomically(folder_.path() / "t.tum", "1 2 3 4 0 0 0 nan\n"));
  const auto bad = ReadTum(folder_.path() / "t.tum");
  ASSERT_FALSE(bad);
  EXPECT_EQ(bad.error().line, 1);
}

TEST_F(ModelTest, MapsNeedAPlaceOnEarth) {
  Model model = SampleModel();
  const auto poses = TrajectoryOf(model);
  const auto kml = FormatKml(poses, model.rig.world, "a & b");
  ASSERT_TRUE(kml);
  EXPECT_THAT(*kml, HasSubstr("<name>a &amp; b</name>"));
  EXPECT_THAT(*kml, HasSubstr("\n10.0000"));
  EXPECT_THAT(*kml, HasSubstr(",54.0000"));
  EXPECT_TRUE(FormatGeoJson(poses, model.rig.world, "x"));
  model.rig.world.scale_is_metric = false;
  EXPECT_FALSE(FormatKml(poses, model.rig.world, "x"));
  model.rig.world = World();
  EXPECT_FALSE(FormatGeoJson(poses, model.rig.world, "x"));
}

TEST_F(ModelTest, PlyHoldsPointsAndCameras) {
  const Model model = SampleModel();
  const std::string ply = FormatPly(model, TrajectoryOf(model));
  EXPECT_THAT(ply, HasSubstr("element vertex 8\n"));
  const std::size_t header = ply.find("end_header\n") + 11;
  EXPECT_EQ(ply.size() - header, 8u * (3 * 8 + 3));
}

}  // namespace
}  // namespace rsfm
