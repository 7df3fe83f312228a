// Incremental reconstruction: a pair to start with, then image after image, bundle adjustment of a
// window after each and of everything as the map grows; what does not connect begins another model.
// [Schoenberger & Frahm 2016, CVPR, "Structure-from-Motion Revisited"]
//
// Scale: with navigation from it; from the first pair's baseline where its length is known, held.
// Else from the bent rays where they tell it (RaysTellScale), kept by a prior of 100 % from leaping
// between adjustments; where they do not it is that of the first pair, held.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tools/offline/placing.h"
#include "tools/reconstruction/map_snapshot.h"
#include "tools/reconstruction/start_pair.h"

namespace rsfm {

struct IncrementalOptions {
  StartOptions start;
  PlacingOptions placing;
  BundleOptions bundle;  // what it refines of lens and port is refined once the map is big enough
  FilterOptions filter;
  TrackOptions tracks;
  double growth = 0.2;     // more images since the last global adjustment: another one
  int growth_images = 80;  // or this many more
  int window_from = 12;    // images from which on windows are adjusted between global adjustments
  int refine_from = 8;     // images from which on lens and port are refined while it grows
  int min_model_images = 3;
  int max_models = 20;
  int max_rounds = 4;         // of adjustment, filter and completion when all images are placed
  double min_change = 0.002;  // the rounds end when observations change by no more than this
  double min_improvement = 0.002;  // and the mean error falls by no more than this
  // Brings the scene into navigation's frame and sets its priors.
  std::function<void(Scene*)> navigate;
  // More matches between the placed images of `scene` for `pairs`, those that were given, when no
  // image is left to place.
  std::function<void(const Scene& scene, std::vector<VerifiedPair>* pairs)> match_again;
  // What is being done, how far (0 ... 1); false stops.
  std::function<bool(const std::string&, double)> progress;
  // The state as it can be continued from; false where it cannot be written.
  std::function<bool(const std::string&)> checkpoint;
};

struct ModelReport {
  StartPair start;
  bool scale_held = true;  // neither navigation nor the bent rays determine it
  int num_images = 0, num_points = 0, num_observations = 0;
  int rounds = 0;
  int times_taken_off = 0;   // that contradicted images have been taken off and placed again
  int num_contradicted = 0;  // images that are contradicted still (consistency.h)
  int num_unconfirmed_outliers = 0;  // points removed at the end (unconfirmed_points.h)
  double sigma_px = 1.0, loss_scale = 1.0;  // of the last adjustment (FitNoise)
  BundleReport last_bundle;
  ErrorSummary errors;
};

struct IncrementalModel {
  MapSnapshot map;
  ModelReport report;
};

struct IncrementalResult {
  bool interrupted = false;
  bool resumed = false;
  int num_global_adjustments = 0;
  double seconds_placing = 0.0, seconds_windows = 0.0, seconds_global = 0.0, seconds_tracks = 0.0;
  std::vector<IncrementalModel> models;  // the largest first
};

// `scene` has images with features, none placed; it is worked upon. `resume_from`: a checkpoint of
// a run with the same scene and pairs, or empty; what is none is taken for empty. The result does
// not depend on where a run was stopped. Errors:
//   kDegenerate    no pair of images is good enough to begin with
//   kNotConverged  the solver failed outright
Expected<IncrementalResult> ReconstructIncrementally(const IncrementalOptions& options,
                                                     const std::vector<VerifiedPair>& pairs,
                                                     const std::string& resume_from, Scene* scene);

}  // namespace rsfm
