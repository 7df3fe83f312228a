// From a mission folder to a model folder, and what is said about input that cannot be refined.
#include "tools/offline/refine_mission.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "rsfm/io/atomic_output.h"
#include "rsfm/mapping/incremental_mapper.h"
#include "tests/offline/alignment.h"
#include "tests/offline/made_scene.h"
#include "tests/support/rigs.h"
#include "tests/support/temporary_folder.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

Survey MakeTruth(const CameraConfig& config) {
  SurveyOptions options;
  options.images_per_line = 4;
  options.num_points = 700;
  options.noise_px = 0.4;
  return MakeSurvey(*AnyCamera::Create(config), options);
}

keyframe_t ToMessage(const Scene& scene, int index) {
  const SceneImage& image = scene.images[index];
  keyframe_t k{};
  k.utime = image.utime;
  k.id = index;
  k.image = image.name;
  const Quat& q = image.camera_from_world.rotation;
  const Vec3& t = image.camera_from_world.translation;
  const double values[] = {q.w(), q.x(), q.y(), q.z()};
  std::copy(values, values + 4, k.camera_from_world_q);
  std::copy(t.data(), t.data() + 3, k.camera_from_world_t);
  k.state = static_cast<std::int32_t>(image.placed ? MapperState::kTracking : MapperState::kLost);
  k.num_features = static_cast<std::int32_t>(image.features.size());
  for (std::size_t f = 0; f < image.features.size(); ++f) {
    k.x_px.push_back(static_cast<float>(image.features[f].x()));
    k.y_px.push_back(static_cast<float>(image.features[f].y()));
    k.size_px.push_back(image.sizes_px[f]);
    k.landmark_id.push_back(image.points[f] == kNoPoint ? -1 : image.points[f] + 1000);
  }
  k.descriptor_type = keyframe_t::DESCRIPTOR_SIFT;
  k.descriptor_bytes = 128;
  k.descriptors = image.descriptors;
  k.num_descriptor_bytes = static_cast<std::int32_t>(k.descriptors.size());
  return k;
}

landmarks_t LandmarksOf(const Scene& scene) {
  landmarks_t message{};
  for (std::size_t p = 0; p < scene.points.size(); ++p) {
    if (scene.points[p].track.empty()) continue;
    ++message.num;
    message.id.push_back(static_cast<std::int32_t>(p) + 1000);
    message.x.push_back(scene.points[p].xyz.x());
    message.y.push_back(scene.points[p].xyz.y());
    message.z.push_back(scene.points[p].xyz.z());
    for (auto* colour : {&message.r, &message.g, &message.b}) colour->push_back(200);
  }
  return message;
}

void WriteMission(const Scene& scene, int num_keyframes, const fs::path& folder) {
  fs::create_directories(folder);
  Rig rig;
  rig.camera = scene.camera;
  rig.world.frame = WorldFrame::kFirstCamera;
  rig.world.scale_is_metric = false;
  auto writer = MissionWriter::Create(folder, rig);
  ASSERT_TRUE(writer) << ToString(writer.error());
  for (int k = 0; k < num_keyframes; ++k)
    ASSERT_TRUE(writer->Log("RSFM_KEYFRAME", scene.images[k].utime, ToMessage(scene, k)));
  ASSERT_TRUE(writer->Log("RSFM_LANDMARKS", scene.images.back().utime, LandmarksOf(scene)));
  ASSERT_TRUE(writer->Close());
}

class RefineMissionTest : public testing::Test {
 protected:
  RefineRequest Request() {
    RefineRequest request;
    request.input = folder_.path() / "mission";
    request.out = folder_.path() / "model";
    request.scene.match.num_threads = request.scene.bundle.num_threads = 1;
    return request;
  }
  Alignment Align(const Model& model) const {
    std::vector<Vec3> found, places;
    for (const ModelImage& image : model.images) {
      found.push_back(image.camera_from_world.OriginOfTarget());
      places.push_back(truth_.camera_from_world[image.utime / 1'000'000 - 1].OriginOfTarget());
    }
    return AlignPlaces(found, places);
  }
  TemporaryFolder folder_;
  CameraConfig config_ = FlatRig();
  Survey truth_ = MakeTruth(config_);
};

TEST_F(RefineMissionTest, ModelFolderHasItAll) {
  Survey drifted = truth_;
  Disturb(&drifted, 1, 0.003, 0.01, 0.03, 4);
  Scene scene = MakeScene(config_, drifted);
  scene.Unplace(5);
  WriteMission(scene, 8, folder_.path() / "mission");
  RefineRequest request = Request();
  request.refine_port = request.refine_lens = true;
  const auto result = Refine(request);
  ASSERT_TRUE(result) << ToString(result.error());
  EXPECT_EQ(result->model.images.size(), 8u);
  ASSERT_TRUE(WriteRefined(request, *result));

  const auto model = ReadModel(request.out);
  ASSERT_TRUE(model) << ToString(model.error());
  EXPECT_TRUE(Validate(*model));
  EXPECT_EQ(model->images.size(), 8u);
  EXPECT_EQ(model->cameras[0].config.port.type, PortType::kFlat);
  EXPECT_LT(Align(*model).rms_m, 0.01);
  EXPECT_NEAR(model->cameras[0].config.lens_params[0] / config_.lens_params[0], 1.0, 0.01);

  std::ifstream file(request.out / "report.json");
  const nlohmann::json report = nlohmann::json::parse(file);
  EXPECT_EQ(report["images"]["placed_before"], 7);
  EXPECT_EQ(report["images"]["placed"], 8);
  EXPECT_GT(report["before"]["mean_error_px"].get<double>(), 2.0);
  EXPECT_LT(report["after"]["mean_error_px"].get<double>(), 0.52);
  EXPECT_EQ(report["world"]["scale"], "held");
  // fx fy cx cy, two of the normal, the distance.
  EXPECT_EQ(report["observability"]["parameters"].size(), 7u);
  for (const auto& parameter : report["observability"]["parameters"]) {
    EXPECT_TRUE(parameter["verdict"].is_string());
    EXPECT_GT(parameter["sigma"].get<double>(), 0.0);
  }
}

TEST_F(RefineMissionTest, NavigationTableGivesMetres) {
  Survey shrunk = truth_;
  for (Rigid3& pose : shrunk.camera_from_world) pose.translation *= 0.4;
  for (Vec3& point : shrunk.points) point *= 0.4;
  WriteMission(MakeScene(config_, shrunk), 8, folder_.path() / "mission");
  std::ofstream nav(folder_.path() / "nav.csv");
  nav << "utime,north_m,east_m,down_m,sigma_north_m,sigma_east_m,sigma_down_m\n";
  for (std::size_t k = 0; k < 8; ++k) {
    const Vec3 place = truth_.camera_from_world[k].OriginOfTarget();
    nav << 1'000'000 * (k + 1) << ',' << place.x() << ',' << place.y() << ',' << place.z()
        << ",0.02,0.02,0.02\n";
  }
  nav.close();
  RefineRequest request = Request();
  request.nav = folder_.path() / "nav.csv";
  const auto result = Refine(request);
  ASSERT_TRUE(result) << ToString(result.error());
  EXPECT_EQ(result->model.rig.world.frame, WorldFrame::kNed);
  EXPECT_TRUE(result->model.rig.world.scale_is_metric);
  for (const ModelImage& image : result->model.images) {
    const Vec3 truth = truth_.camera_from_world[image.utime / 1'000'000 - 1].OriginOfTarget();
    EXPECT_LT((image.camera_from_world.OriginOfTarget() - truth).norm(), 0.03);
  }
}

// The usual approximation: no port, and a map that is worse for it.
TEST_F(RefineMissionTest, UwPinholeDropsThePort) {
  WriteMission(MakeScene(config_, truth_), 8, folder_.path() / "mission");
  RefineRequest request = Request();
  const auto refractive = Refine(request);
  ASSERT_TRUE(refractive);
  request.uwpinhole = true;
  const auto pinhole = Refine(request);
  ASSERT_TRUE(pinhole) << ToString(pinhole.error());
  EXPECT_EQ(pinhole->camera_after.port.type, PortType::kNone);
  EXPECT_GT(pinhole->camera_after.lens_params[0], 1.1 * config_.lens_params[0]);
  EXPECT_GT(pinhole->scene.errors.mean_px, refractive->scene.errors.mean_px);
  EXPECT_GT(Align(pinhole->model).rms_m, Align(refractive->model).rms_m);
}

TEST_F(RefineMissionTest, AModelIsRefinedToo) {
  Survey drifted = truth_;
  Disturb(&drifted, 1, 0.003, 0.01, 0.03, 4);
  const Scene scene = MakeScene(config_, drifted);
  Rig rig;
  rig.camera = config_;
  ASSERT_TRUE(WriteModel(ModelFromScene(scene, rig), folder_.path() / "mission"));
  const auto result = Refine(Request());
  ASSERT_TRUE(result) << ToString(result.error());
  EXPECT_EQ(result->model.images.size(), 8u);
  EXPECT_LT(result->scene.errors.mean_px, 0.52);
}

TEST_F(RefineMissionTest, OneKeyframeIsNotEnough) {
  WriteMission(MakeScene(config_, truth_), 1, folder_.path() / "mission");
  const auto result = Refine(Request());
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().file.find("events.lcm"), std::string::npos);
  EXPECT_EQ(result.error().field, "RSFM_KEYFRAME");
  EXPECT_FALSE(result.error().fix.empty());
}

TEST_F(RefineMissionTest, MissingInputNamesIt) {
  const auto result = Refine(Request());
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().file.find("mission"), std::string::npos);
  EXPECT_EQ(ExitCode(result.error()), 2);
}

TEST_F(RefineMissionTest, ForeignFolderIsNotReplaced) {
  WriteMission(MakeScene(config_, truth_), 8, folder_.path() / "mission");
  fs::create_directories(folder_.path() / "model");
  std::ofstream(folder_.path() / "model" / "thesis.txt") << "four years";
  const RefineRequest request = Request();
  const auto result = Refine(request);
  ASSERT_TRUE(result);
  EXPECT_FALSE(WriteRefined(request, *result));
  EXPECT_TRUE(fs::exists(folder_.path() / "model" / "thesis.txt"));
}

TEST_F(RefineMissionTest, BrokenNavigationTableIsNamed) {
  WriteMission(MakeScene(config_, truth_), 8, folder_.path() / "mission");
  std::ofstream(folder_.path() / "nav.csv") << "utime,north_m,east_m,down_m\n1000000,nan,0,0\n";
  RefineRequest request = Request();
  request.nav = folder_.path() / "nav.csv";
  const auto result = Refine(request);
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().file.find("nav.csv"), std::string::npos);
  EXPECT_EQ(result.error().line, 2);
}

}  // namespace
}  // namespace rsfm
