// `rsfm_tool map` as a user runs it, on a small simulated mission.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>

#include "rsfm/io/mission.h"
#include "tests/support/run_program.h"
#include "tests/support/temporary_folder.h"
#include "tools/map/image_files.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

const char kScenario[] = R"(
seed: 11
rig:
  camera: {model: PINHOLE, width: 400, height: 300, params: [320, 320, 200, 150]}
  port: {type: flat, normal: [0, 0, 1], distance_m: 0.03, thickness_m: 0.02, index_air: 1.0, index_glass: 1.52, index_water: 1.336}
  body_from_camera:
    rotation_wxyz: [0.7071067811865476, 0, 0, 0.7071067811865476]
    translation_m: [0.40, 0.05, 0.15]
images: {rate_hz: 1.0, format: jpg, jpeg_quality: 95}
trajectory: {legs: 1, leg_length_m: 4.0, leg_spacing_m: 0.85, altitude_m: 1.6, speed_mps: 0.25, turns: strafe}
seafloor: {depth_m: 20.0}
)";

std::string Read(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream content;
  content << file.rdbuf();
  return content.str();
}

void Write(const fs::path& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

std::string Replaced(const std::string& text, const std::string& what, const std::string& by) {
  const std::size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.substr(0, at) + by + text.substr(at + what.size());
}

class MapVerb : public ::testing::Test {
 protected:
  // Rendered once for all cases of this program.
  static void SetUpTestSuite() {
    shared_ = new TemporaryFolder;
    Write(shared_->path() / "scenario.yaml", kScenario);
    const auto result = RunProgram(Tool("simulate " + (shared_->path() / "scenario.yaml").string() +
                                        " --images 10 --out " + Simulated().string()));
    ASSERT_EQ(result.exit_code, 0) << result.err;
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }
  static std::string Tool(const std::string& arguments) {
    return std::string(RSFM_TOOL) + " " + arguments;
  }
  static fs::path Simulated() { return shared_->path() / "simulated"; }

  // A copy to be damaged.
  fs::path Copy() {
    const fs::path copy = folder_.path() / "copy";
    fs::copy(Simulated(), copy, fs::copy_options::recursive);
    return copy;
  }
  fs::path Out() const { return folder_.path() / "out"; }
  ProgramResult Map(const fs::path& images, const std::string& more = {}) {
    return RunProgram(Tool("map " + images.string() + " --out " + Out().string() + " " + more));
  }
  // Exit code 2, a message that has all of these words, and no output.
  void ExpectWrongRequest(const ProgramResult& result, const std::vector<std::string>& words) {
    EXPECT_EQ(result.exit_code, 2) << result.err;
    for (const std::string& word : words)
      EXPECT_NE(result.err.find(word), std::string::npos) << word << " in: " << result.err;
    EXPECT_FALSE(fs::exists(Out()));
  }

  static TemporaryFolder* shared_;
  TemporaryFolder folder_;
};
TemporaryFolder* MapVerb::shared_ = nullptr;

TEST_F(MapVerb, MapsASimulatedMissionToCentimetres) {
  const auto result = Map(Simulated());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("10 of 10 images placed"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("scale metric"), std::string::npos) << result.out;
  const auto evaluated = RunProgram(
      Tool("evaluate " + Out().string() + " " + Simulated().string() + " --align se3 --json"));
  ASSERT_EQ(evaluated.exit_code, 0) << evaluated.err;
  const auto json = nlohmann::json::parse(evaluated.out);
  EXPECT_GE(json["images"].get<int>(), 9);
  EXPECT_LT(json["position_error_mm"].get<double>(), 20.0);
  // The positions of one straight leg align the two worlds but for a turn about it.
  EXPECT_LT(json["rotation_error_deg"].get<double>(), 1.0);

  // What refinement needs is all in the log.
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission.has_value());
  EXPECT_EQ(mission->rig.world.frame, WorldFrame::kNed);
  EXPECT_TRUE(mission->rig.world.scale_is_metric);
  ASSERT_EQ(mission->keyframes.size(), 10u);
  EXPECT_EQ(mission->poses.size(), 10u);
  EXPECT_GT(mission->nav.size(), 100u);
  EXPECT_GT(mission->landmarks.size(), 300u);
  EXPECT_GE(mission->statuses.size(), 9u);
  for (const keyframe_t& keyframe : mission->keyframes) {
    EXPECT_EQ(keyframe.descriptor_type, keyframe_t::DESCRIPTOR_SIFT);
    EXPECT_EQ(keyframe.num_descriptor_bytes, 128 * keyframe.num_features);
    EXPECT_EQ(keyframe.state, pose_t::STATE_TRACKING);
    EXPECT_EQ(keyframe.image.size(), 10u);  // 000000.jpg
  }
  EXPECT_TRUE(fs::exists(mission->ImagesFolder() / "000003.jpg"));
}

TEST_F(MapVerb, SameInputsSameBytes) {
  ASSERT_EQ(Map(Simulated()).exit_code, 0);
  const std::string first = Read(Out() / "events.lcm");
  EXPECT_GT(first.size(), 100000u);
  ASSERT_EQ(Map(Simulated()).exit_code, 0);  // in place of the first
  EXPECT_TRUE(Read(Out() / "events.lcm") == first);
}

// The log through the same code: the same bytes. With one navigation event altered: the first event
// that differs is named.
TEST_F(MapVerb, ReplaysItsOwnLog) {
  ASSERT_EQ(Map(Simulated()).exit_code, 0);
  const auto same = RunProgram(Tool("map --replay " + Out().string()));
  EXPECT_EQ(same.exit_code, 0) << same.err;
  EXPECT_NE(same.out.find("10 images, 10 poses"), std::string::npos) << same.out;
  EXPECT_NE(same.out.find("the same to the last byte"), std::string::npos) << same.out;

  // A velocity in the middle is 1 cm/s off.
  const fs::path events = Out() / "events.lcm", aside = Out() / "altered";
  auto reader = EventLogReader::Open(events);
  auto writer = EventLogWriter::Create(aside);
  ASSERT_TRUE(reader && writer);
  std::int64_t altered = -1, next_pose = -1;
  int num_poses = 0;
  for (LogEvent event; *reader->Next(&event);) {
    nav_t nav;
    if (num_poses == 5 && altered < 0 && event.channel == "RSFM_NAV" && Decode(event.data, &nav) &&
        (nav.valid & nav_t::VALID_VELOCITY) != 0) {
      nav.velocity_body_mps[0] += 0.01;
      ASSERT_TRUE(Encode(nav, &event.data));
      altered = event.number;
    }
    // The next pose is placed by what it shows; the one after it is of a window with the log's
    // factor.
    num_poses += event.channel == "RSFM_POSE";
    if (num_poses == 7 && next_pose < 0) next_pose = event.number;
    ASSERT_TRUE(writer->Append(event.channel, event.utime, event.data.data(), event.data.size()));
  }
  ASSERT_GE(altered, 0);
  ASSERT_TRUE(writer->Close());
  fs::rename(aside, events);
  const auto other = RunProgram(Tool("map --replay " + Out().string()));
  EXPECT_EQ(other.exit_code, 1) << other.out;
  EXPECT_NE(other.err.find("event " + std::to_string(next_pose)), std::string::npos) << other.err;
  EXPECT_NE(other.err.find("the pose differs by"), std::string::npos) << other.err;
  EXPECT_NE(other.out.find("6 poses the same"), std::string::npos) << other.out;
}

TEST_F(MapVerb, ReplaysThatCannotBe) {
  const auto missing = RunProgram(Tool("map --replay " + (folder_.path() / "none").string()));
  EXPECT_EQ(missing.exit_code, 2) << missing.err;
  const auto both =
      RunProgram(Tool("map " + Simulated().string() + " --replay " + Simulated().string()));
  EXPECT_EQ(both.exit_code, 2) << both.err;
  EXPECT_NE(both.err.find("--replay"), std::string::npos) << both.err;
  EXPECT_EQ(RunProgram(Tool("map " + Simulated().string())).exit_code, 2);  // no --out
}

TEST_F(MapVerb, WithoutNavigationSaysThatScaleIsUnknown) {
  // One image every hundred seconds: a list is no live feed, whose clock could be doubted.
  const auto result =
      Map(Simulated() / "images", "--fps 0.01 --rig " + (Simulated() / "rig.yaml").string());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("10 of 10 images placed"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("scale unknown"), std::string::npos) << result.out;
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission.has_value());
  EXPECT_EQ(mission->rig.world.frame, WorldFrame::kFirstCamera);
  EXPECT_FALSE(mission->rig.world.scale_is_metric);
}

TEST_F(MapVerb, FoldersThatCannotBe) {
  ExpectWrongRequest(Map("/nowhere"), {"/nowhere", "is not a folder"});
  const fs::path empty = folder_.path() / "empty";
  fs::create_directory(empty);
  ExpectWrongRequest(Map(empty, "--rig " + (Simulated() / "rig.yaml").string()),
                     {"empty", "holds no image"});
  ExpectWrongRequest(Map(Simulated() / "images", "--fps 1"), {"rig.yaml", "--rig"});
  ExpectWrongRequest(Map(Simulated(), "--fps 1 --times x.csv"), {"--fps"});
  ExpectWrongRequest(Map(Simulated(), "--nav /nowhere.csv"), {"/nowhere.csv"});
}

TEST_F(MapVerb, ImagesThatCannotBe) {
  const fs::path copy = Copy();
  const fs::path image = copy / "images" / "000004.jpg";
  const std::string whole = Read(image);
  Write(image, whole.substr(0, whole.size() * 2 / 3));
  ExpectWrongRequest(Map(copy), {"000004.jpg", "cut off", "copy the file again"});
  Write(image, "not an image");
  ExpectWrongRequest(Map(copy), {"000004.jpg", "not an image"});
  Write(image, "");
  ExpectWrongRequest(Map(copy), {"000004.jpg", "not an image"});
  fs::remove(image);
  ExpectWrongRequest(Map(copy), {"000004.jpg", "is not there"});
  Write(image, whole);
  Write(copy / "rig.yaml", Replaced(Read(copy / "rig.yaml"), "width: 400", "width: 404"));
  ExpectWrongRequest(Map(copy), {"000000.jpg", "400 x 300", "404 x 300"});
}

TEST_F(MapVerb, TablesThatCannotBe) {
  const fs::path copy = Copy();
  const std::string images = Read(copy / "images.csv"), nav = Read(copy / "nav.csv");
  std::smatch line;
  ASSERT_TRUE(std::regex_search(images, line, std::regex("000003.jpg,[0-9]+")));
  Write(copy / "images.csv", Replaced(images, line.str(), "000003.jpg,5"));
  ExpectWrongRequest(Map(copy), {"images.csv:5", "utime", "does not increase"});
  Write(copy / "images.csv", images);

  const std::size_t second = nav.find('\n', nav.find('\n') + 1) + 1;
  const std::string time = nav.substr(second, nav.find(',', second) - second);
  Write(copy / "nav.csv", Replaced(nav, time, "17"));
  ExpectWrongRequest(Map(copy), {"nav.csv:3", "utime"});
  const std::string depth_line = nav.substr(nav.find('\n') + 1);
  const std::size_t comma = depth_line.find(',');
  Write(copy / "nav.csv", nav.substr(0, nav.find('\n') + 1) + depth_line.substr(0, comma) + ",nan" +
                              depth_line.substr(depth_line.find(',', comma + 1)));
  ExpectWrongRequest(Map(copy), {"nav.csv:2", "nan"});
}

TEST_F(MapVerb, ImagesThatShareNothingFailButKeepTheirFeatures) {
  const fs::path folder = folder_.path() / "few";
  fs::create_directory(folder);
  fs::copy(Simulated() / "images" / "000000.jpg", folder / "a.jpg");
  fs::copy(Simulated() / "images" / "000009.jpg", folder / "b.jpg");
  const auto result = Map(folder, "--rig " + (Simulated() / "rig.yaml").string());
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("nothing was placed"), std::string::npos) << result.err;
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission.has_value());
  ASSERT_EQ(mission->keyframes.size(), 2u);
  for (const keyframe_t& keyframe : mission->keyframes) {
    EXPECT_NE(keyframe.state, pose_t::STATE_TRACKING);
    EXPECT_GT(keyframe.num_descriptor_bytes, 0);
  }
}

TEST(ImageFiles, NamesInNaturalOrder) {
  EXPECT_TRUE(NaturalLess("frame2.jpg", "frame10.jpg"));
  EXPECT_TRUE(NaturalLess("frame09.jpg", "frame10.jpg"));
  EXPECT_FALSE(NaturalLess("frame10.jpg", "frame9.jpg"));
  EXPECT_TRUE(NaturalLess("frame_00_00_59.000.jpg", "frame_00_01_00.000.jpg"));
  EXPECT_TRUE(NaturalLess("a", "b"));
  EXPECT_TRUE(NaturalLess("a", "a1"));
  EXPECT_TRUE(NaturalLess("a01", "a1") != NaturalLess("a1", "a01"));
  EXPECT_FALSE(NaturalLess("a1", "a1"));
}

}  // namespace
}  // namespace rsfm
