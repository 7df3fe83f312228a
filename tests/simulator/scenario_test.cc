#include "tools/simulator/scenario.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace rsfm::simulator {
namespace {

using ::testing::HasSubstr;

constexpr const char* kRig = R"(
rig:
  camera: {model: PINHOLE, width: 640, height: 480, params: [500, 500, 320, 240]}
  port: {type: none}
)";

TEST(ScenarioTest, OnlyTheRigIsRequired) {
  const auto scenario = ParseScenario(kRig, "s.yaml");
  ASSERT_TRUE(scenario) << ToString(scenario.error());
  EXPECT_EQ(scenario->rig.camera.width, 640);
  EXPECT_EQ(scenario->rig.world.frame, WorldFrame::kNed);
  EXPECT_EQ(scenario->trajectory.legs, LawnmowerOptions().legs);
  EXPECT_EQ(scenario->sensor.samples_per_pixel, 4);
}

TEST(ScenarioTest, ReadsEverySection) {
  const auto scenario = ParseScenario(std::string(kRig) + R"(
seed: 42
images: {rate_hz: 2.5, format: png, max_images: 7}
trajectory: {legs: 2, turns: rotate, altitude_m: 3}
seafloor: {depth_m: 55, stones_per_m2: 0}
water: {strobe: false, attenuation_per_m: [0.1, 0.2, 0.3], strobes: [{position_m: [1, 2, 3]}]}
sensor: {samples_per_pixel: 9, noise: false}
navigation:
  dvl: {rate_hz: 8, scale_error: -0.01}
  position: {enabled: true, horizontal_sigma_m: 0.2}
ground_truth: {mesh: false, range: true}
)",
                                      "s.yaml");
  ASSERT_TRUE(scenario) << ToString(scenario.error());
  EXPECT_EQ(scenario->seed, 42u);
  EXPECT_EQ(scenario->seafloor.seed, 42u);
  EXPECT_EQ(scenario->navigation.seed, 42u);
  EXPECT_EQ(scenario->images.rate_hz, 2.5);
  EXPECT_EQ(scenario->images.format, ImageOptions::Format::kPng);
  EXPECT_EQ(scenario->trajectory.turns, LawnmowerOptions::Turns::kRotate);
  EXPECT_EQ(scenario->seafloor.depth_m, 55.0);
  EXPECT_FALSE(scenario->water.strobe);
  EXPECT_EQ(scenario->water.attenuation_per_m, Vec3(0.1, 0.2, 0.3));
  ASSERT_EQ(scenario->water.strobes.size(), 1u);
  EXPECT_EQ(scenario->water.strobes[0].position_in_camera, Vec3(1, 2, 3));
  EXPECT_EQ(scenario->sensor.samples_per_pixel, 9);
  EXPECT_EQ(scenario->navigation.dvl.scale_error, -0.01);
  EXPECT_TRUE(scenario->navigation.position.timing.enabled);
  EXPECT_FALSE(scenario->ground_truth.mesh);
  EXPECT_TRUE(scenario->ground_truth.range);
}

struct BadCase {
  const char* text;  // appended to the rig unless it begins with '!'
  const char* field;
  const char* message;
};

class BadScenarioTest : public ::testing::TestWithParam<BadCase> {};

TEST_P(BadScenarioTest, NamesFileFieldAndFix) {
  const BadCase& c = GetParam();
  const std::string text = c.text[0] == '!' ? std::string(c.text + 1) : std::string(kRig) + c.text;
  const auto scenario = ParseScenario(text, "dir/bad.yaml");
  ASSERT_FALSE(scenario);
  const Diagnostic& problem = scenario.error();
  EXPECT_EQ(problem.field, c.field) << ToString(problem);
  EXPECT_THAT(ToString(problem), HasSubstr(c.message));
  EXPECT_THAT(problem.file, HasSubstr("bad.yaml"));
  EXPECT_FALSE(problem.fix.empty());
  EXPECT_EQ(ExitCode(problem), 2);
}

INSTANTIATE_TEST_SUITE_P(
    Cases, BadScenarioTest,
    ::testing::Values(
        BadCase{"!seed: 1\n", "rig", "is missing"},
        BadCase{"!rig: {camera: {model: PINHOLE, width: 640, height: 480, params: [1, 1, 1, 1]}}\n",
                "rig.port", "is missing"},
        BadCase{"!rig: {camera: {model: PINHOLE, width: 640, height: 480, params: [500, 500, 320, "
                "240]}, port: {type: flat, normal: [0, 0, 2], distance_m: 0.1, thickness_m: "
                "0.01, index_air: 1, index_glass: 1.5, index_water: 1.33}}\n",
                "rig.port.normal", "unit"},
        BadCase{"tragectory: {legs: 2}\n", "tragectory", "did you mean 'trajectory'"},
        BadCase{"trajectory: {leg: 2}\n", "trajectory.leg", "did you mean 'legs'"},
        BadCase{"trajectory: {legs: 0}\n", "trajectory.legs", "out of range"},
        BadCase{"trajectory: {legs: two}\n", "trajectory.legs", "whole number"},
        BadCase{"trajectory: {speed_mps: .nan}\n", "trajectory.speed_mps", "not finite"},
        BadCase{"trajectory: {speed_mps: -1}\n", "trajectory.speed_mps", "out of range"},
        BadCase{"trajectory: {turns: sideways}\n", "trajectory.turns", "rotate or strafe"},
        BadCase{"trajectory: {altitude_m: 30}\n", "trajectory.altitude_m", "out of the water"},
        BadCase{"trajectory: 3\n", "trajectory", "not a mapping"},
        BadCase{"images: {rate_hz: 0}\n", "images.rate_hz", "out of range"},
        BadCase{"images: {format: tiff}\n", "images.format", "png or jpg"},
        BadCase{"images: {jpeg_quality: 101}\n", "images.jpeg_quality", "1 to 100"},
        BadCase{"sensor: {samples_per_pixel: 5}\n", "sensor.samples_per_pixel", "square"},
        BadCase{"sensor: {noise: 3}\n", "sensor.noise", "true or false"},
        BadCase{"water: {attenuation_per_m: [1, 2]}\n", "water.attenuation_per_m", "three"},
        BadCase{"water: {attenuation_per_m: [1, 2, -3]}\n", "water.attenuation_per_m", "range"},
        BadCase{"water: {strobes: [{beam_angle_deg: 20}]}\n", "water.strobes[0].position_m",
                "is missing"},
        BadCase{"seafloor: {stone_min_radius_m: 1}\n", "seafloor.stone_max_radius_m", "less than"},
        BadCase{"navigation: {dvl: {dropout: 1.5}}\n", "navigation.dvl.dropout", "share"},
        BadCase{"navigation: {gyro: {rate_hz: 1}}\n", "navigation.gyro", "not a known field"},
        BadCase{"tank: {length_m: 0}\n", "tank.length_m", "out of range"},
        BadCase{"tank: {texel_m: 0.0001}\n", "tank.texel_m", "250 million"},
        BadCase{"tank: {}\nseafloor: {}\n", "tank", "keep one"},
        BadCase{"mesh: {file: a.ply}\ndem: {file: a.asc}\n", "mesh", "keep one"},
        BadCase{"mesh: {texture: a.png}\n", "mesh.file", "PLY"},
        BadCase{"mesh: {file: a.ply, up: y}\n", "mesh.up", "-z or +z"},
        BadCase{"dem: {}\n", "dem.file", "Esri"},
        BadCase{"trajectory: {type: circle}\n", "trajectory.type", "orbit or recorded"},
        BadCase{"trajectory: {type: orbit, legs: 2}\n", "trajectory.legs", "not a known field"},
        BadCase{"trajectory: {type: orbit, images: 0}\n", "trajectory.images", "out of range"},
        BadCase{"trajectory: {type: orbit, center_ne_m: [1]}\n", "trajectory.center_ne_m",
                "north and east"},
        BadCase{"trajectory: {type: recorded}\n", "trajectory.file", "TUM"},
        BadCase{"trajectory: {type: recorded, file: a, start_s: -1}\n", "trajectory.start_s",
                "out of range"},
        BadCase{"sensor: {motion_blur: true, samples_per_pixel: 1}\n", "sensor.samples_per_pixel",
                "motion_blur"},
        BadCase{"sensor: {exposure_s: 0}\n", "sensor.exposure_s", "out of range"},
        BadCase{"navigation: {position: {drift_time_s: 0}}\n", "navigation.position.drift_time_s",
                "out of range"},
        BadCase{"navigation: {dvl: {bias_mps: [1, 2]}}\n", "navigation.dvl.bias_mps", "three"},
        BadCase{"seed: 1\nseed: 2\n", "seed", "twice"}));

TEST(ScenarioTest, ATankIsOrbitedUnlessTheFileSaysOtherwise) {
  const std::string tank = std::string(kRig) + "tank: {stones: 3}\n";
  const auto orbited = ParseScenario(tank, "dir/s.yaml");
  ASSERT_TRUE(orbited) << ToString(orbited.error());
  EXPECT_EQ(orbited->scene, SceneKind::kTank);
  EXPECT_EQ(orbited->path, PathKind::kOrbit);
  EXPECT_EQ(orbited->tank.stones, 3);
  const auto recorded = ParseScenario(
      tank + "trajectory: {type: recorded, file: a.tum, poses: body}\n", "dir/s.yaml");
  ASSERT_TRUE(recorded) << ToString(recorded.error());
  EXPECT_EQ(recorded->path, PathKind::kRecorded);
  EXPECT_EQ(recorded->recorded.file, "dir/a.tum");
  EXPECT_TRUE(recorded->recorded.poses_are_body);
}

TEST(ScenarioTest, ReportsAllProblemsAtOnce) {
  std::vector<Diagnostic> problems;
  ASSERT_FALSE(ParseScenario(std::string(kRig) + "images: {rate_hz: 0}\nsensor: {gray: 1}\n",
                             "s.yaml", &problems));
  EXPECT_EQ(problems.size(), 2u);
}

TEST(ScenarioTest, AMissingFileIsNamed) {
  const auto scenario = ReadScenario("/nowhere/scenario.yaml");
  ASSERT_FALSE(scenario);
  EXPECT_EQ(scenario.error().file, "/nowhere/scenario.yaml");
  EXPECT_EQ(ExitCode(scenario.error()), 2);
}

TEST(ScenarioTest, BrokenYamlIsNamedWithItsLine) {
  const auto scenario = ParseScenario("rig: [1, 2\nseed: }", "s.yaml");
  ASSERT_FALSE(scenario);
  EXPECT_EQ(scenario.error().code, Errc::kCorrupt);
  EXPECT_GT(scenario.error().line, 0);
}

}  // namespace
}  // namespace rsfm::simulator
