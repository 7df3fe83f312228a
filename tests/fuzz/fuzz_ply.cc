// Triangle meshes as PLY files: every index is one, every number finite.
#include <cmath>

#include "tests/fuzz/fuzz.h"
#include "tools/common/ply.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace rsfm;
  const std::filesystem::path path = FuzzFolder() / "mesh.ply";
  WriteFuzzFile(path, AsText(data, size));
  const auto mesh = ReadPlyMesh(path);
  if (!mesh) return 0;
  const auto count = static_cast<std::int32_t>(mesh->vertices.size());
  Require(!mesh->triangles.empty());
  Require(mesh->colours.empty() || mesh->colours.size() == mesh->vertices.size());
  Require(mesh->corner_texcoords.empty() ||
          mesh->corner_texcoords.size() == mesh->triangles.size());
  for (const Vec3& vertex : mesh->vertices) Require(vertex.allFinite());
  for (const auto& triangle : mesh->triangles)
    for (const std::int32_t corner : triangle) Require(corner >= 0 && corner < count);
  for (const auto& colour : mesh->colours)
    for (const double channel : colour) Require(std::isfinite(channel));
  for (const auto& corners : mesh->corner_texcoords)
    for (const Vec2& texcoord : corners) Require(texcoord.allFinite());
  return 0;
}
