// From the on-board map, or from nothing but matches, to the best model: place what is not placed,
// then rounds of bundle adjustment, filtering and track completion until the error stops improving.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tools/offline/bundle.h"
#include "tools/offline/guided_matching.h"
#include "tools/offline/matching.h"
#include "tools/offline/placing.h"
#include "tools/offline/scene.h"
#include "tools/offline/tracks.h"

namespace rsfm {

struct RefineSceneOptions {
  MatchOptions match;
  PlacingOptions placing;
  BundleOptions bundle;  // of the rounds; lens and port are refined in these only
  FilterOptions filter;
  TrackOptions tracks;
  int max_rounds = 12;
  bool settle_first = true;  // rounds with lens and port as they are, before those that refine them
  // With it, once all poses are known, more matches are sought along the epipolar curves.
  std::optional<GuidedMatchOptions> guided;
  // The rounds end when the number of observations changes by no more than this part, ...
  double min_change = 0.002;
  double min_improvement = 0.001;  // ... and the mean error falls by no more than this part
  double growth = 0.15;            // more images since the last global adjustment: another one
  // Brings the scene into navigation's frame and sets its priors, where there is navigation. Called
  // with the map as it comes, if one does, again when all images are placed, and before each round
  // where it estimates something itself.
  std::function<void(Scene*)> navigate;
  bool navigate_each_round = false;
  // What is being done, how far (0 ... 1); false stops.
  std::function<bool(const std::string&, double)> progress;
};

struct RefineRound {
  bool refines_camera = false;  // lens or port
  double sigma_px = 1.0;        // of an observation
  BundleReport bundle;
  FilterReport filter;
  TrackReport tracks;
  double mean_error_px = 0.0;  // after the round
  int num_images = 0, num_points = 0, num_observations = 0;
};

struct RefineSceneReport {
  bool interrupted = false;
  bool from_scratch = false;  // no image was placed before
  int placed_before = 0;
  int observations_before = 0;
  double mean_error_before_px = 0.0;
  int num_pairs = 0;  // tried
  int num_verified_pairs = 0;
  int num_matches = 0;
  int num_guided_matches = 0;     // besides
  std::vector<int> newly_placed;  // images
  std::vector<RefineRound> rounds;
  int num_unconfirmed_outliers = 0;  // points removed at the end (unconfirmed_points.h)
  BundleOptions bundle;  // of the last round, with the noise as the errors showed it
  ErrorSummary errors;   // at the end, over all observations
  double seconds_matching = 0.0, seconds_placing = 0.0, seconds_rounds = 0.0;
};

// On error the scene may have changed:
//   kInvalidArgument   the camera is impossible
//   kNotEnoughData     fewer than two images
//   kDegenerate        no image is placed and no pair of images is good enough to begin with
//   kNotConverged      the solver failed outright, or nothing survived
Expected<RefineSceneReport> RefineScene(const RefineSceneOptions& options, Scene* scene);

}  // namespace rsfm
