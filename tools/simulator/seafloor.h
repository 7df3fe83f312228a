// A generated seafloor: relief, ripples, stones, gravel and sand, with patches poor in texture and
// patches that repeat. A function of the options alone; same options, same bytes.
#pragma once

#include <memory>

#include "tools/simulator/height_grid.h"
#include "tools/simulator/scene.h"

namespace rsfm::simulator {

struct SeafloorOptions {
  Vec2 min_ne_m = Vec2(-5.0, -5.0);  // area covered, world north and east
  Vec2 max_ne_m = Vec2(5.0, 5.0);
  double depth_m = 20.0;          // mean depth of the floor, world down
  double relief_m = 0.3;          // rough height of hills above and below the mean depth
  double relief_length_m = 4.0;   // their size
  double ripple_height_m = 0.02;  // crest to trough; 0: none
  double ripple_length_m = 0.22;
  double stones_per_m2 = 4.0;
  double stone_min_radius_m = 0.03;
  double stone_max_radius_m = 0.30;
  double poor_fraction = 0.08;   // of the area: sand with hardly any texture
  double repeat_fraction = 0.0;  // of the area: a texture that repeats every repeat_length_m
  double repeat_length_m = 0.35;
  double cell_m = 0.025;  // spacing of the height grid; made coarser above 4 million cells
  std::uint64_t seed = 1;
  // Where given, its heights about the mean depth in place of the generated relief; centred at the
  // world's origin.
  std::shared_ptr<const HeightGrid> grid;
};

std::unique_ptr<Scene> MakeSeafloor(const SeafloorOptions& options, int num_threads);

}  // namespace rsfm::simulator
