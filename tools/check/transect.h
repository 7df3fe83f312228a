// The bowl: what a straight transect over a flat seabed becomes when a camera behind a port is
// taken for a pinhole.
//
// A down-looking camera flies a straight line; every image sees the seabed by its exact refracted
// rays, without noise. The strip is then reconstructed by bundle adjustment with the pinhole's
// projection. The pinhole's error is the same in every image, so in a strip without ends every
// step from image to image is reconstructed as the same rigid motion, and every image sees the same
// points about itself: the adjustment has that one motion and the points of one step as unknowns,
// and the track is a helix of it, a circle as a rule. (tests/tools/refraction_check_test.cc compares
// that with the adjustment of a whole strip with ends.)
#pragma once

#include "tools/check/refraction_effect.h"

namespace rsfm {

struct TransectOptions {
  double length_m = 50.0;
  double altitude_m = 3.0;        // above the seabed
  double forward_overlap = 0.75;  // of consecutive images
  int rows = 32;                  // seabed points in one image, along the track
  int columns = 15;               // and across
};

struct TransectReport {
  double spacing_m = 0.0;  // from image to image
  int num_points = 0;      // of one step
  int num_observations = 0;
  double curvature_per_m = 0.0;  // of the track, positive: a bowl, negative: a hump
  // How deep the bowl is: middle of the track below the line between its ends; that of the whole
  // circle for a track that closes upon itself.
  double sagitta_m = 0.0;
  double mean_error_px = 0.0;  // what is left in the images after adjustment: how well it hides
};

// kInvalidArgument: an option; kNotEnoughData: the camera does not see enough of the seabed;
// kNotConverged: the adjustment failed.
Expected<TransectReport> SimulateTransect(const PinholeInWater& pinhole,
                                          const TransectOptions& options);

}  // namespace rsfm
