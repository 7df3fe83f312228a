// Navigation at the desk: the world turned, moved and scaled to it, and priors for every placed
// image.
#pragma once

#include <vector>

#include "rsfm/mapping/mapper_options.h"
#include "rsfm/navigation/nav_sample.h"
#include "tools/offline/scene.h"

namespace rsfm {

struct NavigationInput {
  std::vector<NavSample> samples;
  Rigid3 body_from_camera;
  MapperOptions defaults;  // sigmas of samples that state none, the largest gap
};

// What of a world's place navigation has decided.
struct NavigationAlignment {
  bool attitude = false;
  bool position = false;  // north and east; depth alone gives the vertical only
  bool depth = false;
  bool scale = false;
  double scale_factor = 1.0;  // that the scene was multiplied by
};

// Turns, moves and scales the scene to navigation, by as much as that knows: attitude from the
// attitude sensor, or else from three positions or more that do not lie on a line; scale from
// positions or, failing them, from dead-reckoned displacements; place from positions, or the
// vertical from depth. What it does not know stays.
NavigationAlignment AlignToNavigation(const NavigationInput& input, Scene* scene);

// Priors of position, depth (where there is no position), attitude and, between images that follow
// each other, dead-reckoned displacement. Position and depth are robust against wrong fixes.
std::vector<PosePrior> NavigationPriors(const NavigationInput& input, const Scene& scene);

}  // namespace rsfm
