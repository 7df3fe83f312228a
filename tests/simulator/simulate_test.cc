#include "tools/simulator/simulate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "rsfm/io/mission.h"
#include "rsfm/io/trajectory.h"
#include "tests/support/temporary_folder.h"

namespace rsfm::simulator {
namespace {

namespace fs = std::filesystem;

Scenario SmallScenario() {
  auto scenario = ParseScenario(R"(
seed: 3
rig:
  camera: {model: PINHOLE, width: 96, height: 72, params: [80, 80, 48, 36]}
  port: {type: flat, normal: [0, 0, 1], distance_m: 0.02, thickness_m: 0.01,
         index_air: 1.0, index_glass: 1.52, index_water: 1.334}
  body_from_camera: {rotation_wxyz: [1, 0, 0, 0], translation_m: [0.3, 0.1, 0.2]}
  sensors: {dvl_in_body_m: [-0.5, 0, 0]}
images: {rate_hz: 0.5, format: png, max_images: 5}
trajectory: {legs: 2, leg_length_m: 2, leg_spacing_m: 0.8}
navigation: {position: {enabled: true, rate_hz: 1}, altimeter: {enabled: true}}
ground_truth: {range: true}
)",
                                "small.yaml");
  return *scenario;
}

std::map<std::string, std::string> FilesIn(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    std::ostringstream content;
    content << std::ifstream(entry.path(), std::ios::binary).rdbuf();
    files[fs::relative(entry.path(), folder).string()] = content.str();
  }
  return files;
}

TEST(SimulateTest, WritesAMissionThatReadsBack) {
  const TemporaryFolder folder;
  const Scenario scenario = SmallScenario();
  const fs::path out = folder.path() / "mission";
  int last_done = 0;
  SimulationHooks hooks;
  hooks.progress = [&](int done, int total) {
    EXPECT_EQ(total, 5);
    last_done = std::max(last_done, done);
  };
  const auto report = Simulate(scenario, out, hooks);
  ASSERT_TRUE(report) << ToString(report.error());
  EXPECT_EQ(report->num_images, 5);
  EXPECT_EQ(last_done, 5);

  const auto mission = ReadMission(out);
  ASSERT_TRUE(mission) << ToString(mission.error());
  EXPECT_EQ(mission->images.size(), 5u);
  EXPECT_EQ(mission->rig.camera.width, 96);
  EXPECT_EQ(mission->num_malformed, 0);
  EXPECT_EQ(mission->num_nav_rejected, 0);
  EXPECT_EQ(mission->log.num_damaged, 0);
  for (const char* channel : {"RSFM_AHRS", "RSFM_DVL", "RSFM_DEPTH", "RSFM_NAV"}) {
    EXPECT_TRUE(mission->log.channels.contains(channel)) << channel;
  }
  const auto table = ReadNavTable(out / "nav.csv");
  ASSERT_TRUE(table) << ToString(table.error());
  EXPECT_EQ(static_cast<int>(table->samples.size()), report->num_nav_samples);

  const auto truth = ReadModel(out / "ground_truth");
  ASSERT_TRUE(truth) << ToString(truth.error());
  ASSERT_EQ(truth->images.size(), 5u);
  const auto tum = ReadTum(out / "ground_truth" / "trajectory.tum");
  ASSERT_TRUE(tum) << ToString(tum.error());
  ASSERT_EQ(tum->size(), 5u);
  EXPECT_LT(((*tum)[2].world_from_camera.translation -
             truth->images[2].camera_from_world.Inverse().translation)
                .norm(),
            1e-6);
  // The camera's lever arm: the DVL and the camera ride on one body.
  const auto trajectory = MakeLawnmower(scenario.trajectory, scenario.seafloor.depth_m);
  const Vec3 camera = trajectory->WorldFromBody(4.0) * Vec3(0.3, 0.1, 0.2);
  EXPECT_LT(((*tum)[2].world_from_camera.translation - camera).norm(), 1e-6);
  EXPECT_TRUE(fs::exists(out / "ground_truth" / "mesh.ply"));
  EXPECT_TRUE(fs::exists(out / "ground_truth" / "range" / "000004.pfm"));
}

TEST(SimulateTest, BytesDoNotDependOnTheNumberOfThreads) {
  const TemporaryFolder folder;
  SimulationHooks one;
  one.num_threads = 1;
  SimulationHooks three;
  three.num_threads = 3;
  ASSERT_TRUE(Simulate(SmallScenario(), folder.path() / "one", one));
  ASSERT_TRUE(Simulate(SmallScenario(), folder.path() / "three", three));
  const auto a = FilesIn(folder.path() / "one");
  const auto b = FilesIn(folder.path() / "three");
  ASSERT_GE(a.size(), 14u);
  ASSERT_EQ(a.size(), b.size());
  for (const auto& [name, content] : a) {
    ASSERT_TRUE(b.contains(name)) << name;
    EXPECT_TRUE(content == b.at(name)) << name << " differs";
  }
}

// The same survey with other noise, for images that have been rendered.
TEST(SimulateTest, NavigationAloneIsThatOfTheWholeMission) {
  const TemporaryFolder folder;
  Scenario scenario = SmallScenario();
  ASSERT_TRUE(Simulate(scenario, folder.path() / "whole", {}));
  scenario.images.render = false;
  ASSERT_TRUE(Simulate(scenario, folder.path() / "alone", {}));
  scenario.navigation.seed = 4;
  ASSERT_TRUE(Simulate(scenario, folder.path() / "other", {}));
  auto whole = FilesIn(folder.path() / "whole");
  const auto alone = FilesIn(folder.path() / "alone");
  auto other = FilesIn(folder.path() / "other");
  std::erase_if(whole, [](const auto& file) {
    return file.first.starts_with("images/") || file.first.starts_with("ground_truth/range/");
  });
  EXPECT_TRUE(alone == whole);
  EXPECT_NE(other["nav.csv"], whole["nav.csv"]);
  EXPECT_EQ(other["ground_truth/trajectory.tum"], whole["ground_truth/trajectory.tum"]);
}

TEST(SimulateTest, AnInterruptedRunLeavesNothing) {
  const TemporaryFolder folder;
  SimulationHooks hooks;
  std::atomic<int> asked = 0;
  hooks.is_interrupted = [&] { return ++asked > 2; };
  const auto report = Simulate(SmallScenario(), folder.path() / "mission", hooks);
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->interrupted);
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(SimulateTest, RefusesWhatCannotBeRendered) {
  const TemporaryFolder folder;
  Scenario low = SmallScenario();
  low.trajectory.altitude_m = 0.3;
  low.seafloor.relief_m = 2.0;
  const auto touching = Simulate(low, folder.path() / "a", {});
  ASSERT_FALSE(touching);
  EXPECT_EQ(touching.error().field, "trajectory.altitude_m");

  Scenario huge = SmallScenario();
  huge.trajectory.leg_length_m = 9000.0;
  huge.images.max_images = 0;
  huge.images.rate_hz = 0.001;
  huge.trajectory.leg_spacing_m = 100.0;
  const auto too_large = Simulate(huge, folder.path() / "b", {});
  ASSERT_FALSE(too_large);
  EXPECT_EQ(too_large.error().field, "trajectory");

  // A folder that is no mission is not replaced.
  fs::create_directory(folder.path() / "mine");
  std::ofstream(folder.path() / "mine" / "letter.txt") << "dear";
  const auto refused = Simulate(SmallScenario(), folder.path() / "mine", {});
  ASSERT_FALSE(refused);
  EXPECT_TRUE(fs::exists(folder.path() / "mine" / "letter.txt"));
}

TEST(SimulateTest, TanksGridsMeshesAndRecordedPathsBecomeMissions) {
  const TemporaryFolder folder;
  Scenario scenario = SmallScenario();
  scenario.images.max_images = 2;
  scenario.ground_truth.range = false;
  scenario.scene = SceneKind::kTank;
  scenario.path = PathKind::kOrbit;
  scenario.tank.texel_m = 0.01;
  scenario.sensor.motion_blur = true;
  ASSERT_TRUE(Simulate(scenario, folder.path() / "tank", {}));

  // The path of that mission, over the mesh of that mission.
  scenario.scene = SceneKind::kMesh;
  scenario.mesh.file = folder.path() / "tank" / "ground_truth" / "mesh.ply";
  scenario.path = PathKind::kRecorded;
  scenario.recorded.file = folder.path() / "tank" / "ground_truth" / "trajectory.tum";
  scenario.recorded.center = false;
  const auto again = Simulate(scenario, folder.path() / "again", {});
  ASSERT_TRUE(again) << ToString(again.error());
  const auto first = ReadTum(folder.path() / "tank" / "ground_truth" / "trajectory.tum");
  const auto second = ReadTum(folder.path() / "again" / "ground_truth" / "trajectory.tum");
  ASSERT_EQ(first->size(), second->size());
  for (std::size_t i = 0; i < first->size(); ++i) {
    EXPECT_LT(
        ((*first)[i].world_from_camera.translation - (*second)[i].world_from_camera.translation)
            .norm(),
        1e-5);
  }

  std::ofstream(folder.path() / "g.asc") << "ncols 2\nnrows 2\ncellsize 30\n1 1.2 0.8 1\n";
  scenario = SmallScenario();
  scenario.images.max_images = 1;
  scenario.dem = folder.path() / "g.asc";
  const auto over_grid = Simulate(scenario, folder.path() / "dem", {});
  ASSERT_TRUE(over_grid) << ToString(over_grid.error());
  std::ofstream(folder.path() / "g.asc") << "ncols 2\nnrows 2\ncellsize 0.5\n1 1.2 0.8 1\n";
  const auto beyond = Simulate(scenario, folder.path() / "dem", {});
  ASSERT_FALSE(beyond);
  EXPECT_EQ(beyond.error().field, "trajectory");
}

// What the log says of lever arms is what its reader takes off again.
TEST(SimulateTest, TheLogReadsBackAsTheBodysNavigation) {
  const TemporaryFolder folder;
  Scenario scenario = SmallScenario();
  scenario.images.max_images = 1;
  scenario.rig.sensors.depth_in_body_m = Vec3(0.3, 0.1, 0.5);
  scenario.rig.sensors.position_in_body_m = Vec3(-0.4, 0.2, -0.6);
  scenario.rig.sensors.dvl_in_body_m = Vec3(-0.5, 0.1, 0.4);
  scenario.rig.world.origin = Geodetic{54.3, 10.1, 0.0};
  scenario.navigation.depth.depth_in_body_m = scenario.rig.sensors.depth_in_body_m;
  scenario.navigation.position.position_in_body_m = scenario.rig.sensors.position_in_body_m;
  scenario.navigation.dvl.dvl_in_body_m = scenario.rig.sensors.dvl_in_body_m;
  const auto report = Simulate(scenario, folder.path() / "m", {});
  ASSERT_TRUE(report) << ToString(report.error());
  const auto mission = ReadMission(folder.path() / "m");
  ASSERT_TRUE(mission);
  EXPECT_EQ(mission->num_nav_rejected, 0);
  EXPECT_TRUE(mission->log.channels.contains("RSFM_FIX"));
  const auto table = ReadNavTable(folder.path() / "m" / "nav.csv");
  ASSERT_TRUE(table);
  int compared = 0;
  for (const NavSample& logged : mission->nav) {
    const auto at = std::find_if(table->samples.begin(), table->samples.end(),
                                 [&](const NavSample& s) { return s.utime == logged.utime; });
    ASSERT_NE(at, table->samples.end());
    if (logged.Has(NavField::kDepth)) {
      EXPECT_NEAR(logged.depth_m, at->depth_m, 0.01);  // by a measured attitude
    }
    if (logged.Has(NavField::kPosition)) {
      EXPECT_LT((logged.position_ned_m - at->position_ned_m).norm(), 0.05);
    }
    if (logged.Has(NavField::kAltitude) && !logged.Has(NavField::kAttitude)) {
      EXPECT_NEAR(logged.altitude_m, at->altitude_m, 0.3);
    }
    ++compared;
  }
  EXPECT_GT(compared, 100);
}

}  // namespace
}  // namespace rsfm::simulator
