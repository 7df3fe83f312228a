// Points that two images alone show. No third image confirms them, and a wrong match along the
// epipolar curve fits as well as a right one: with small errors, at any range.
#pragma once

#include "tools/offline/scene.h"

namespace rsfm {

struct UnconfirmedPointOptions {
  int neighbours = 12;       // nearest confirmed points in the image that are asked, at most,
  int min_neighbours = 6;    // ... and no verdict with fewer
  double radius = 1.0 / 16;  // that they may be off, in image widths, ...
  double far_radius = 0.25;  // ... and where there are too few so near
  double min_spread = 0.1;   // of the logarithms of the neighbours' ranges
  double spreads = 2.0;      // that a point may lie outside of these
};

// Removes the two-view points whose range from the camera lies, in every image that has a verdict,
// outside of the ranges of the confirmed points around them, but for the least and the greatest, by
// more than these differ among each other. How many. Statistical outlier removal [Rusu et al. 2008,
// Towards 3D point cloud based object maps for household environments], of those points alone that
// nothing else can judge, and by neighbours in the image, where surfaces are dense whatever the
// range.
int RemoveUnconfirmedOutliers(const UnconfirmedPointOptions& options, Scene* scene);

}  // namespace rsfm
