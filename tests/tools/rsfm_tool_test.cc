// rsfm_tool as its users run it: contracts of its verbs, exit codes and messages for bad input.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <unistd.h>

#include <nlohmann/json.hpp>
#include <numbers>

#include "rsfm/base/so3.h"
#include "rsfm/io/atomic_output.h"
#include "rsfm/io/mission.h"
#include "rsfm/io/model.h"
#include "rsfm/io/output_messages.h"
#include "rsfm/io/text.h"
#include "rsfm/refraction/any_camera.h"
#include "tests/tools/tool_test.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr const char* kCamera = R"(camera:
  model: PINHOLE
  width: 640
  height: 480
  params: [500, 500, 320, 240]
port:
  type: flat
  normal: [0, 0, 1]
  distance_m: 0.02
  thickness_m: 0.01
  index_glass: 1.52
  index_water: 1.334
)";

std::vector<std::vector<double>> Numbers(const std::string& text) {
  std::vector<std::vector<double>> lines;
  std::string_view rest = text, line;
  std::vector<std::string_view> fields;
  while (NextLine(&rest, &line)) {
    SplitBlanks(line, &fields);
    lines.emplace_back();
    for (const std::string_view field : fields) {
      const auto number = ParseNumber(field);
      lines.back().push_back(number.value_or(std::nan("")));
    }
  }
  return lines;
}

class RsfmToolTest : public ToolTest {
 protected:
  // Cameras on a circle, points on the plane z = 3; exact observations. `world_from_truth` moves
  // it.
  Model MakeModel(const Rigid3& world_from_truth, double scale) {
    Model model;
    model.rig = *ParseRig(kCamera, "camera");
    model.cameras = {{1, model.rig.camera}};
    const auto camera = AnyCamera::Create(model.rig.camera);
    for (int p = 0; p < 25; ++p) {
      ModelPoint point;
      point.xyz = {0.3 * (p % 5) - 0.6, 0.3 * (p / 5) - 0.6, 3.0};
      model.points.push_back(point);
    }
    for (int i = 0; i < 6; ++i) {
      ModelImage image;
      image.name = "i" + std::to_string(i) + ".jpg";
      image.utime = 1'000'000 * (i + 1);
      const Rigid3 truth_from_camera(ExpSo3(Vec3(0.02 * i, 0.01, 0.1 * i)),
                                     Vec3(0.3 * std::cos(i), 0.3 * std::sin(i), 0.02 * i));
      for (std::size_t p = 0; p < model.points.size(); ++p) {
        Vec2 pixel;
        if (camera->Project(truth_from_camera.Inverse() * model.points[p].xyz, &pixel) !=
            Projection::kOk) {
          continue;
        }
        model.points[p].track.push_back({i, static_cast<std::int32_t>(image.features.size())});
        image.features.push_back(pixel);
        image.points.push_back(static_cast<std::int32_t>(p));
      }
      Rigid3 moved = world_from_truth * truth_from_camera;
      moved.translation = world_from_truth * (scale * truth_from_camera.translation);
      image.camera_from_world = moved.Inverse();
      model.images.push_back(std::move(image));
    }
    for (ModelPoint& point : model.points) point.xyz = world_from_truth * (scale * point.xyz);
    return model;
  }
};

TEST_F(RsfmToolTest, HelpAndWrongRequests) {
  EXPECT_EQ(Run("--help").exit_code, 0);
  EXPECT_EQ(Run("project --help").exit_code, 0);
  EXPECT_EQ(Run("--version").exit_code, 0);
  EXPECT_EQ(Run("").exit_code, 2);
  EXPECT_EQ(Run("project").exit_code, 2);
  EXPECT_EQ(Run("project --camera x --colour red").exit_code, 2);
  const ProgramResult unknown = Run("frobnicate");
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("error: 'frobnicate' is not a verb"));
}

TEST_F(RsfmToolTest, EvaluateSolversWritesTablesAndFigures) {
  const ProgramResult done =
      Run("evaluate-solvers --figure abs_pose --port dome --noise 0.5,1 --experiments 3 --out " +
          Path("solvers"));
  ASSERT_EQ(done.exit_code, 0) << done.err;
  const auto csv = ReadWholeFile(Path("solvers/abs_pose_dome.csv"));
  ASSERT_TRUE(csv);
  EXPECT_EQ(std::count(csv->begin(), csv->end(), '\n'), 7);  // a header, two levels, three methods
  EXPECT_THAT(*csv, HasSubstr("\n0.5,gp3p_refined,3,0,"));
  EXPECT_TRUE(fs::exists(Path("solvers/abs_pose_dome.svg")));
  EXPECT_TRUE(fs::exists(Path("solvers/abs_pose_dome_bound.csv")));
  const std::string out = " --out " + Path("nothing");
  EXPECT_EQ(Run("evaluate-solvers --figure pose" + out).exit_code, 2);
  EXPECT_EQ(Run("evaluate-solvers --port round" + out).exit_code, 2);
  EXPECT_EQ(Run("evaluate-solvers --experiments 0" + out).exit_code, 2);
  const ProgramResult noise = Run("evaluate-solvers --experiments 1 --noise -1" + out);
  EXPECT_EQ(noise.exit_code, 2);
  EXPECT_THAT(noise.err, HasSubstr("--noise"));
  EXPECT_FALSE(fs::exists(Path("nothing")));
}

TEST_F(RsfmToolTest, ProjectAndBackprojectAreInverse) {
  const std::string camera = Write("camera.yaml", kCamera);
  const std::string pixels = "320 240\n0 0\n640 480\n17.25 400.125\n";
  const ProgramResult rays = Run("backproject --camera " + camera, pixels);
  ASSERT_EQ(rays.exit_code, 0) << rays.err;
  std::string points;
  for (const auto& ray : Numbers(rays.out)) {
    ASSERT_EQ(ray.size(), 6u);
    EXPECT_NEAR(std::hypot(ray[3], ray[4], ray[5]), 1.0, 1e-15);
    EXPECT_NEAR(ray[2], 0.03, 1e-15);  // on the outer surface
    for (int k = 0; k < 3; ++k) points += FormatNumber(ray[k] + 2.0 * ray[k + 3]) + " ";
    points += "\n";
  }
  const ProgramResult back = Run("project --camera " + camera, points);
  ASSERT_EQ(back.exit_code, 0) << back.err;
  const auto found = Numbers(back.out), wanted = Numbers(pixels);
  ASSERT_EQ(found.size(), wanted.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (i == 1 || i == 2) continue;  // corners may come out a rounding beyond the image
    EXPECT_NEAR(found[i][0], wanted[i][0], 1e-10);
    EXPECT_NEAR(found[i][1], wanted[i][1], 1e-10);
  }
}

TEST_F(RsfmToolTest, FailuresSayWhy) {
  const std::string camera = Write("camera.yaml", kCamera);
  const ProgramResult points =
      Run("project --camera " + camera, "0 0 0.01\n0 0 0.025\n5 0 1\nnan 0 1\n0 inf 1\n0 0 1\n");
  EXPECT_EQ(points.exit_code, 0);
  EXPECT_EQ(points.out,
            "nan nan behind_port\nnan nan inside_glass\nnan nan outside_image\n"
            "nan nan not_finite\nnan nan not_finite\n320 240\n");
  const ProgramResult pixels = Run("backproject --camera " + camera, "-1 5\n5 481\nnan 1\n");
  EXPECT_EQ(pixels.exit_code, 0);
  EXPECT_EQ(pixels.out,
            "nan nan nan nan nan nan outside_image\nnan nan nan nan nan nan outside_image\n"
            "nan nan nan nan nan nan not_finite\n");
}

TEST_F(RsfmToolTest, AMalformedLineStopsWithItsNumber) {
  const std::string camera = Write("camera.yaml", kCamera);
  for (const char* bad : {"1 2", "1 2 3 4", "1 2 x", "", "1,2,3", "1 2 1e999"}) {
    const ProgramResult result =
        Run("project --camera " + camera, std::string("0 0 1\n0 0 2\n") + bad + "\n0 0 3\n");
    EXPECT_EQ(result.exit_code, 2) << bad;
    EXPECT_EQ(result.out, "320 240\n320 240\n") << bad;
    EXPECT_THAT(result.err, HasSubstr("standard input:3: is malformed")) << bad;
  }
  EXPECT_EQ(Run("project --camera " + camera, "0 0 1").out, "320 240\n");  // no line end
  EXPECT_EQ(Run("project --camera " + camera, "").exit_code, 0);
  EXPECT_EQ(Run("project --camera " + camera + " >/dev/full", "0 0 1\n").exit_code, 1);
}

TEST_F(RsfmToolTest, AgreesWithTheExactVectors) {
  const fs::path vectors = fs::path(RSFM_SHARED_DATA) / "vectors";
  if (!fs::is_directory(vectors)) GTEST_SKIP() << vectors << " is absent";
  int num_cameras = 0;
  for (const auto& entry : fs::directory_iterator(vectors)) {
    if (!entry.is_directory()) continue;
    ++num_cameras;
    const std::string camera = (entry.path() / "camera.yaml").string();
    const std::string points_text = *ReadWholeFile(entry.path() / "points.csv");
    const std::string pixels_text = *ReadWholeFile(entry.path() / "pixels.csv");
    const auto points = Numbers(points_text), pixels = Numbers(pixels_text);
    const ProgramResult projected = Run("project --camera " + camera, points_text);
    ASSERT_EQ(projected.exit_code, 0) << projected.err;
    const auto found = Numbers(projected.out);
    ASSERT_EQ(found.size(), pixels.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
      EXPECT_NEAR(found[i][0], pixels[i][0], 1e-9) << camera << " line " << i + 1;
      EXPECT_NEAR(found[i][1], pixels[i][1], 1e-9) << camera << " line " << i + 1;
    }
    const ProgramResult rays = Run("backproject --camera " + camera, pixels_text);
    ASSERT_EQ(rays.exit_code, 0) << rays.err;
    const auto lines = Numbers(rays.out);
    ASSERT_EQ(lines.size(), points.size());
    for (std::size_t i = 0; i < lines.size(); ++i) {
      const Vec3 o(lines[i][0], lines[i][1], lines[i][2]);
      const Vec3 d(lines[i][3], lines[i][4], lines[i][5]);
      const Vec3 p(points[i][0], points[i][1], points[i][2]);
      EXPECT_LT(d.cross(p - o).norm(), 1e-10 * p.norm()) << camera << " line " << i + 1;
    }
  }
  EXPECT_GT(num_cameras, 0);
}

struct BadCamera {
  const char* from;
  const char* to;
  const char* message;  // of "error: FILE" + this
};

TEST_F(RsfmToolTest, BadCamerasAreNamedByFileFieldAndFix) {
  const BadCamera cases[] = {
      {"  width: 640\n", "", ":2: camera.width: is missing; add 'width: ...'"},
      {"width: 640", "width: 640\n  widht: 640", ":4: camera.widht: is not a known field; did you"},
      {"width: 640", "width: wide", ":3: camera.width: is 'wide', not a whole number; give a"},
      {"[0, 0, 1]", "[0, 0.1, 1]", ":8: port.normal: is not a unit vector: its length is 1.00498"},
      {"thickness_m: 0.01", "thickness_m: -0.01", ":10: port.thickness_m: is out of range: -0.01"},
      {"index_water: 1.334", "index_water: 0.99", ":12: port.index_water: is out of range: 0.99"},
      {"index_water: 1.334", "index_water: .nan", ":12: port.index_water: is not finite: '.nan'"},
      {"type: flat\n  normal: [0, 0, 1]\n  distance_m: 0.02",
       "type: dome\n  center_m: [0.05, 0, 0]\n  radius_m: 0.04",
       ":8: port.center_m: puts the camera outside its dome: the centre is 0.05 m away"},
  };
  for (const BadCamera& bad : cases) {
    std::string text = kCamera;
    const std::size_t at = text.find(bad.from);
    ASSERT_NE(at, std::string::npos) << bad.from;
    const std::string camera =
        Write("bad.yaml", text.replace(at, std::string(bad.from).size(), bad.to));
    for (const std::string& verb : {"check " + camera, "project --camera " + camera}) {
      const ProgramResult result = Run(verb, "0 0 1\n");
      EXPECT_EQ(result.exit_code, 2) << result.err;
      EXPECT_EQ(result.out, "");
      EXPECT_THAT(result.err, HasSubstr("error: " + camera + bad.message));
    }
  }
}

TEST_F(RsfmToolTest, CheckDescribesAGoodRig) {
  const ProgramResult result = Run("check " + Write("rig.yaml", kCamera));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("is a good rig file"));
  EXPECT_THAT(result.out, HasSubstr("PINHOLE, 640 x 480 px"));
  EXPECT_THAT(result.out, HasSubstr("flat, 20.00 mm away"));
}

TEST_F(RsfmToolTest, EvaluateMeasuresWhatWasMoved) {
  ASSERT_TRUE(WriteModel(MakeModel(Rigid3(), 1.0), Path("truth")));
  const Rigid3 moved(ExpSo3(Vec3(0.5, 1.0, -0.7)), Vec3(4, 5, 6));
  ASSERT_TRUE(WriteModel(MakeModel(moved, 1.0), Path("same_size")));
  Model noisy = MakeModel(Rigid3(), 1.0);
  for (ModelImage& image : noisy.images) {  // each camera 10 mm off along x, turned by 1 degree
    Rigid3 world_from_camera = image.camera_from_world.Inverse();
    world_from_camera.translation.x() += 0.01;
    world_from_camera.rotation =
        world_from_camera.rotation * ExpSo3(Vec3(0, 0, std::numbers::pi / 180));
    image.camera_from_world = world_from_camera.Inverse();
  }
  ASSERT_TRUE(WriteModel(noisy, Path("noisy")));
  // A square far larger than the scene, 5 mm below the points' plane.
  Write("truth/mesh.ply",
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "-9 -9 3.005\n9 -9 3.005\n9 9 3.005\n-9 9 3.005\n4 0 1 2 3\n");

  const ProgramResult same =
      Run("evaluate " + Path("same_size") + " " + Path("truth") + " --align se3 --json");
  ASSERT_EQ(same.exit_code, 0) << same.err;
  const auto json = nlohmann::json::parse(same.out);
  EXPECT_EQ(json.at("images"), 6);
  EXPECT_LT(json.at("rotation_error_deg").get<double>(), 1e-5);
  EXPECT_LT(json.at("position_error_mm").get<double>(), 1e-9);
  EXPECT_NEAR(json.at("point_error_mm").get<double>(), 5.0, 1e-4);
  EXPECT_LT(json.at("reprojection_error_px").get<double>(), 1e-9);

  const ProgramResult off =
      Run("evaluate " + Path("noisy") + " " + Path("truth") + " --align none --json");
  ASSERT_EQ(off.exit_code, 0) << off.err;
  EXPECT_NEAR(nlohmann::json::parse(off.out).at("rotation_error_deg").get<double>(), 1.0, 1e-9);
  EXPECT_NEAR(nlohmann::json::parse(off.out).at("position_error_mm").get<double>(), 10.0, 1e-9);
  EXPECT_NEAR(nlohmann::json::parse(off.out).at("position_rmse_mm").get<double>(), 10.0, 1e-9);

  ASSERT_TRUE(WriteModel(MakeModel(moved, 3.0), Path("large")));
  const ProgramResult large = Run("evaluate " + Path("large") + " " + Path("truth") + " --json");
  ASSERT_EQ(large.exit_code, 0) << large.err;
  EXPECT_NEAR(nlohmann::json::parse(large.out).at("scale").get<double>(), 1.0 / 3.0, 1e-9);
  EXPECT_LT(nlohmann::json::parse(large.out).at("position_error_mm").get<double>(), 1e-9);

  fs::remove(Path("truth/mesh.ply"));
  const ProgramResult no_mesh = Run("evaluate " + Path("noisy") + " " + Path("truth") + " --json");
  EXPECT_TRUE(nlohmann::json::parse(no_mesh.out).at("point_error_mm").is_null());
  EXPECT_EQ(Run("evaluate " + Path("noisy") + " " + Path("truth")).exit_code, 0);
}

TEST_F(RsfmToolTest, EvaluateReadsTumAndCsv) {
  const Model model = MakeModel(Rigid3(), 1.0);
  ASSERT_TRUE(WriteModel(model, Path("model")));
  ASSERT_EQ(Run("export " + Path("model") + " --format tum --out " + Path("t.tum")).exit_code, 0);
  const ProgramResult tum = Run("evaluate " + Path("model") + " " + Path("t.tum") + " --json");
  ASSERT_EQ(tum.exit_code, 0) << tum.err;
  EXPECT_EQ(nlohmann::json::parse(tum.out).at("images"), 6);
  EXPECT_LT(nlohmann::json::parse(tum.out).at("rotation_error_deg").get<double>(), 1e-5);

  std::string csv = "image,x_cm,z_cm\n";
  for (const ModelImage& image : model.images) {
    const Vec3 p = image.camera_from_world.Inverse().translation;
    csv += image.name + "," + FormatNumber(100 * p.x()) + "," + FormatNumber(100 * p.z()) + "\n";
  }
  const ProgramResult planar =
      Run("evaluate " + Path("model") + " " + Write("g.csv", csv) + " --align none --json");
  ASSERT_EQ(planar.exit_code, 0) << planar.err;
  const auto json = nlohmann::json::parse(planar.out);
  EXPECT_TRUE(json.at("rotation_error_deg").is_null());
  double sum = 0.0;  // what is missing is y
  for (const ModelImage& image : model.images) {
    sum += 1e3 * std::abs(image.camera_from_world.Inverse().translation.y());
  }
  EXPECT_NEAR(json.at("position_error_mm").get<double>(), sum / 6, 1e-9);

  const ProgramResult others =
      Run("evaluate " + Path("model") + " " + Write("h.csv", "image,x_m\nother.jpg,1\n"));
  EXPECT_EQ(others.exit_code, 2);
  EXPECT_THAT(others.err, HasSubstr("by name or by time"));
}

TEST_F(RsfmToolTest, ExportRoundTripsAndRefuses) {
  ASSERT_TRUE(WriteModel(MakeModel(Rigid3(), 1.0), Path("model")));
  for (const std::string format : {"colmap-txt", "colmap-bin", "colmap-underwater"}) {
    const ProgramResult result =
        Run("export " + Path("model") + " --format " + format + " --out " + Path(format));
    ASSERT_EQ(result.exit_code, 0) << result.err;
    const auto model = ReadModel(Path(format));
    ASSERT_TRUE(model);
    EXPECT_EQ(model->points.size(), 25u);
    EXPECT_EQ(model->rig.camera.port.type, PortType::kFlat);
  }
  EXPECT_EQ(Run("export " + Path("model") + " --format ply --out " + Path("m.ply")).exit_code, 0);
  const ProgramResult kml = Run("export " + Path("model") + " --format kml --out " + Path("m.kml"));
  EXPECT_EQ(kml.exit_code, 2);
  EXPECT_THAT(kml.err, HasSubstr("is not on earth"));
  EXPECT_FALSE(fs::exists(Path("m.kml")));
  EXPECT_EQ(Run("export " + Path("model") + " --format obj --out " + Path("x")).exit_code, 2);
  EXPECT_EQ(Run("export " + Path("absent") + " --format ply --out " + Path("x")).exit_code, 2);
  Write("precious/thesis.txt", "1");
  const ProgramResult precious =
      Run("export " + Path("model") + " --format colmap-txt --out " + Path("precious"));
  EXPECT_EQ(precious.exit_code, 2);
  EXPECT_TRUE(fs::exists(Path("precious/thesis.txt")));
}

TEST_F(RsfmToolTest, AFullDiskLeavesNothingBehind) {
  ASSERT_TRUE(WriteModel(MakeModel(Rigid3(), 1.0), Path("model")));
  fs::create_directory(Path("disk"));
  if (::geteuid() != 0 || ::mount("tmpfs", Path("disk").c_str(), "tmpfs", 0, "size=4k") != 0) {
    GTEST_SKIP() << "a small tmpfs cannot be mounted here";
  }
  for (const std::string format : {"colmap-txt", "colmap-bin"}) {
    const ProgramResult result =
        Run("export " + Path("model") + " --format " + format + " --out " + Path("disk/out"));
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_THAT(result.err, HasSubstr("No space left on device; free space"));
    EXPECT_EQ(std::distance(fs::directory_iterator(Path("disk")), {}), 0);
  }
  EXPECT_EQ(::umount2(Path("disk").c_str(), MNT_DETACH), 0);
}

TEST_F(RsfmToolTest, InfoTellsWhatAMissionLogLost) {
  fs::create_directory(Path("mission"));
  {
    auto writer = MissionWriter::Create(Path("mission"), *ParseRig(kCamera, "camera"));
    ASSERT_TRUE(writer);
    for (int i = 0; i < 3; ++i) {
      PoseOutput pose;
      pose.utime = i;
      pose.state = pose_t::STATE_TRACKING;
      ASSERT_TRUE(writer->Log("RSFM_POSE", i, MakePose(pose, World())));
    }
    ASSERT_TRUE(writer->Close());
  }
  const ProgramResult whole = Run("info " + Path("mission"));
  EXPECT_EQ(whole.exit_code, 0) << whole.err;
  EXPECT_THAT(whole.out, HasSubstr("damage        none"));
  EXPECT_THAT(whole.out, HasSubstr("poses         3, of which 3 tracked"));
  const std::string log = *ReadWholeFile(Path("mission/events.lcm"));
  Write("mission/events.lcm", log.substr(0, log.size() - 50));
  const ProgramResult cut = Run("info " + Path("mission"));
  EXPECT_EQ(cut.exit_code, 0) << cut.err;
  EXPECT_THAT(cut.out, HasSubstr("cut           the last event is cut off"));
  EXPECT_THAT(cut.out, HasSubstr("poses         2, of which 2 tracked"));
  EXPECT_EQ(Run("info " + Path("mission/events.lcm")).exit_code, 0);

  EXPECT_EQ(Run("info " + Path("absent")).exit_code, 2);
  const ProgramResult noise = Run("info " + Write("noise", std::string(5000, '\xED')));
  EXPECT_EQ(noise.exit_code, 2);
  fs::create_directory(Path("empty"));
  const ProgramResult empty = Run("info " + Path("empty"));
  EXPECT_EQ(empty.exit_code, 2);
  EXPECT_THAT(empty.err, HasSubstr(Path("empty")));
}

}  // namespace
}  // namespace rsfm
