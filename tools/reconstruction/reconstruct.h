// rsfm_tool reconstruct: a folder of images, in any order, to the models that they give.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "rsfm/io/model.h"
#include "tools/offline/image_navigation.h"
#include "tools/offline/navigation_fit.h"
#include "tools/offline/observability.h"
#include "tools/reconstruction/extraction.h"
#include "tools/reconstruction/incremental.h"
#include "tools/reconstruction/match_store.h"
#include "tools/reconstruction/pair_selection.h"

namespace rsfm {

struct ReconstructRequest {
  std::filesystem::path images;  // a folder of images, or a mission folder
  std::filesystem::path camera;  // a rig or camera file
  std::filesystem::path out;     // model folder
  // Where features, matches and checkpoints are kept between runs; empty: `out` + ".work".
  std::filesystem::path work;
  std::optional<std::filesystem::path> nav;    // NAV.csv
  std::optional<std::filesystem::path> times;  // IMAGES.csv
  bool refine_port = false;
  bool refine_lens = false;
  bool uwpinhole = false;
  MountOptions mount;
  bool guided = false;            // more matches along epipolar curves when all is placed
  bool nav_scale_only = false;    // navigation gives the first pair's baseline and nothing else
  double first_baseline_m = 0.0;  // length of the first pair's baseline, where it is known; 0: not
  std::uint64_t seed = 1;
  int num_threads = 2;
  ExtractionOptions extraction;
  PairSelectionOptions selection;
  MatchStoreOptions matching;
  MatchOptions verification;
  IncrementalOptions incremental;
  std::function<bool(const std::string&, double)> progress;
};

// One of the models, as it is written.
struct ReconstructedModel {
  Model model;
  ModelReport report;
  CameraConfig camera;
  NavigationAlignment alignment;                     // all false without navigation
  std::optional<NavigationResiduals> residuals;      // with navigation
  std::vector<ParameterEstimate> mount;              // and its clock, where asked for
  std::optional<ObservabilityReport> observability;  // none where the poses are not determined
};

struct ReconstructResult {
  bool interrupted = false;
  bool resumed = false;  // from a checkpoint of mapping
  int num_offered = 0;   // images in the folder
  Extraction extraction;
  std::vector<LeftOutImage> not_placed;  // images that are in no model, and why
  PairSelection selection;               // without its pairs
  MatchSummary matching;
  int num_verified_pairs = 0;
  std::int64_t num_verified_matches = 0;
  std::int64_t num_guided_matches = 0;  // besides, in all models
  double range_m = 0.0;                 // of the scene, roughly, as the verification saw it
  CameraConfig camera_before;
  std::vector<ReconstructedModel> models;  // the largest first
  std::vector<std::string> warnings;       // what the user should know before trusting the result
  int num_global_adjustments = 0;
  double seconds_extraction = 0.0, seconds_selection = 0.0, seconds_matching = 0.0,
         seconds_verification = 0.0, seconds_mapping = 0.0;
  double seconds_placing = 0.0, seconds_windows = 0.0, seconds_global = 0.0,
         seconds_tracks = 0.0;  // of mapping
};

std::filesystem::path WorkFolder(const ReconstructRequest& request);

// Reads and reconstructs; writes nothing but the working folder. A run that is interrupted
// continues where it was when the same request comes again.
IoExpected<ReconstructResult> Reconstruct(const ReconstructRequest& request);

// What is to be said of models that do not connect, images that are not in them or contradict each
// other, and cameras that do not describe the images.
std::vector<std::string> ModelWarnings(const ReconstructResult& result);

// report.json: what was used and what not, timings, errors, what scale and frame mean, warnings.
std::string FormatReconstructReport(const ReconstructRequest& request,
                                    const ReconstructResult& result);

// The model folder with report.json in it, at once; further models in model_2, model_3 ... in it.
IoStatus WriteReconstruction(const ReconstructRequest& request, const ReconstructResult& result);

}  // namespace rsfm
