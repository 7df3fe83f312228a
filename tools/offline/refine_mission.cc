#include "tools/offline/refine_mission.h"

#include <algorithm>
#include <cmath>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/tables.h"
#include "tools/offline/uwpinhole.h"

namespace rsfm {
namespace {

struct Loaded {
  Scene scene;
  Rig rig;
  std::vector<NavSample> nav;
  std::vector<ImageTime> images;
  std::optional<RefineResult::Water> water;
};

// What the mission says of the water goes before the rig file.
void UseWater(const Mission& mission, Loaded* loaded) {
  PortConfig& port = loaded->scene.camera.port;
  if (port.type == PortType::kNone || mission.waters.empty()) return;
  std::vector<double> indices;
  for (const SceneImage& image : loaded->scene.images)
    if (image.placed) indices.push_back(mission.IndexWaterAt(image.utime));
  if (indices.empty()) return;
  std::sort(indices.begin(), indices.end());
  loaded->water = {port.index_water, indices[indices.size() / 2], indices.front(), indices.back()};
  port.index_water = loaded->water->used;
}

IoExpected<Loaded> LoadMission(const RefineRequest& request) {
  auto mission = ReadMission(request.input);
  if (!mission) return Fail(mission.error());
  if (mission->keyframes.size() < 2) {
    return Fail({Errc::kNotEnoughData, (request.input / kEventsFile).string(), "RSFM_KEYFRAME",
                 "holds " + std::to_string(mission->keyframes.size()) +
                     " keyframe(s); refinement needs two",
                 "map the images first: rsfm_tool map"});
  }
  Loaded loaded;
  loaded.scene = SceneFromMission(*mission);
  loaded.rig = mission->rig;
  loaded.nav = std::move(mission->nav);
  loaded.images = std::move(mission->images);
  UseWater(*mission, &loaded);
  return loaded;
}

IoExpected<Loaded> LoadModel(const RefineRequest& request) {
  auto model = ReadModel(request.input);
  if (!model) return Fail(model.error());
  if (model->cameras.size() != 1) {
    return Fail({Errc::kUnsupported, request.input.string(), "cameras",
                 "has " + std::to_string(model->cameras.size()) + " cameras",
                 "give a model with one camera"});
  }
  if (model->images.size() < 2) {
    return Fail({Errc::kNotEnoughData, request.input.string(), "images",
                 "holds fewer than two images", "give a model with more"});
  }
  Loaded loaded;
  loaded.scene = SceneFromModel(*model);
  loaded.rig = model->rig;
  for (const ModelImage& image : model->images)
    if (image.utime > 0) loaded.images.push_back({image.name, image.utime});
  return loaded;
}

IoStatus LoadNavigation(const RefineRequest& request, Loaded* loaded) {
  if (!request.nav) return {};
  auto table = ReadNavTable(*request.nav, loaded->images, loaded->rig.world.origin);
  if (!table) return Fail(table.error());
  loaded->nav = std::move(table->samples);
  loaded->rig.world.origin = table->origin;
  return {};
}

void ChooseParameters(const RefineRequest& request, RefineSceneOptions* options) {
  BundleOptions* bundle = &options->bundle;
  // A lens comes from a calibration, near enough to judge matches by; a port often from a drawing.
  options->settle_first = !request.refine_port;
  if (request.refine_lens)
    bundle->lens.focal = bundle->lens.principal_point = bundle->lens.distortion = true;
  if (request.uwpinhole) {
    bundle->lens = RefineUwPinhole();
  } else if (request.refine_port) {
    bundle->port.normal = bundle->port.distance = bundle->port.center = true;
  }
}

// In whose frame the result is, and whether its scale means metres.
void DescribeWorld(const NavigationAlignment& alignment, bool from_scratch, Scene* scene,
                   World* world) {
  if (alignment.attitude) {
    world->frame = WorldFrame::kNed;
    world->scale_is_metric = alignment.scale || (!from_scratch && world->scale_is_metric);
    return;
  }
  if (!from_scratch) return;
  world->frame = WorldFrame::kFirstCamera;
  world->scale_is_metric = false;
  const auto first = std::find_if(scene->images.begin(), scene->images.end(),
                                  [](const SceneImage& image) { return image.placed; });
  if (first == scene->images.end()) return;
  const Rigid3 first_from_world = first->camera_from_world;
  const Rigid3 world_from_first = first_from_world.Inverse();
  for (SceneImage& image : scene->images)
    if (image.placed) image.camera_from_world = image.camera_from_world * world_from_first;
  for (ScenePoint& point : scene->points) point.xyz = first_from_world * point.xyz;
}

Diagnostic Explain(const RefineRequest& request, const Error& error) {
  Diagnostic d{error.code, request.input.string(), error.where, "", ""};
  switch (error.code) {
    case Errc::kDegenerate:
      d.problem = "no two images share enough of the scene under a wide enough angle to begin with";
      d.fix = "check that the images overlap and that the camera of rig.yaml is theirs";
      break;
    case Errc::kNotEnoughData:
      d.problem = "too little to refine";
      d.fix = "give a mission with two images or more that share landmarks";
      break;
    case Errc::kNotConverged:
      d.problem = "the adjustment failed";
      d.fix = "check the camera and port of rig.yaml";
      break;
    default:
      d.problem = ToString(error.code);
      break;
  }
  return d;
}

}  // namespace

IoExpected<RefineResult> Refine(const RefineRequest& request) {
  auto loaded = IsMissionFolder(request.input) ? LoadMission(request) : LoadModel(request);
  if (!loaded) return Fail(loaded.error());
  if (const IoStatus status = LoadNavigation(request, &*loaded); !status)
    return Fail(status.error());
  RefineResult result;
  Scene& scene = loaded->scene;
  result.num_images = static_cast<int>(scene.images.size());
  if (request.uwpinhole) {
    const auto without_port = DropPort(scene.camera);
    if (!without_port) {
      return Fail({Errc::kDegenerate, request.input.string(), "camera",
                   "no perspective camera comes near this one", "leave --uwpinhole out"});
    }
    scene.camera = *without_port;
  }
  result.camera_before = scene.camera;
  if (!request.uwpinhole) result.water = loaded->water;
  NavigationFit navigation({loaded->nav, loaded->rig.body_from_camera, loaded->rig.mapper},
                           request.mount);
  RefineSceneOptions options = request.scene;
  options.progress = request.progress;
  ChooseParameters(request, &options);
  if (!loaded->rig.world.scale_is_metric && RaysTellScale(scene.camera.port.type, options.bundle))
    options.bundle.scale_sigma = kSoftScale;
  if (loaded->nav.empty() && request.mount.Any()) {
    return Fail({Errc::kNotEnoughData, request.input.string(), "navigation",
                 "has no sample that a camera's mount or a clock could be compared with",
                 "give navigation with --nav, or leave --refine-mount and --refine-clock out"});
  }
  if (!loaded->nav.empty())
    options.navigate = [&](Scene* s) { result.alignment = navigation.Apply(s); };
  options.navigate_each_round = request.mount.Any();
  auto report = RefineScene(options, &scene);
  if (!report) return Fail(Explain(request, report.error()));
  result.scene = std::move(*report);
  result.camera_after = scene.camera;
  result.mount = navigation.estimates();
  loaded->rig.body_from_camera = navigation.input().body_from_camera;
  if (result.scene.interrupted) return result;
  const auto observability = AnalyseObservability(result.scene.bundle, options.bundle,
                                                  {result.camera_before}, ToBundle(scene).problem);
  if (observability) result.observability = *observability;
  DescribeWorld(result.alignment, result.scene.from_scratch, &scene, &loaded->rig.world);
  result.model = ModelFromScene(scene, loaded->rig);
  return result;
}

IoStatus WriteRefined(const RefineRequest& request, const RefineResult& result) {
  auto folder = AtomicFolder::Create(request.out, Existing::kReplace);
  if (!folder) return Fail(folder.error());
  if (const IoStatus status = WriteModelFiles(result.model, folder->aside()); !status)
    return status;
  if (const IoStatus status =
          WriteFileAtomically(folder->aside() / "report.json", FormatRefineReport(request, result));
      !status)
    return status;
  return folder->Commit();
}

}  // namespace rsfm
