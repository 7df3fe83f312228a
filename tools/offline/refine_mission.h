// rsfm_tool refine: a mission, or a model, to the best model that its features and navigation give.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "rsfm/io/diagnostic.h"
#include "rsfm/io/mission.h"
#include "rsfm/io/model.h"
#include "tools/offline/navigation_fit.h"
#include "tools/offline/observability.h"
#include "tools/offline/refine_scene.h"

namespace rsfm {

struct RefineRequest {
  std::filesystem::path input;               // mission or model folder
  std::filesystem::path out;                 // model folder
  std::optional<std::filesystem::path> nav;  // in place of the mission's own navigation
  bool refine_port = false;
  bool refine_lens = false;
  MountOptions mount;
  bool uwpinhole = false;    // the baseline: no port, a lens that is made to absorb it
  RefineSceneOptions scene;  // its progress and navigate are set here
  std::function<bool(const std::string&, double)> progress;
};

struct RefineResult {
  RefineSceneReport scene;
  NavigationAlignment alignment;
  std::vector<ParameterEstimate> mount;  // camera's mount and navigation's clock, where asked for
  std::optional<ObservabilityReport> observability;  // none where the poses are not determined
  CameraConfig camera_before, camera_after;
  int num_images = 0;  // offered
  // The index of water that the mapper had, over the images it placed; one is used for all of them:
  // the median. Nothing where there is no port or the mission does not say.
  struct Water {
    double rig = 0.0, used = 0.0, low = 0.0, high = 0.0;
  };
  std::optional<Water> water;
  Model model;
};

// Reads, refines; writes nothing. An interruption is kept in result.scene.interrupted.
IoExpected<RefineResult> Refine(const RefineRequest& request);

// report.json: errors before and after, timings, rounds, what was found and how well determined.
std::string FormatRefineReport(const RefineRequest& request, const RefineResult& result);

// The model folder with report.json in it, at once.
IoStatus WriteRefined(const RefineRequest& request, const RefineResult& result);

// What refinement starts from. Keyframes that the mapper tracked in its largest map are placed.
Scene SceneFromMission(const Mission& mission);
Scene SceneFromModel(const Model& model);

}  // namespace rsfm
