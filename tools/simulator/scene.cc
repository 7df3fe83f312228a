#include "tools/simulator/scene.h"

#include <Eigen/Geometry>

namespace rsfm::simulator {

void ComputeNormals(TriangleMesh* mesh) {
  mesh->normals.assign(mesh->vertices.size(), Vec3f::Zero());
  for (const auto& [a, b, c] : mesh->triangles) {
    const Vec3f& origin = mesh->vertices[a];
    const Vec3f normal = (mesh->vertices[b] - origin).cross(mesh->vertices[c] - origin);
    for (const std::uint32_t i : {a, b, c}) mesh->normals[i] += normal;
  }
  for (Vec3f& normal : mesh->normals) normal.normalize();
}

}  // namespace rsfm::simulator
