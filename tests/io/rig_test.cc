// rig.yaml and camera files: round trips, and every way in which one can be wrong.
#include "rsfm/io/rig.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "rsfm/io/atomic_output.h"
#include "rsfm/refraction/sea_water.h"
#include "tests/support/replaced.h"
#include "tests/support/temporary_folder.h"

namespace rsfm {
namespace {

using ::testing::HasSubstr;

constexpr const char* kFlat = R"(camera:
  model: OPENCV
  width: 1920
  height: 1280
  params: [1300, 1301, 960, 640, -0.1, 0.02, 0, 0.001]
port:
  type: flat
  normal: [0, 0, 1]
  distance_m: 0.02
  thickness_m: 0.007
  index_air: 1.0
  index_glass: 1.52
  index_water: 1.334
)";

constexpr const char* kDome = R"(camera:
  model: PINHOLE
  width: 1000
  height: 800
  params: [700, 700, 500, 400]
port:
  type: dome
  center_m: [0, 0, 0.003]
  radius_m: 0.05
  thickness_m: 0.007
  index_glass: 1.52
  index_water: 1.334
)";

TEST(RigTest, CameraAndPortAreACompleteFile) {
  const auto rig = ParseRig(kFlat, "rig.yaml");
  ASSERT_TRUE(rig) << ToString(rig.error());
  EXPECT_EQ(rig->camera.lens, LensModel::kOpenCV);
  EXPECT_EQ(rig->camera.width, 1920);
  EXPECT_EQ(rig->camera.height, 1280);
  ASSERT_EQ(rig->camera.lens_params.size(), 8u);
  EXPECT_EQ(rig->camera.lens_params[7], 0.001);
  EXPECT_EQ(rig->camera.port.type, PortType::kFlat);
  EXPECT_EQ(rig->camera.port.distance_m, 0.02);
  EXPECT_EQ(rig->camera.port.index_glass, 1.52);
  EXPECT_EQ(rig->world.frame, WorldFrame::kAuto);
  EXPECT_EQ(rig->bus.inputs.size(), 6u);
}

TEST(RigTest, WhatIsWrittenReadsBackTheSame) {
  Rig rig = *ParseRig(kDome, "dome.yaml");
  rig.camera.port.center_m = Vec3(0.1 / 3.0, -1e-17, 0.003);
  rig.body_from_camera = Rigid3(Quat(0.5, 0.5, 0.5, 0.5), Vec3(0.1, 0.2, 1.0 / 7.0));
  rig.sensors.dvl_in_body_m = Vec3(0.3, 0, 0.1);
  rig.world.frame = WorldFrame::kNed;
  rig.world.origin = Geodetic{54.3333333333333336, 10.1, -3.25};
  rig.world.scale_is_metric = false;
  rig.bus.lcm_url = "udpm://239.255.76.67:7667?ttl=1";
  rig.bus.inputs = {{"A \"quoted\" \\ name", InputType::kBotCorePose, Convention::kLibbot},
                    {"RSFM_NAV", InputType::kNav, Convention::kRsfm}};
  rig.bus.pose_channel = "MY_POSE";
  rig.mapper.rhythm = Rhythm::kVideo;
  rig.mapper.descriptor = DescriptorType::kAkaze;
  rig.mapper.seed = 1234567890123;
  rig.mapper.max_ratio = 0.1 + 0.2;
  ASSERT_TRUE(rig.mapper.mask.TryPushBack({-5, 0, 200, 40}));

  const auto back = ParseRig(FormatRig(rig), "written");
  ASSERT_TRUE(back) << ToString(back.error()) << FormatRig(rig);
  EXPECT_EQ(back->camera.port.center_m, rig.camera.port.center_m);
  EXPECT_EQ(back->body_from_camera.translation, rig.body_from_camera.translation);
  EXPECT_EQ(back->body_from_camera.rotation.coeffs(), rig.body_from_camera.rotation.coeffs());
  EXPECT_EQ(back->sensors.dvl_in_body_m, rig.sensors.dvl_in_body_m);
  EXPECT_EQ(back->world.frame, WorldFrame::kNed);
  ASSERT_TRUE(back->world.origin);
  EXPECT_EQ(back->world.origin->latitude_deg, rig.world.origin->latitude_deg);
  EXPECT_EQ(back->world.origin->height_m, -3.25);
  EXPECT_FALSE(back->world.scale_is_metric);
  EXPECT_EQ(back->bus.lcm_url, rig.bus.lcm_url);
  ASSERT_EQ(back->bus.inputs.size(), 2u);
  EXPECT_EQ(back->bus.inputs[0].channel, rig.bus.inputs[0].channel);
  EXPECT_EQ(back->bus.inputs[0].convention, Convention::kLibbot);
  EXPECT_EQ(back->bus.pose_channel, "MY_POSE");
  EXPECT_EQ(back->bus.status_channel, "RSFM_STATUS");
  EXPECT_EQ(back->mapper.rhythm, Rhythm::kVideo);
  EXPECT_EQ(back->mapper.descriptor, DescriptorType::kAkaze);
  EXPECT_EQ(back->mapper.seed, rig.mapper.seed);
  EXPECT_EQ(back->mapper.max_ratio, rig.mapper.max_ratio);
  ASSERT_EQ(back->mapper.mask.size(), 1u);
  EXPECT_EQ(back->mapper.mask[0].left, -5);
  EXPECT_EQ(FormatRig(*back), FormatRig(rig));
}

struct BadRig {
  const char* name;
  const char* from;  // in kFlat, or kDome where that has it
  const char* to;
  int line;
  const char* field;
  const char* problem;
  const char* fix;
};

void PrintTo(const BadRig& bad, std::ostream* out) { *out << bad.name; }

class BadRigTest : public ::testing::TestWithParam<BadRig> {};

TEST_P(BadRigTest, IsAnErrorThatNamesLineFieldAndFix) {
  const BadRig& bad = GetParam();
  const std::string good = std::string(kFlat).find(bad.from) != std::string::npos ? kFlat : kDome;
  const auto rig = ParseRig(Replaced(good, bad.from, bad.to), "my rig.yaml");
  ASSERT_FALSE(rig);
  EXPECT_EQ(rig.error().file, "my rig.yaml");
  EXPECT_EQ(rig.error().line, bad.line) << ToString(rig.error());
  EXPECT_EQ(rig.error().field, bad.field) << ToString(rig.error());
  EXPECT_THAT(rig.error().problem, HasSubstr(bad.problem));
  EXPECT_THAT(rig.error().fix, HasSubstr(bad.fix));
  EXPECT_EQ(ExitCode(rig.error()), 2);
}

INSTANTIATE_TEST_SUITE_P(
    All, BadRigTest,
    ::testing::Values(
        BadRig{"MissingModel", "  model: OPENCV\n", "", 2, "camera.model", "missing", "add"},
        BadRig{"MissingDistance", "  distance_m: 0.02\n", "", 7, "port.distance_m", "missing",
               "add"},
        BadRig{"UnknownField", "distance_m: 0.02", "distance_m: 0.02\n  distence_m: 0.03", 10,
               "port.distence_m", "not a known field", "did you mean 'distance_m'"},
        BadRig{"UnknownSection", "port:", "colour: red\nport:", 6, "colour", "not a known field",
               "known here: camera, port"},
        BadRig{"FieldTwice", "width: 1920", "width: 1920\n  width: 1921", 4, "camera.width",
               "given twice", "keep one"},
        BadRig{"MistypedWidth", "width: 1920", "width: wide", 3, "camera.width",
               "not a whole number", "give a whole number"},
        BadRig{"ZeroHeight", "height: 1280", "height: 0", 4, "camera.height", "out of range",
               "from 1"},
        BadRig{"UnknownModel", "OPENCV", "OPENVC", 2, "camera.model", "not a lens model", "OPENCV"},
        BadRig{"TooFewParams", "[1300, 1301, 960, 640,", "[1300, 960, 640,", 5, "camera.params",
               "7 elements", "fx"},
        BadRig{"ParamNotFinite", "-0.1", ".nan", 5, "camera.params", "not finite", "finite"},
        BadRig{"ParamIsAWord", "-0.1", "small", 5, "camera.params", "element 5 is 'small'", "list"},
        BadRig{"NegativeFocalLength", "1301", "-1301", 5, "camera.params", "not positive",
               "pixels"},
        BadRig{"NormalIsNotUnit", "[0, 0, 1]", "[0, 0, 1.00001]", 8, "port.normal",
               "not a unit vector", "give [0, 0, 1]"},
        BadRig{"NormalPointsBack", "[0, 0, 1]", "[0, 0, -1]", 8, "port.normal", "backwards",
               "z > 0"},
        BadRig{"NormalHasTwoElements", "[0, 0, 1]", "[0, 1]", 8, "port.normal", "2 elements",
               "three"},
        BadRig{"NormalIsNan", "[0, 0, 1]", "[0, .nan, 1]", 8, "port.normal", "not finite",
               "finite"},
        BadRig{"NegativeThickness", "thickness_m: 0.007", "thickness_m: -0.007", 10,
               "port.thickness_m", "out of range: -0.007", "metres from 0"},
        BadRig{"NegativeDistance", "distance_m: 0.02", "distance_m: -0.02", 9, "port.distance_m",
               "out of range", "metres from 0"},
        BadRig{"IndexBelowOne", "index_water: 1.334", "index_water: 0.9", 13, "port.index_water",
               "out of range: 0.9", "from 1"},
        BadRig{"IndexIsNan", "index_glass: 1.52\n  index_water", "index_glass: nan\n  index_water",
               12, "port.index_glass", "not finite", "from 1"},
        BadRig{"UnknownGlass", "index_glass: 1.52", "glass: granite", 12, "port.glass",
               "'granite' is not a glass", "BK7, fused_silica, sapphire or acrylic"},
        BadRig{"GlassTwice", "index_glass: 1.52", "glass: BK7\n  index_glass: 1.52", 13,
               "port.index_glass", "beside glass", "keep one"},
        BadRig{"InfraredLight", "index_glass: 1.52", "glass: BK7\n  wavelength_nm: 900", 13,
               "port.wavelength_nm", "out of range: 900", "400 to 700"},
        BadRig{"WaterWithoutSalinity", "index_water: 1.334",
               "water: {temperature_c: 8, depth_m: 2}", 13, "port.water.salinity_psu", "missing",
               "add"},
        BadRig{"FrozenWater", "index_water: 1.334",
               "water: {temperature_c: -4, salinity_psu: 35, depth_m: 2}", 13,
               "port.water.temperature_c", "out of range: -4", "0 to 30"},
        BadRig{"WaterAboveTheSurface", "index_water: 1.334",
               "water: {temperature_c: 4, salinity_psu: 35, depth_m: -2}", 13, "port.water.depth_m",
               "out of range: -2", "below the surface"},
        BadRig{"UnknownPort", "type: flat", "type: conical", 7, "port.type", "'conical'",
               "flat, dome or none"},
        BadRig{"CameraOutsideItsDome", "[0, 0, 0.003]", "[0, 0, 0.06]", 8, "port.center_m",
               "outside its dome", "nearer"},
        BadRig{"ZeroRadius", "radius_m: 0.05", "radius_m: 0", 9, "port.radius_m", "out of range",
               "over 0"},
        BadRig{"FlatFieldOnADome", "radius_m: 0.05", "radius_m: 0.05\n  distance_m: 0.1", 10,
               "port.distance_m", "not a known field", ""},
        BadRig{"PortIsAList", "port:\n  type: flat", "port: [1]\nport2:\n  type: flat", 6, "port",
               "not a mapping", "indented"},
        BadRig{"NotYaml", "params: [1300", "params: [[1300", 6, "", "not YAML", "repair"}),
    [](const auto& test) { return std::string(test.param.name); });

TEST(RigTest, AllProblemsAreListed) {
  std::string text = Replaced(kFlat, "width: 1920", "width: -1");
  text = Replaced(text, "thickness_m: 0.007", "thickness_m: -1");
  std::vector<Diagnostic> problems;
  EXPECT_FALSE(ParseRig(text, "rig.yaml", &problems));
  ASSERT_EQ(problems.size(), 2u);
  EXPECT_EQ(problems[0].field, "camera.width");
  EXPECT_EQ(problems[1].field, "port.thickness_m");
}

TEST(RigTest, ForeignTypesMustNameTheirConvention) {
  const std::string text =
      std::string(kFlat) + "bus:\n  inputs:\n    - {channel: POSE, type: bot_core.pose_t}\n";
  const auto rig = ParseRig(text, "rig.yaml");
  ASSERT_FALSE(rig);
  EXPECT_EQ(rig.error().field, "bus.inputs[0].convention");
  EXPECT_EQ(rig.error().line, 16);
  const auto acfr = [](const char* convention) {
    return ParseRig(std::string(kFlat) +
                        "bus:\n  inputs:\n    - {channel: NAV, type: acfrlcm.auv_acfr_nav_t, "
                        "convention: " +
                        convention + "}\n",
                    "rig.yaml");
  };
  ASSERT_TRUE(acfr("acfr"));
  EXPECT_EQ(acfr("acfr")->bus.inputs[0].type, InputType::kAcfrNav);
  ASSERT_FALSE(acfr("libbot"));
  EXPECT_EQ(acfr("libbot").error().fix, "give acfr");
}

TEST(RigTest, AChannelHasOneMeaning) {
  const auto problem = [](const std::string& bus) {
    const auto rig = ParseRig(std::string(kFlat) + "bus:\n" + bus, "rig.yaml");
    return rig ? Diagnostic() : rig.error();
  };
  const Diagnostic twice = problem(
      "  inputs:\n"
      "    - {channel: POSE, type: bot_core.pose_t, convention: libbot}\n"
      "    - {channel: POSE, type: bot_core.pose_t, convention: openhumanoids}\n");
  EXPECT_EQ(twice.field, "bus.inputs");
  EXPECT_THAT(twice.problem, HasSubstr("'POSE' is there twice"));
  const Diagnostic heard = problem("  pose_channel: RSFM_NAV\n");  // an input by default
  EXPECT_EQ(heard.field, "bus.pose_channel");
  EXPECT_EQ(heard.line, 15);
  EXPECT_EQ(problem("  pose_channel: RSFM_STATUS\n").field, "bus.status_channel");
  EXPECT_EQ(problem("  pose_channel: VISION\n").field, "");
}

TEST(RigTest, CaptureAndOnboardAreReadAndWritten) {
  const std::string text = std::string(kFlat) + R"(capture:
  device: /dev/rsfm-camera
  format: y10
  frame_rate_hz: 29.97
  exposure_us: 4000
  controls: {trigger_mode: 1, "0x009a0955": -3}
onboard:
  record_images: false
  image_quota_mb: 20000
  mapper_priority: 40
)";
  const auto rig = ParseRig(text, "rig.yaml");
  ASSERT_TRUE(rig) << ToString(rig.error());
  EXPECT_EQ(rig->capture.device, "/dev/rsfm-camera");
  EXPECT_EQ(rig->capture.format, PixelFormat::kY10);
  EXPECT_EQ(rig->capture.frame_rate_hz, 29.97);
  EXPECT_EQ(rig->capture.controls.at("trigger_mode"), 1);
  EXPECT_EQ(rig->capture.controls.at("0x009a0955"), -3);
  EXPECT_FALSE(rig->onboard.record_images);
  EXPECT_EQ(rig->onboard.image_quota_mb, 20000);
  EXPECT_EQ(rig->onboard.mapper_priority, 40);
  const auto again = ParseRig(FormatRig(*rig), "again.yaml");
  ASSERT_TRUE(again) << ToString(again.error()) << FormatRig(*rig);
  EXPECT_EQ(FormatRig(*again), FormatRig(*rig));
  EXPECT_EQ(again->capture.controls, rig->capture.controls);
  EXPECT_FALSE(again->onboard.record_images);
}

TEST(RigTest, CaptureAndOnboardOutOfRangeAreNamed) {
  const std::pair<const char*, const char*> cases[] = {
      {"capture:\n  num_buffers: 1\n", "capture.num_buffers"},
      {"capture:\n  exposure_us: -5\n", "capture.exposure_us"},
      {"capture:\n  format: rgb\n", "capture.format"},
      {"capture:\n  controls: {gain: high}\n", "capture.controls.gain"},
      {"capture:\n  shutter: 3\n", "capture.shutter"},
      {"onboard:\n  jpeg_quality: 101\n", "onboard.jpeg_quality"},
      {"onboard:\n  frame_queue: 0\n", "onboard.frame_queue"},
      {"onboard:\n  record_images: 7.5\n", "onboard.record_images"}};
  for (const auto& [text, field] : cases) {
    const auto rig = ParseRig(std::string(kFlat) + text, "rig.yaml");
    ASSERT_FALSE(rig) << text;
    EXPECT_EQ(rig.error().field, field);
    EXPECT_EQ(rig.error().line, 15);
  }
}

TEST(RigTest, MapperOptionsOutOfRangeAreNamed) {
  const auto rig = ParseRig(std::string(kFlat) + "mapper:\n  max_ratio: -3\n", "rig.yaml");
  ASSERT_FALSE(rig);
  EXPECT_EQ(rig.error().field, "mapper.max_ratio");
  EXPECT_EQ(rig.error().line, 15);
  const auto enumerated =
      ParseRig(std::string(kFlat) + "mapper:\n  descriptor: surf\n", "rig.yaml");
  ASSERT_FALSE(enumerated);
  EXPECT_EQ(enumerated.error().fix, "give one of none, orb, sift, akaze");
}

// Every option can be given at both ends of its range; what contradicts another option is named so.
TEST(RigTest, MapperOptionsMayBeGivenAtTheEndsOfTheirRanges) {
  const auto text_of = [](const char* name, double value) {
    char text[64];
    std::snprintf(text, sizeof text, "mapper: {%s: %.17g}\n", name, value);
    return std::string(kFlat) + text;
  };
  for (const OptionRange& range : MapperOptions().Ranges()) {
    for (const double value : {range.low, range.high}) {
      const auto rig = ParseRig(text_of(range.name, value), "rig.yaml");
      if (rig) continue;
      EXPECT_EQ(rig.error().problem, "contradicts another option") << ToString(rig.error());
    }
  }
}

TEST(RigTest, WaterConditionsStandForTheIndex) {
  const std::string water = "water: {temperature_c: 8, salinity_psu: 35, depth_m: 200}";
  const auto rig = ParseRig(Replaced(kFlat, "index_water: 1.334", water), "rig.yaml");
  ASSERT_TRUE(rig) << ToString(rig.error());
  EXPECT_EQ(rig->camera.port.index_water,
            *SeaWaterIndex({.temperature_c = 8, .salinity_psu = 35, .depth_m = 200}));
  const auto both =
      ParseRig(Replaced(kFlat, "index_water: 1.334", "index_water: 1.334\n  " + water), "rig.yaml");
  ASSERT_FALSE(both);
  EXPECT_EQ(both.error().field, "port.index_water");
  EXPECT_EQ(both.error().line, 13);
  const auto hot = ParseRig(Replaced(kFlat, "index_water: 1.334",
                                     "water: {temperature_c: 80, salinity_psu: 35, depth_m: 200}"),
                            "rig.yaml");
  ASSERT_FALSE(hot);
  EXPECT_EQ(hot.error().field, "port.water.temperature_c");
}

TEST(RigTest, AGlassStandsForItsIndex) {
  for (const Glass glass : {Glass::kBk7, Glass::kFusedSilica, Glass::kSapphire, Glass::kAcrylic}) {
    const std::string line = "glass: " + std::string(ToString(glass));
    const auto rig = ParseRig(Replaced(kFlat, "index_glass: 1.52", line), "rig.yaml");
    ASSERT_TRUE(rig) << ToString(rig.error());
    EXPECT_EQ(rig->camera.port.index_glass, *GlassIndex(glass, 530.0));
    const auto blue =
        ParseRig(Replaced(kFlat, "index_glass: 1.52", line + "\n  wavelength_nm: 450"), "rig.yaml");
    ASSERT_TRUE(blue) << ToString(blue.error());
    EXPECT_EQ(blue->camera.port.index_glass, *GlassIndex(glass, 450.0));
  }
}

// One wavelength for both; water's own comes first.
TEST(RigTest, AFlatPortMayHaveLayers) {
  const std::string single = "thickness_m: 0.007\n  index_air: 1.0\n  index_glass: 1.52";
  const auto with = [&](const std::string& lines) { return Replaced(kFlat, single, lines); };
  ASSERT_NE(with(""), kFlat);
  const auto rig = ParseRig(with("layers:\n    - {thickness_m: 0.01, glass: acrylic}\n"
                                 "    - {thickness_m: 0.003, index: 1.0}\n"
                                 "    - {thickness_m: 0.005, index: 1.52}"),
                            "rig.yaml");
  ASSERT_TRUE(rig) << ToString(rig.error());
  const PortConfig& port = rig->camera.port;
  EXPECT_EQ(port.thickness_m, 0.01);
  EXPECT_EQ(port.index_glass, *GlassIndex(Glass::kAcrylic, 530.0));
  ASSERT_EQ(port.outer_layers.size(), 2u);
  EXPECT_EQ(port.outer_layers[0].thickness_m, 0.003);
  EXPECT_EQ(port.outer_layers[0].index, 1.0);
  EXPECT_EQ(port.outer_layers[1].index, 1.52);
  const auto again = ParseRig(FormatRig(*rig), "again.yaml");
  ASSERT_TRUE(again) << ToString(again.error());
  EXPECT_EQ(FormatRig(*again), FormatRig(*rig));
  EXPECT_EQ(again->camera.port.outer_layers.size(), 2u);

  const auto refused = [&](const std::string& lines, const std::string& field,
                           const std::string& fix) {
    const auto bad = ParseRig(with(lines), "rig.yaml");
    ASSERT_FALSE(bad) << lines;
    EXPECT_EQ(bad.error().field, field);
    EXPECT_NE(bad.error().fix.find(fix), std::string::npos) << bad.error().fix;
  };
  const std::string layer = "{thickness_m: 0.01, index: 1.5}";
  refused("layers: []", "port.layers", "one to 4");
  refused("layers: [" + layer + "," + layer + "," + layer + "," + layer + "," + layer + "]",
          "port.layers", "one to 4");
  refused("layers: [" + layer + "]\n  thickness_m: 0.01", "port.thickness_m", "into a layer");
  refused("layers: [" + layer + ", {thickness_m: -1, index: 1.5}]", "port.layers[1].thickness_m",
          "metres");
  refused("layers: [{thickness_m: 0.1, index: 0.5}]", "port.layers[0].index", "from 1");
  refused("layers: [{index: 1.5}]", "port.layers[0].thickness_m", "");
  refused("layers: [{thickness_m: 0.1, glass: granite}]", "port.layers[0].glass", "BK7");
}

TEST(RigTest, TheWavelengthIsThatOfGlassAndWater) {
  const auto index = [](const char* water) {
    const std::string text = Replaced(Replaced(kFlat, "index_glass: 1.52", "wavelength_nm: 450"),
                                      "index_water: 1.334", std::string("glass: BK7\n  ") + water);
    const auto rig = ParseRig(text, "rig.yaml");
    EXPECT_TRUE(rig) << ToString(rig.error());
    return rig ? rig->camera.port.index_water : 0.0;
  };
  WaterConditions water{.temperature_c = 8, .salinity_psu = 35, .depth_m = 20};
  water.wavelength_nm = 450;
  EXPECT_EQ(index("water: {temperature_c: 8, salinity_psu: 35, depth_m: 20}"),
            *SeaWaterIndex(water));
  water.wavelength_nm = 600;
  EXPECT_EQ(index("water: {temperature_c: 8, salinity_psu: 35, depth_m: 20, wavelength_nm: 600}"),
            *SeaWaterIndex(water));
}

// What a CTD measures during the mission is judged by the same light.
TEST(RigTest, TheMappersWavelengthIsThePorts) {
  const auto wavelength = [](const std::string& text) {
    const auto rig = ParseRig(text, "rig.yaml");
    EXPECT_TRUE(rig) << ToString(rig.error());
    if (!rig) return 0.0;
    const auto again = ParseRig(FormatRig(*rig), "rig.yaml");
    EXPECT_TRUE(again);
    EXPECT_EQ(again->mapper.light_wavelength_nm, rig->mapper.light_wavelength_nm);
    return rig->mapper.light_wavelength_nm;
  };
  const std::string blue = Replaced(kFlat, "index_glass: 1.52", "glass: BK7\n  wavelength_nm: 450");
  EXPECT_EQ(wavelength(kFlat), 530.0);
  EXPECT_EQ(wavelength(blue), 450.0);
  EXPECT_EQ(wavelength(blue + "mapper:\n  light_wavelength_nm: 470\n"), 470.0);
  EXPECT_EQ(wavelength(Replaced(blue, "index_water: 1.334",
                                "water: {temperature_c: 8, salinity_psu: 35, depth_m: 20, "
                                "wavelength_nm: 600}")),
            600.0);
}

TEST(RigTest, ReadsCalibmar) {
  const auto rig = ParseRig(R"(model: OPENCV
# fx, fy, cx, cy, k1, k2, p1, p2
parameters: [705.3, 705.2, 963.4, 604.9, -0.105541, 0.066014, 0.001093, -8.6e-05]
non_svp_model: FLATPORT
non_svp_parameters: [0.6, 0, 0.8, 0.025, 0.01, 1, 1.49, 1.333]
width: 1920
height: 1200
)",
                            "calibration.yaml");
  ASSERT_TRUE(rig) << ToString(rig.error());
  EXPECT_EQ(rig->camera.port.type, PortType::kFlat);
  EXPECT_EQ(rig->camera.port.normal, Vec3(0.6, 0, 0.8));
  EXPECT_EQ(rig->camera.port.distance_m, 0.025);
  EXPECT_EQ(rig->camera.port.thickness_m, 0.01);
  EXPECT_EQ(rig->camera.port.index_glass, 1.49);
  EXPECT_EQ(rig->camera.lens_params[7], -8.6e-05);
}

TEST(RigTest, ReadsColmapCamerasWithThePortColumns) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "cameras.txt";
  ASSERT_TRUE(WriteFileAtomically(path,
                                  "# Camera list\n1 PINHOLE 640 480 500 500 320 240 DOMEPORT 0 0 "
                                  "0.01 0.05 0.007 1 1.5 1.33\n"));
  const auto rig = ReadRig(path);
  ASSERT_TRUE(rig) << ToString(rig.error());
  EXPECT_EQ(rig->camera.port.type, PortType::kDome);
  EXPECT_EQ(rig->camera.port.radius_m, 0.05);
  ASSERT_TRUE(WriteFileAtomically(
      path, "1 PINHOLE 640 480 500 500 320 240\n\n2 PINHOLE 640 480 500 500\n"));
  const auto bad = ReadRig(path);
  ASSERT_FALSE(bad);
  EXPECT_EQ(bad.error().line, 3);
}

TEST(RigTest, AbsentFileAndFolderAreTheRequestsFault) {
  const TemporaryFolder folder;
  const auto absent = ReadRig(folder.path() / "no.yaml");
  ASSERT_FALSE(absent);
  EXPECT_EQ(ExitCode(absent.error()), 2);
  EXPECT_THAT(ToString(absent.error()), HasSubstr("no.yaml: cannot open"));
  const auto directory = ReadRig(folder.path());
  ASSERT_FALSE(directory);
  EXPECT_THAT(directory.error().fix, HasSubstr("rig.yaml"));
}

}  // namespace
}  // namespace rsfm
