// The bowl: what a straight transect over a flat seabed becomes when a camera behind a port is
// taken for a pinhole.
//
// A down-looking camera flies a straight line; every image sees the seabed by its exact refracted
// rays, without noise. The strip is then reconstructed by bundle adjustment of poses and points
// with the pinhole's projection, from the truth as its start. The pinhole's error is the same in
// every image, so each one bends the strip by as much as the last: a circle, whose sagitta grows
// with the square of the length (tests/tools/refraction_check_test.cc measures that it does).
#pragma once

#include "tools/check/refraction_effect.h"

namespace rsfm {

struct TransectOptions {
  double length_m = 50.0;
  double altitude_m = 3.0;        // above the seabed
  double forward_overlap = 0.75;  // of consecutive images
  int rows = 8;                   // seabed points in one image, along the track
  int columns = 7;                // and across
  int max_images = 400;           // a transect of more is flown only as far as these reach
  int max_iterations = 300;
};

struct TransectReport {
  int num_images = 0;
  int num_points = 0;
  int num_observations = 0;
  double flown_m = 0.0;  // shorter than asked for where max_images ended it
  // Middle of the track below (positive: a bowl) or above (negative: a hump) the line between its
  // ends, in the length asked for.
  double sagitta_m = 0.0;
  double mean_error_px = 0.0;  // what is left in the images after adjustment: how well it hides
  bool converged = false;
};

// kInvalidArgument: an option; kNotEnoughData: the camera does not see enough of the seabed;
// kNotConverged: the adjustment failed.
Expected<TransectReport> SimulateTransect(const PinholeInWater& pinhole,
                                          const TransectOptions& options);

}  // namespace rsfm
