// A user's own mesh as a scene.
#pragma once

#include <filesystem>
#include <memory>

#include "rsfm/io/diagnostic.h"
#include "tools/simulator/scene.h"

namespace rsfm::simulator {

struct MeshOptions {
  std::filesystem::path file;     // PLY, metres: x north, y east, z down, or as up_axis says
  std::filesystem::path texture;  // an image; empty: the mesh's colours, or a generated texture
  bool z_is_up = false;           // then x is east and y north
  double sky_light = 0.5;         // 0: even light; 1: places that see no sky are dark
  std::uint64_t seed = 1;
};

// With texture coordinates the image lies where they say; without them it is laid over the mesh
// from above, as large as the mesh, its upper edge to the north. Errors name file and fix.
IoExpected<std::unique_ptr<Scene>> LoadMeshScene(const MeshOptions& options, int num_threads);

// Mean depth of the mesh's vertices: what altitudes and heights refer to.
IoExpected<double> MeshFloorDepth(const MeshOptions& options);

}  // namespace rsfm::simulator
