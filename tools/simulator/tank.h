// A generated test tank: gravel floor, painted walls, and stones, bricks and posts that stand in
// it. Every surface has a texture of its own that nowhere repeats. A function of the options alone.
#pragma once

#include <memory>

#include "tools/simulator/scene.h"

namespace rsfm::simulator {

// Its floor is centred under the world's origin; its walls rise to `height_m` above the floor.
struct TankOptions {
  double length_m = 2.0;   // along north
  double width_m = 1.0;    // along east
  double height_m = 1.0;   // of the walls
  double depth_m = 1.0;    // of the floor below the surface
  double relief_m = 0.04;  // rough height of the gravel's hills and hollows
  int stones = 16;
  int bricks = 7;
  int posts = 5;            // upright, round
  double texel_m = 0.0008;  // size of the finest texture
  double contrast = 1.0;    // of the texture: 0 is bare paint and sand
  std::uint64_t seed = 1;
};

std::unique_ptr<Scene> MakeTank(const TankOptions& options, int num_threads);

}  // namespace rsfm::simulator
