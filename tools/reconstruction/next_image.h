// The next best view: an image that matches one of the placed images strongly and sees much of the
// map, well spread.   [Schoenberger & Frahm 2016, CVPR, "Structure-from-Motion Revisited",
// sec. 4.2]
//
// Strong pairs go first because patterns that repeat on the seabed match as well, but not over
// whole images: by the time their pairs would be followed, true neighbours have placed the image.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/offline/tracks.h"

namespace rsfm {

class NextImage {
 public:
  NextImage(const Scene& scene, const std::vector<VerifiedPair>& pairs);

  // The map has changed where this image is / everywhere.
  void Touch(int image);
  void TouchAll();

  // The unplaced image with the best view, or -1 when none matches `min_points` features with
  // points. `closed` (as many as images) marks those to leave out.
  int Choose(const CorrespondenceGraph& graph, int min_points,
             const std::vector<std::uint8_t>& closed, const Scene& scene);

 private:
  struct View {
    bool stale = true;
    int points = 0;
    int score = 0;  // occupied cells of a pyramid of grids, the finer the heavier
  };
  void Update(int image, const CorrespondenceGraph& graph, const Scene& scene);

  std::vector<View> views_;
  struct Neighbour {
    int image = 0;
    int matches = 0;
  };
  int StrongestLink(int image, const Scene& scene) const;

  std::vector<std::vector<Neighbour>> neighbours_;  // images that share a verified pair
};

}  // namespace rsfm
