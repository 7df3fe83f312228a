// Triangle meshes from PLY files.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "rsfm/base/linear.h"
#include "rsfm/io/diagnostic.h"

namespace rsfm {

struct PlyMesh {
  std::vector<Vec3> vertices;
  std::vector<std::array<std::int32_t, 3>> triangles;  // indices are in range
  // What the file has besides, else empty.
  std::vector<std::array<double, 3>> colours;  // per vertex: red, green, blue, [0, 1]
  std::vector<std::array<Vec2, 3>>
      corner_texcoords;  // per triangle; (0, 0) is the lower left corner
};

// Ascii or binary little-endian; faces with more than three corners are fanned. Texture coordinates
// are the faces' list `texcoord`, or the vertices' (s, t), (u, v) or (texture_u, texture_v).
IoExpected<PlyMesh> ReadPlyMesh(const std::filesystem::path& path);

}  // namespace rsfm
