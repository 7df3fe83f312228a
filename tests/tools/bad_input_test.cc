// Bad input to rsfm_tool, end to end: exit code, a message that names file, field and fix, and no
// half-written output.
//
// With rsfm_tool_test.cc this is the whole list: camera files with missing and unknown fields, a
// normal that is no unit vector, a camera outside its dome, negative thickness, an index below 1;
// images of another size, cut off, absent; an empty folder; navigation that runs backwards or is
// not finite; a full disk; a log cut in the middle of an event.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <unistd.h>

#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "rsfm/base/rng.h"
#include "rsfm/base/so3.h"
#include "rsfm/io/atomic_output.h"
#include "rsfm/io/mission.h"
#include "rsfm/io/output_messages.h"
#include "rsfm/refraction/any_camera.h"
#include "rsfm/refraction/sea_water.h"
#include "tests/support/replaced.h"
#include "tests/tools/tool_test.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr const char* kRig = R"(camera:
  model: PINHOLE
  width: 160
  height: 120
  params: [150, 150, 80, 60]
port:
  type: flat
  normal: [0, 0, 1]
  distance_m: 0.02
  thickness_m: 0.01
  index_glass: 1.52
  index_water: 1.334
mapper: {max_features: 200, max_keyframes: 10, max_landmarks: 400}
)";

// The bytes of an image of noise.
std::string MakeImage(int width, int height, const char* extension, std::uint64_t seed) {
  Rng rng(seed);
  cv::Mat image(height, width, CV_8UC1);
  for (int i = 0; i < width * height; ++i)
    image.data[i] = static_cast<unsigned char>(rng.Index(256));
  std::vector<unsigned char> bytes;
  EXPECT_TRUE(cv::imencode(extension, image, bytes));
  return {bytes.begin(), bytes.end()};
}

class BadInputTest : public ToolTest {
 protected:
  void SetUp() override {
    fs::create_directories(Path("images"));
    for (int i = 0; i < 3; ++i) {
      Write("images/f" + std::to_string(i) + ".jpg",
            MakeImage(160, 120, ".jpg", static_cast<std::uint64_t>(i)));
    }
    Write("rig.yaml", kRig);
  }
  ProgramResult Map(const std::string& more = {}) {
    return Run("map " + Path("images") + " --rig " + Path("rig.yaml") + " --out " + Path("out") +
               " " + more);
  }
  int NumEntries(const std::string& name) {
    return static_cast<int>(std::distance(fs::directory_iterator(Path(name)), {}));
  }
  // The request is refused; nothing is left of it, under its name or aside.
  void ExpectRefused(const ProgramResult& result, const std::string& message,
                     const std::string& fix) {
    EXPECT_EQ(result.exit_code, 2) << result.out << result.err;
    EXPECT_THAT(result.err, HasSubstr("error: " + message));
    EXPECT_THAT(result.err, HasSubstr(fix));
    EXPECT_FALSE(fs::exists(Path("out")));
    EXPECT_EQ(NumEntries("."), num_entries_) << "something is left aside";
  }

  int num_entries_ = 2;  // images and rig.yaml
};

TEST_F(BadInputTest, TheInputWithoutFaultsIsTaken) {
  const ProgramResult result = Map();
  EXPECT_NE(result.exit_code, 2) << result.err;  // noise has no second view: 1 is right
  EXPECT_TRUE(fs::exists(Path("out/events.lcm")));
}

TEST_F(BadInputTest, RigFiles) {
  const struct {
    const char* from;
    const char* to;
    const char* message;  // after the file's name
    const char* fix;
  } cases[] = {
      {"  height: 120\n", "", ":2: camera.height: is missing", "add 'height: ...'"},
      {"  distance_m: 0.02\n", "", ":7: port.distance_m: is missing", "add"},
      {"height: 120", "height: 120\n  hieght: 1", ":5: camera.hieght: is not a known field",
       "did you mean 'height'"},
      {"port:", "colour: red\nport:", ":6: colour: is not a known field", "remove it"},
      {"[0, 0, 1]", "[0, 0, 1.1]", ":8: port.normal: is not a unit vector: its length is 1.1",
       "give [0, 0, 1]"},
      {"[0, 0, 1]", "[0, 0, -1]", ":8: port.normal: points backwards", "z > 0"},
      {"thickness_m: 0.01", "thickness_m: -0.01", ":10: port.thickness_m: is out of range: -0.01",
       "give metres from 0"},
      {"index_water: 1.334", "index_water: 0.9", ":12: port.index_water: is out of range: 0.9",
       "from 1 to 4"},
      {"index_glass: 1.52", "index_glass: .inf", ":11: port.index_glass: is not finite",
       "from 1 to 4"},
      {"type: flat\n  normal: [0, 0, 1]\n  distance_m: 0.02",
       "type: dome\n  center_m: [0, 0, 0.05]\n  radius_m: 0.05",
       ":8: port.center_m: puts the camera outside its dome", "give a centre nearer"},
      {"max_features: 200", "max_features: 1", ":13: mapper.max_features: is out of range: 1",
       "give a number from 50 to 20000; see this option in rsfm/mapping/mapper_options.h"},
      {"max_features: 200", "max_loops: 1000", ":13: mapper.max_loops: is out of range: 1000",
       "from 1 to 256"},
      {"max_features: 200", "max_places: 900, max_way_nodes: 500",
       ":13: mapper.max_places: contradicts another option", "mapper_options.h"},
  };
  for (const auto& bad : cases) {
    const std::string rig = Write("rig.yaml", Replaced(kRig, bad.from, bad.to));
    for (const std::string& verb :
         {"check " + rig, "project --camera " + rig, "backproject --camera " + rig,
          "map " + Path("images") + " --rig " + rig + " --out " + Path("out")}) {
      ExpectRefused(Run(verb), rig + bad.message, bad.fix);
    }
  }
}

TEST_F(BadInputTest, AnImageOfAnotherSize) {
  const std::string image = Write("images/f1.jpg", MakeImage(120, 160, ".jpg", 1));
  ExpectRefused(Map(), image + ": image: is 120 x 160 px, the rig's camera 160 x 120",
                "correct width and height in the rig file");
}

TEST_F(BadInputTest, AnImageCutOff) {
  for (const char* extension : {".jpg", ".png"}) {
    const std::string whole = MakeImage(160, 120, extension, 1);
    fs::remove(Path("images/f1.jpg"));
    fs::remove(Path("images/f1.png"));
    for (const std::size_t size : {whole.size() - 1, whole.size() / 2, std::size_t{20}}) {
      const std::string image = Write("images/f1" + std::string(extension), whole.substr(0, size));
      ExpectRefused(Map(), image + ": image: is cut off", "copy the file again");
    }
    const std::string image = Write("images/f1" + std::string(extension), "");
    ExpectRefused(Map(), image + ": image: is ", "");
  }
}

TEST_F(BadInputTest, NoImageAndNoSuchImage) {
  fs::remove_all(Path("images"));
  num_entries_ = 1;
  ExpectRefused(Map(), Path("images") + ": is not a folder", "give a folder of images");
  fs::create_directory(Path("images"));
  num_entries_ = 2;
  ExpectRefused(Map(), Path("images") + ": holds no image", "give a folder with JPEG");
  Write("images/notes.txt", "no image");
  ExpectRefused(Map(), Path("images") + ": holds no image", "give a folder with JPEG");
  const std::string times = Write("times.csv", "image,utime\nf0.jpg,5\n");
  num_entries_ = 3;
  ExpectRefused(Map("--times " + times), Path("images/f0.jpg") + ": is listed in", "take its line");
}

TEST_F(BadInputTest, Navigation) {
  num_entries_ = 3;
  const struct {
    const char* table;
    const char* message;
    const char* fix;
  } cases[] = {
      {"utime,depth_m\n5,1\n4,1\n", ":3: column utime: time runs backwards", "sort"},
      {"utime,depth_m\n5,1\n6,nan\n", ":3: column depth_m: is not finite", "leave the field empty"},
      {"utime,vx_mps,vy_mps,vz_mps\n5,inf,0,0\n", ":2: column vx_mps: is not finite", "empty"},
      {"utime,depth\n5,1\n", ":1: column 'depth': is not known", "did you mean 'depth_m'"},
      {"utime,depth_m\n5\n", ":2: ", "each column"},
      {"", ": is empty", "header"},
  };
  for (const auto& bad : cases) {
    const std::string nav = Write("nav.csv", bad.table);
    ExpectRefused(Map("--nav " + nav), nav + bad.message, bad.fix);
  }
  ExpectRefused(Map("--nav " + Path("none.csv")), Path("none.csv") + ": cannot open", "");
}

TEST_F(BadInputTest, AWrongBandForCheck) {
  for (const char* band : {"1-8", "8:1", "0:8", "nan:8", "1:", "1:2:3", "-1:2"}) {
    ExpectRefused(Run("check " + Path("rig.yaml") + " --range=" + band),
                  "--range: '" + std::string(band) + "' is no band", "--range 1:8");
  }
  EXPECT_EQ(Run("check " + Path("rig.yaml") + " --svg " + Path("out")).exit_code, 2);
  const ProgramResult nowhere =
      Run("check " + Path("rig.yaml") + " --range 1:8 --svg " + Path("rig.yaml/map.svg"));
  EXPECT_NE(nowhere.exit_code, 0);
  EXPECT_THAT(nowhere.err, HasSubstr("rig.yaml"));
}

TEST_F(BadInputTest, CheckSaysWhetherRefractionMatters) {
  const ProgramResult result =
      Run("check " + Path("rig.yaml") + " --range 1:8 --svg " + Path("m.svg"));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  for (const char* part : {"as a pinhole  from 1 to 8 m", "px mean,", "px at most", "not central",
                           "a transect    of 50 m at 2.83 m", "verdict       refraction"}) {
    EXPECT_THAT(result.out, HasSubstr(part));
  }
  EXPECT_THAT(*ReadWholeFile(Path("m.svg")), HasSubstr("</svg>"));
  // The same again: nothing in it is by chance.
  EXPECT_EQ(Run("check " + Path("rig.yaml") + " --range 1:8").out, result.out);
  const ProgramResult air =
      Run("check " + Write("air.yaml", Replaced(kRig, "flat", "none")) + " --range 1:8");
  EXPECT_EQ(air.exit_code, 0) << air.err;
  EXPECT_THAT(air.out, HasSubstr("verdict       no port, no refraction"));
}

// The memory that the on-board mapper takes, by component: the parts are the whole.
TEST_F(BadInputTest, CheckListsTheMappersMemory) {
  const auto total = [&](const std::string& rig, double* sum, double* places = nullptr) {
    const ProgramResult result = Run("check " + rig);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    const std::size_t at = result.out.find("mapper memory ");
    EXPECT_NE(at, std::string::npos) << result.out;
    std::stringstream lines(result.out.substr(at + 14));
    double whole = 0.0, part = 0.0;
    std::string unit, rest;
    lines >> whole;
    std::getline(lines, rest);
    EXPECT_EQ(rest, " MiB, taken at the start:");
    for (const char* name :
         {"keyframes", "landmarks", "matching and placing", "two views", "triangulation",
          "window adjustment", "places and loops", "navigation", "front end"}) {
      lines >> part >> unit;
      std::getline(lines, rest);
      EXPECT_EQ(unit, "MiB");
      EXPECT_EQ(rest, "  " + std::string(name));
      EXPECT_GT(part, 0.0) << name;
      if (places != nullptr && std::string(name) == "places and loops") *places = part;
      *sum += part;
    }
    return whole;
  };
  double small_sum = 0.0, large_sum = 0.0;
  const double small = total(Path("rig.yaml"), &small_sum);
  const double large = total(
      Write("large.yaml", Replaced(kRig, "max_keyframes: 10", "max_keyframes: 64")), &large_sum);
  EXPECT_NEAR(small, small_sum, 0.1);  // rounded to tenths, and hundredths
  EXPECT_NEAR(large, large_sum, 0.1);
  EXPECT_GT(large, small + 1.0);  // 56 keyframes more, of 200 features and SIFT descriptors each
  // 300 places fewer, of 160 points and SIFT descriptors each, and 19,000 poses of the way.
  double many = 0.0, few = 0.0, sum = 0.0;
  total(Path("rig.yaml"), &sum, &many);
  const std::string few_places =
      Replaced(kRig, "max_keyframes: 10", "max_keyframes: 10, max_places: 100, max_way_nodes: 1000");
  total(Write("few.yaml", few_places), &sum, &few);
  EXPECT_GT(many - few, (300 * 160 * (24 + 128) + 19000 * 2 * 64) / 1048576.0);
}

class FullDiskTest : public BadInputTest {
 protected:
  bool Mount(const char* size) {
    fs::create_directory(Path("disk"));
    mounted_ = ::geteuid() == 0 && ::mount("tmpfs", Path("disk").c_str(), "tmpfs", 0, size) == 0;
    return mounted_;
  }
  void TearDown() override {
    if (mounted_) {
      EXPECT_EQ(::umount2(Path("disk").c_str(), MNT_DETACH), 0);
    }
  }
  void ExpectNoTrace(const ProgramResult& result) {
    EXPECT_EQ(result.exit_code, 1) << result.out << result.err;
    EXPECT_THAT(result.err, HasSubstr("No space left on device; free space"));
    EXPECT_THAT(result.err, HasSubstr(Path("disk")));
    EXPECT_EQ(NumEntries("disk"), 0);
  }
  bool mounted_ = false;
};

TEST_F(FullDiskTest, LeavesNoMissionAndNoPicture) {
  if (!Mount("size=12k")) GTEST_SKIP() << "a small tmpfs cannot be mounted here: not root?";
  ExpectNoTrace(
      Run("map " + Path("images") + " --rig " + Path("rig.yaml") + " --out " + Path("disk/out")));
  ExpectNoTrace(Run("check " + Path("rig.yaml") + " --range 1:8 --svg " + Path("disk/map.svg")));
}

// A mission of exact observations: cameras on a circle over points on a plane.
class MissionToolTest : public BadInputTest {
 protected:
  void WriteMission(const std::string& name, double true_index, const Rig& rig,
                    const std::vector<water_t>& waters) {
    fs::create_directory(Path(name));
    auto writer = MissionWriter::Create(Path(name), rig);
    ASSERT_TRUE(writer);
    CameraConfig truth = rig.camera;
    truth.port.index_water = true_index;
    const auto camera = AnyCamera::Create(truth);
    landmarks_t landmarks{};
    for (int p = 0; p < 49; ++p) {
      landmarks.id.push_back(p);
      landmarks.x.push_back(0.25 * (p % 7) - 0.75);
      landmarks.y.push_back(0.25 * (p / 7) - 0.75);
      landmarks.z.push_back(2.0 + 0.1 * (p % 3));
      for (auto* colour : {&landmarks.r, &landmarks.g, &landmarks.b}) colour->push_back(100);
    }
    landmarks.num = 49;
    for (const water_t& water : waters) {
      ASSERT_TRUE(writer->Log("RSFM_WATER", water.utime, water));
    }
    ASSERT_TRUE(writer->Log("RSFM_LANDMARKS", 1, landmarks));
    for (int i = 0; i < 8; ++i) {
      PoseOutput pose;
      pose.utime = 1'000'000 * (i + 1);
      pose.state = pose_t::STATE_TRACKING;
      ASSERT_TRUE(writer->Log("RSFM_POSE", pose.utime, MakePose(pose, World())));
      ASSERT_TRUE(writer->Log("RSFM_KEYFRAME", pose.utime, MakeKeyframe(i, *camera, landmarks)));
    }
    ASSERT_TRUE(writer->Close());
  }
  static keyframe_t MakeKeyframe(int i, const AnyCamera& camera, const landmarks_t& landmarks) {
    const Rigid3 camera_from_world = Rigid3(ExpSo3(Vec3(0.02 * i, 0.01, 0.1 * i)),
                                            Vec3(0.4 * std::cos(i), 0.4 * std::sin(i), 0.03 * i))
                                         .Inverse();
    keyframe_t m{};
    m.utime = 1'000'000 * (i + 1);
    m.id = i;
    m.image = "i" + std::to_string(i) + ".jpg";
    m.state = pose_t::STATE_TRACKING;
    const Quat& q = camera_from_world.rotation;
    const double wxyz[4] = {q.w(), q.x(), q.y(), q.z()};
    for (int k = 0; k < 4; ++k) m.camera_from_world_q[k] = wxyz[k];
    for (int k = 0; k < 3; ++k) m.camera_from_world_t[k] = camera_from_world.translation[k];
    for (int p = 0; p < landmarks.num; ++p) {
      Vec2 pixel;
      const Vec3 point(landmarks.x[p], landmarks.y[p], landmarks.z[p]);
      if (camera.Project(camera_from_world * point, &pixel) != Projection::kOk ||
          !camera.IsInImage(pixel)) {
        continue;
      }
      m.x_px.push_back(static_cast<float>(pixel.x()));
      m.y_px.push_back(static_cast<float>(pixel.y()));
      m.size_px.push_back(1.0f);
      m.landmark_id.push_back(p);
    }
    m.num_features = static_cast<std::int32_t>(m.x_px.size());
    return m;
  }
  static water_t Water(Utime utime, double index) {
    water_t water{};
    water.utime = utime;
    water.index_water = index;
    water.is_measured = true;
    water.temperature_c = 4.0;
    water.salinity_psu = 35.0;
    return water;
  }
};

TEST_F(MissionToolTest, ACutLogLosesOnlyTheCutEvent) {
  WriteMission("mission", 1.334, *ParseRig(kRig, "rig"), {});
  const std::string log = *ReadWholeFile(Path("mission/events.lcm"));
  const auto num_poses = [&] {
    const ProgramResult result =
        Run("export " + Path("mission") + " --format tum --out " + Path("t.tum"));
    EXPECT_EQ(result.exit_code, 0) << result.err;
    const std::string text = *ReadWholeFile(Path("t.tum"));
    return std::count(text.begin(), text.end(), '\n') - (text[0] == '#' ? 1 : 0);
  };
  EXPECT_EQ(num_poses(), 8);
  ASSERT_EQ(Run("refine " + Path("mission") + " --out " + Path("whole")).exit_code, 0);
  // In the middle of the last event, a keyframe: seven are left, and all eight poses.
  Write("mission/events.lcm", log.substr(0, log.size() - 100));
  EXPECT_EQ(num_poses(), 8);
  const ProgramResult info = Run("info " + Path("mission"));
  EXPECT_EQ(info.exit_code, 0);
  EXPECT_THAT(info.out, HasSubstr("the last event is cut off"));
  EXPECT_THAT(info.out, HasSubstr("keyframes     7"));
  const ProgramResult refined = Run("refine " + Path("mission") + " --out " + Path("cut"));
  EXPECT_EQ(refined.exit_code, 0) << refined.err;
  EXPECT_THAT(refined.out, HasSubstr("7 of 7 placed"));
  // A piece out of the middle costs the events that it touches.
  Write("mission/events.lcm", log.substr(0, log.size() / 2) + log.substr(log.size() / 2 + 40));
  const ProgramResult damaged = Run("info " + Path("mission"));
  EXPECT_EQ(damaged.exit_code, 0);
  EXPECT_THAT(damaged.out, HasSubstr("damage        1 places"));
}

TEST_F(MissionToolTest, RefinementTakesTheWaterThatTheMapperHad) {
  Rig rig = *ParseRig(kRig, "rig");
  rig.camera.port.index_water = 1.30;
  WriteMission("silent", 1.34, rig, {});
  WriteMission("mission", 1.34, rig,
               {Water(0, 1.34), Water(4'500'000, 1.3401), Water(4'600'000, 1.34)});
  const ProgramResult silent = Run("refine " + Path("silent") + " --out " + Path("a"));
  const ProgramResult told = Run("refine " + Path("mission") + " --out " + Path("b"));
  ASSERT_EQ(silent.exit_code, 0) << silent.err;
  ASSERT_EQ(told.exit_code, 0) << told.err;
  EXPECT_THAT(told.out, HasSubstr("water        index 1.340000 for all images"));
  const auto report = [&](const char* name) {
    return nlohmann::json::parse(*ReadWholeFile(Path(name)));
  };
  const auto error = [&](const char* name) {
    return report(name).at("after").at("rms_error_px").get<double>();
  };
  EXPECT_LT(error("b/report.json"), 1e-4);
  EXPECT_GT(error("a/report.json"), 10.0 * error("b/report.json"));
  EXPECT_EQ(report("b/report.json").at("index_water").at("rig"), 1.30);
  EXPECT_EQ(report("b/report.json").at("index_water").at("used"), 1.34);
  EXPECT_FALSE(report("a/report.json").contains("index_water"));
  EXPECT_EQ(ReadModel(Path("b"))->rig.camera.port.index_water, 1.34);
  EXPECT_THAT(Run("info " + Path("mission")).out,
              HasSubstr("water         index 1.340100 from 4.5"));
}

// nav.csv has the water; the mission records the index that the camera took from it.
TEST_F(MissionToolTest, TheMapperRecordsTheWaterItFollows) {
  const std::string nav =
      Write("nav.csv",
            "utime,temperature_c,salinity_psu,depth_m\n0,4,35,100\n500000,4.01,35,100\n"
            "1500000,9,35,100\n");
  Map("--nav " + nav);  // noise is not placed; the mission is written all the same
  const auto mission = ReadMission(Path("out"));
  ASSERT_TRUE(mission) << ToString(mission.error());
  ASSERT_EQ(mission->waters.size(), 2u);
  EXPECT_EQ(mission->waters[0].utime, 0);
  EXPECT_EQ(mission->waters[0].index_water, *SeaWaterIndex({4.0, 35.0, 100.0, 530.0}));
  EXPECT_TRUE(mission->waters[0].is_measured);
  EXPECT_EQ(mission->waters[1].utime, 2'000'000);
  EXPECT_EQ(mission->waters[1].index_water, *SeaWaterIndex({9.0, 35.0, 100.0, 530.0}));
  const std::string first = *ReadWholeFile(Path("out/events.lcm"));
  Map("--nav " + nav);
  EXPECT_EQ(first, *ReadWholeFile(Path("out/events.lcm")));  // bit for bit
}

}  // namespace
}  // namespace rsfm
