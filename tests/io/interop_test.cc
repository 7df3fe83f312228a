// Camera files of other programs, out and in: every lens behind every port keeps every bit; cut and
// garbled files are refused with file, place, field and fix.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rsfm/base/rng.h"
#include "rsfm/io/atomic_output.h"
#include "rsfm/io/calibmar.h"
#include "rsfm/io/colmap_cameras.h"
#include "rsfm/io/rig.h"
#include "rsfm/refraction/any_camera.h"
#include "tests/support/malloc_trap.h"
#include "tests/support/temporary_folder.h"

namespace rsfm {
namespace {

using ::testing::HasSubstr;

// Lens parameters that no short decimal has, mild enough for every model.
CameraConfig MakeCamera(LensModel lens, PortType type, Rng* rng) {
  CameraConfig camera;
  camera.lens = lens;
  camera.width = 1920;
  camera.height = 1080;
  const int num_focal = NumFocalLengths(lens);
  for (int i = 0; i < NumLensParams(lens); ++i) {
    const double value = i < num_focal       ? rng->Uniform(900.0, 1100.0)
                         : i < num_focal + 2 ? rng->Uniform(500.0, 900.0)
                         : lens == LensModel::kEucm || lens == LensModel::kFov
                             ? rng->Uniform(0.5, 0.9)
                             : rng->Uniform(-0.01, 0.01);
    EXPECT_TRUE(camera.lens_params.TryPushBack(value));
  }
  PortConfig& port = camera.port;
  port.type = type;
  if (type == PortType::kNone) return camera;
  port.normal = Vec3(rng->Uniform(-0.2, 0.2), rng->Uniform(-0.2, 0.2), 1.0).normalized();
  port.distance_m = rng->Uniform(0.001, 0.05);
  port.center_m = Vec3(rng->Uniform(-0.01, 0.01), rng->Uniform(-0.01, 0.01), -0.01 / 3.0);
  port.radius_m = rng->Uniform(0.05, 0.07);
  port.thickness_m = rng->Uniform(0.002, 0.2);
  port.index_air = rng->Uniform(1.0, 1.001);
  port.index_glass = rng->Uniform(1.45, 1.8);
  port.index_water = rng->Uniform(1.32, 1.35);
  return camera;
}

std::vector<CameraConfig> AllCameras() {
  Rng rng(20);
  std::vector<CameraConfig> cameras;
  for (const LensModel lens : AllLensModels()) {
    for (const PortType type : {PortType::kNone, PortType::kFlat, PortType::kDome}) {
      cameras.push_back(MakeCamera(lens, type, &rng));
      EXPECT_TRUE(AnyCamera::Create(cameras.back())) << ToString(lens) << ToString(type);
    }
  }
  return cameras;
}

void ExpectSameLens(const CameraConfig& a, const CameraConfig& b) {
  EXPECT_EQ(a.lens, b.lens);
  EXPECT_EQ(a.width, b.width);
  EXPECT_EQ(a.height, b.height);
  ASSERT_EQ(a.lens_params.size(), b.lens_params.size());
  for (std::size_t i = 0; i < a.lens_params.size(); ++i)
    EXPECT_EQ(a.lens_params[i], b.lens_params[i]) << ToString(a.lens) << " " << i;
}

void ExpectSame(const CameraConfig& a, const CameraConfig& b) {
  ExpectSameLens(a, b);
  ASSERT_EQ(a.port.type, b.port.type);
  if (a.port.type == PortType::kNone) return;
  EXPECT_EQ(a.port.Params(), b.port.Params()) << ToString(a.lens);
}

std::vector<ModelCamera> Numbered(const std::vector<CameraConfig>& configs) {
  std::vector<ModelCamera> cameras;
  for (const CameraConfig& config : configs)
    cameras.push_back({static_cast<std::uint32_t>(cameras.size() + 7), config});
  return cameras;
}

TEST(InteropTest, CalibmarKeepsEveryLensAndPort) {
  for (const CameraConfig& camera : AllCameras()) {
    const auto text = FormatCalibmar(camera);
    ASSERT_TRUE(text) << ToString(text.error());
    const auto rig = ParseRig(*text, "calibration.yaml");
    ASSERT_TRUE(rig) << ToString(rig.error()) << "\n" << *text;
    ExpectSame(camera, rig->camera);
  }
}

// What a format has no place for is refused, never dropped.
TEST(InteropTest, LayersAreNotLostOnTheWay) {
  const TemporaryFolder folder;
  Rng rng(5);
  Model model;
  model.rig.camera = MakeCamera(LensModel::kPinhole, PortType::kFlat, &rng);
  ASSERT_TRUE(model.rig.camera.port.outer_layers.TryPushBack({0.002, 1.49}));
  model.cameras = {{1, model.rig.camera}};
  EXPECT_EQ(FormatCalibmar(model.rig.camera).error().field, "port.layers");
  for (const ModelFormat format :
       {ModelFormat::kColmapUnderwater, ModelFormat::kColmapUnderwaterBinary}) {
    const IoStatus written = WriteModel(model, folder.path() / "model", format);
    ASSERT_FALSE(written);
    EXPECT_EQ(written.error().field, "port.layers");
    EXPECT_THAT(written.error().fix, HasSubstr("colmap-txt"));
  }
  ASSERT_TRUE(WriteModel(model, folder.path() / "model", ModelFormat::kColmapText));
  const auto back = ReadModel(folder.path() / "model");
  ASSERT_TRUE(back) << ToString(back.error());
  ASSERT_EQ(back->cameras[0].config.port.outer_layers.size(), 1u);
  EXPECT_EQ(back->cameras[0].config.port.outer_layers[0].index, 1.49);
  // Cameras that differ in a layer alone do not fit one rig.yaml.
  model.cameras.push_back(model.cameras[0]);
  model.cameras[1].id = 2;
  model.cameras[1].config.port.outer_layers[0].index = 1.5;
  EXPECT_FALSE(WriteModel(model, folder.path() / "model", ModelFormat::kColmapText));
}

TEST(InteropTest, RigYamlKeepsEveryLensAndPort) {
  for (const CameraConfig& camera : AllCameras()) {
    const auto rig = ParseRig(FormatCamera(camera), "rig.yaml");
    ASSERT_TRUE(rig) << ToString(rig.error());
    ExpectSame(camera, rig->camera);
  }
}

// The example of calibmar's own manual, with its comments.
TEST(InteropTest, ReadsTheExampleOfCalibmarsManual) {
  const auto rig = ParseRig(R"(model: OPENCV
# fx, fy, cx, cy, k1, k2, p1, p2
parameters: [705.391983, 705.210233, 963.440447, 604.968632, -0.105541, 0.066014, 0.001093, -8.6e-05]
non_svp_model: FLATPORT
# Nx, Ny, Nz, int_dist, int_thick, na, ng, nw (Note that [Nx, Ny, Nz] must be unit vector)
non_svp_parameters: [0.01311427226, -0.004460945556, 0.9999040533, 0.02531637365, 0.01, 1, 1.49, 1.333]
# non_svp_est_std_dev: 0.001294740237, 0.001435687642, 1.84569193e-05, 0.0005963799373, 0, 0, 0, 0
width: 1920
height: 1200
# overall_rms: 0.8004862862
# target: chessboard, 7, 8, 0.040000
)",
                            "calibration.yaml");
  ASSERT_TRUE(rig) << ToString(rig.error());
  EXPECT_EQ(rig->camera.port.distance_m, 0.02531637365);
  EXPECT_TRUE(AnyCamera::Create(rig->camera));
  const auto air = ParseRig(
      "model: PINHOLE\nparameters: [700, 700, 320, 240]\nnon_svp_model: NONE\n"
      "non_svp_parameters: []\nwidth: 640\nheight: 480\n",
      "calibration.yaml");
  ASSERT_TRUE(air) << ToString(air.error());
  EXPECT_EQ(air->camera.port.type, PortType::kNone);
}

TEST(InteropTest, ColmapFilesKeepEveryLensAndPort) {
  const std::vector<ModelCamera> cameras = Numbered(AllCameras());
  for (const bool with_port : {false, true}) {
    const auto text = ParseColmapCamerasText(FormatColmapCamerasText(cameras, with_port), "t");
    const auto binary =
        ParseColmapCamerasBinary(FormatColmapCamerasBinary(cameras, with_port), "b");
    ASSERT_TRUE(text) << ToString(text.error());
    ASSERT_TRUE(binary) << ToString(binary.error());
    for (const auto& back : {*text, *binary}) {
      ASSERT_EQ(back.size(), cameras.size());
      for (std::size_t i = 0; i < cameras.size(); ++i) {
        EXPECT_EQ(back[i].id, cameras[i].id);
        if (with_port) {
          ExpectSame(cameras[i].config, back[i].config);
        } else {
          ExpectSameLens(cameras[i].config, back[i].config);
          EXPECT_EQ(back[i].config.port.type, PortType::kNone);
        }
      }
    }
  }
}

// One camera at a time, through a file, as a camera file is given to the tools.
TEST(InteropTest, EveryFormatIsACameraFile) {
  const TemporaryFolder folder;
  for (const CameraConfig& camera : AllCameras()) {
    const std::vector<ModelCamera> one = Numbered({camera});
    const std::pair<const char*, std::string> files[] = {
        {"cameras.txt", FormatColmapCamerasText(one, true)},
        {"cameras.bin", FormatColmapCamerasBinary(one, true)},
        {"calibration.yaml", *FormatCalibmar(camera)}};
    for (const auto& [name, content] : files) {
      ASSERT_TRUE(WriteFileAtomically(folder.path() / name, content));
      const auto rig = ReadRig(folder.path() / name);
      ASSERT_TRUE(rig) << ToString(rig.error());
      ExpectSame(camera, rig->camera);
    }
  }
}

TEST(InteropTest, EveryCutOfABinaryFileNamesCameraByteAndField) {
  Rng rng(3);
  const std::vector<ModelCamera> cameras =
      Numbered({MakeCamera(LensModel::kOpenCV, PortType::kFlat, &rng),
                MakeCamera(LensModel::kPinhole, PortType::kDome, &rng)});
  for (const bool with_port : {false, true}) {
    const std::string whole = FormatColmapCamerasBinary(cameras, with_port);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      const auto cut = ParseColmapCamerasBinary(whole.substr(0, size), "my cameras.bin");
      ASSERT_FALSE(cut) << size;
      EXPECT_EQ(cut.error().file, "my cameras.bin");
      EXPECT_THAT(cut.error().problem, HasSubstr("cut off"));
      EXPECT_THAT(cut.error().problem, HasSubstr(", at byte "));
      EXPECT_EQ(ExitCode(cut.error()), 2);
      EXPECT_FALSE(cut.error().fix.empty());
    }
  }
  const std::string whole = FormatColmapCamerasBinary(cameras, true);
  const auto in_port = ParseColmapCamerasBinary(whole.substr(0, 8 + 24 + 64 + 4 + 20), "c");
  EXPECT_EQ(in_port.error().field, "camera 1 REFRAC_PARAMS");
  EXPECT_THAT(in_port.error().problem, HasSubstr("at byte 116"));
  const auto in_lens = ParseColmapCamerasBinary(whole.substr(0, whole.size() - 68 - 10), "c");
  EXPECT_EQ(in_lens.error().field, "camera 2 PARAMS");
}

struct BadLine {
  const char* text;
  const char* field;
  const char* problem;
  const char* fix;
};

TEST(InteropTest, BadLinesOfCamerasTxtNameLineFieldAndFix) {
  const BadLine cases[] = {
      {"1 PINHOLE 640", "", "is not a camera", "CAMERA_ID MODEL"},
      {"0 PINHOLE 640 480 5 5 3 2", "CAMERA_ID", "'0' is not an id", "over 0"},
      {"x PINHOLE 640 480 5 5 3 2", "CAMERA_ID", "'x' is not an id", "over 0"},
      {"1 PINHOL 640 480 5 5 3 2", "MODEL", "'PINHOL' is not a lens model", "PINHOLE"},
      {"1 PINHOLE 640 0 5 5 3 2", "WIDTH HEIGHT", "no image size", "pixels"},
      {"1 PINHOLE 640 4e9 5 5 3 2", "WIDTH HEIGHT", "no image size", "pixels"},
      {"1 PINHOLE 640 480 5 5 3", "PARAMS", "has 3 elements", "fx fy cx cy"},
      {"1 PINHOLE 640 480 5 5 nan 3", "PARAMS", "'nan' is not a finite number", "fx fy cx cy"},
      {"1 PINHOLE 640 480 -5 5 3 2", "PARAMS", "not positive", "pixels"},
      {"1 PINHOLE 640 480 5 5 3 2 9", "port", "'9' is not a port", "FLATPORT or DOMEPORT"},
      {"1 PINHOLE 640 480 5 5 3 2 FLATPORT 0 0 1", "FLATPORT", "has 3 parameters", "eight"},
      {"1 PINHOLE 640 480 5 5 3 2 FLATPORT 0 0 1 0.1 0.1 1 x 1.3", "FLATPORT", "'x' is not",
       "eight numbers"},
      {"1 PINHOLE 640 480 5 5 3 2 FLATPORT 0 0 2 0.1 0.1 1 1.5 1.3", "FLATPORT normal",
       "not a unit vector", "[0, 0, 1]"},
      {"1 PINHOLE 640 480 5 5 3 2 FLATPORT 0 0 1 0.1 -0.1 1 1.5 1.3", "FLATPORT thickness_m",
       "out of range: -0.1", "metres"},
      {"1 PINHOLE 640 480 5 5 3 2 DOMEPORT 0 0 1 0.1 0.1 1 1.5 1.3", "DOMEPORT center_m",
       "outside its dome", "nearer"},
      {"1 PINHOLE 640 480 5 5 3 2 DOMEPORT 0 0 0 0.1 0.1 1 1.5 0.3", "DOMEPORT index_water",
       "out of range: 0.3", "from 1"},
  };
  for (const BadLine& bad : cases) {
    const auto cameras =
        ParseColmapCamerasText(std::string("# list\n\n") + bad.text + "\n", "c.txt");
    ASSERT_FALSE(cameras) << bad.text;
    EXPECT_EQ(cameras.error().file, "c.txt");
    EXPECT_EQ(cameras.error().line, 3);
    EXPECT_EQ(cameras.error().field, bad.field) << bad.text;
    EXPECT_THAT(cameras.error().problem, HasSubstr(bad.problem)) << bad.text;
    EXPECT_THAT(cameras.error().fix, HasSubstr(bad.fix)) << bad.text;
  }
}

TEST(InteropTest, BadCalibmarFilesNameLineFieldAndFix) {
  const std::string good =
      "model: PINHOLE\nparameters: [700, 700, 320, 240]\nnon_svp_model: DOMEPORT\n"
      "non_svp_parameters: [0, 0, 0.01, 0.05, 0.007, 1, 1.5, 1.33]\nwidth: 640\nheight: 480\n";
  ASSERT_TRUE(ParseRig(good, "c.yaml"));
  const struct {
    const char* from;
    const char* to;
    int line;
    const char* field;
    const char* problem;
  } cases[] = {
      {"PINHOLE", "PINHOL", 1, "model", "not a lens model"},
      {"[700, 700, 320, 240]", "[700, 700, 320]", 2, "parameters", "3 elements"},
      {"[700, 700, 320, 240]", "[700, 700, x, 240]", 2, "parameters", "element 3 is 'x'"},
      {"DOMEPORT", "CONEPORT", 3, "non_svp_model", "not a port"},
      {"0.05, 0.007", "0.05", 4, "non_svp_parameters", "7 elements"},
      {"0.05, 0.007", "0.005, 0.007", 4, "non_svp_parameters: center_m", "outside its dome"},
      {"1.33", ".inf", 4, "non_svp_parameters", "not finite"},
      {"width: 640\n", "", 1, "width", "missing"},
      {"width: 640", "width: 640\ncolour: red", 6, "colour", "not a known field"},
  };
  for (const auto& bad : cases) {
    std::string text = good;
    text.replace(text.find(bad.from), std::string(bad.from).size(), bad.to);
    const auto rig = ParseRig(text, "c.yaml");
    ASSERT_FALSE(rig) << text;
    EXPECT_EQ(rig.error().file, "c.yaml");
    EXPECT_EQ(rig.error().line, bad.line) << ToString(rig.error());
    EXPECT_EQ(rig.error().field, bad.field) << ToString(rig.error());
    EXPECT_THAT(rig.error().problem, HasSubstr(bad.problem));
    EXPECT_FALSE(rig.error().fix.empty());
  }
}

// What a file of some kilobytes may make a reader take at most.
constexpr std::size_t kMaxBytes = std::size_t{64} << 20;

std::string Mutated(const std::string& good, const std::string& other, Rng* rng) {
  std::string bytes = good;
  const auto place = [&] { return rng->Index(static_cast<std::uint32_t>(bytes.size() + 1)); };
  for (int k = 0, edits = 1 + static_cast<int>(rng->Index(4)); k < edits; ++k) {
    switch (rng->Index(6)) {
      case 0:  // a byte
        if (!bytes.empty()) {
          bytes[rng->Index(static_cast<std::uint32_t>(bytes.size()))] =
              static_cast<char>(rng->Index(256));
        }
        break;
      case 1:  // a bit
        if (!bytes.empty()) {
          char& byte = bytes[rng->Index(static_cast<std::uint32_t>(bytes.size()))];
          byte = static_cast<char>(byte ^ (1 << rng->Index(8)));
        }
        break;
      case 2:  // cut
        bytes.resize(place());
        break;
      case 3: {  // a piece gone
        const std::size_t at = place();
        bytes.erase(at, rng->Index(16));
        break;
      }
      case 4: {  // a piece twice, or from elsewhere
        const std::size_t from = rng->Index(static_cast<std::uint32_t>(other.size()));
        bytes.insert(place(), other.substr(from, rng->Index(40)));
        break;
      }
      default: {  // extremes of a number
        const char* const words[] = {"\xff\xff\xff\xff\xff\xff\xff\xff",
                                     "\x7f\xf0",
                                     "1e308",
                                     "-1",
                                     "nan",
                                     "[[[[[[[[",
                                     "&a [*a, *a]",
                                     "99999999999999999999",
                                     ": "};
        bytes.insert(place(), words[rng->Index(9)]);
      }
    }
  }
  return bytes;
}

template <class Parse>
void Fuzz(const std::string& good, int trials, std::uint64_t seed, Parse&& parse) {
  Rng rng(seed);
  std::string other = good;
  for (int trial = 0; trial < trials; ++trial) {
    const std::string bytes = Mutated(good, other, &rng);
    const MallocTrap trap;
    parse(bytes);
    ASSERT_LT(trap.bytes(), kMaxBytes) << trial;
  }
}

// Whatever is taken is a camera that can be; whatever is refused says why.
void ExpectSound(const CameraConfig& config) {
  for (const double value : config.lens_params) EXPECT_TRUE(std::isfinite(value));
  for (const double value : config.port.Params()) EXPECT_TRUE(std::isfinite(value));
  EXPECT_GT(config.width, 0);
  EXPECT_GT(config.height, 0);
}

void ExpectExplained(const Diagnostic& problem) {
  EXPECT_EQ(problem.file, "fuzzed");
  EXPECT_FALSE(problem.problem.empty());
  EXPECT_FALSE(problem.fix.empty()) << ToString(problem);
  EXPECT_EQ(ExitCode(problem), 2) << ToString(problem);
}

TEST(InteropFuzzTest, ColmapCameras) {
  Rng rng(8);
  const std::vector<ModelCamera> cameras =
      Numbered({MakeCamera(LensModel::kOpenCV, PortType::kFlat, &rng),
                MakeCamera(LensModel::kRadialFisheye, PortType::kDome, &rng),
                MakeCamera(LensModel::kPinhole, PortType::kNone, &rng)});
  const auto check = [](const IoExpected<std::vector<ModelCamera>>& result) {
    if (!result) return ExpectExplained(result.error());
    for (const ModelCamera& camera : *result) ExpectSound(camera.config);
  };
  for (const bool with_port : {false, true}) {
    Fuzz(FormatColmapCamerasBinary(cameras, with_port), 2000, 1,
         [&](const std::string& bytes) { check(ParseColmapCamerasBinary(bytes, "fuzzed")); });
    Fuzz(FormatColmapCamerasText(cameras, with_port), 2000, 2,
         [&](const std::string& bytes) { check(ParseColmapCamerasText(bytes, "fuzzed")); });
  }
}

TEST(InteropFuzzTest, CalibmarAndRigYaml) {
  Rng rng(9);
  const CameraConfig camera = MakeCamera(LensModel::kOpenCV, PortType::kDome, &rng);
  for (const std::string& good : {*FormatCalibmar(camera), FormatCamera(camera)}) {
    Fuzz(good, 1000, 3, [&](const std::string& bytes) {
      const auto rig = ParseRig(bytes, "fuzzed");
      if (!rig) return ExpectExplained(rig.error());
      ExpectSound(rig->camera);
    });
  }
}

}  // namespace
}  // namespace rsfm
