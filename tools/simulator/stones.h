// Lumpy stones as triangle meshes.
#pragma once

#include "rsfm/base/rng.h"
#include "tools/simulator/scene.h"

namespace rsfm::simulator {

struct Stone {
  Vec3f center_in_scene;
  float radius_m = 0.1f;
  Rgb tint;               // multiplies the texture
  Vec2 texture_offset_m;  // where in the texture its surface is taken from
};

// A sphere from an icosahedron, subdivided `levels` times: 20 * 4^levels triangles.
TriangleMesh MakeIcosphere(int levels);

// Appends a deformed copy of `sphere` (unit icosphere) to `mesh`; normals are left to the caller.
void AppendStone(const TriangleMesh& sphere, const Stone& stone, Rng* rng, TriangleMesh* mesh);

}  // namespace rsfm::simulator
