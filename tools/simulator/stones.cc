#include "tools/simulator/stones.h"

#include <map>
#include <numbers>

#include "rsfm/base/so3.h"
#include "tools/simulator/noise.h"

namespace rsfm::simulator {
namespace {

TriangleMesh Icosahedron() {
  const float t = static_cast<float>(std::numbers::phi);
  TriangleMesh mesh;
  mesh.vertices = {{-1, t, 0},  {1, t, 0},  {-1, -t, 0}, {1, -t, 0}, {0, -1, t},  {0, 1, t},
                   {0, -1, -t}, {0, 1, -t}, {t, 0, -1},  {t, 0, 1},  {-t, 0, -1}, {-t, 0, 1}};
  for (Vec3f& vertex : mesh.vertices) vertex.normalize();
  mesh.triangles = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                    {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                    {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                    {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  return mesh;
}

}  // namespace

TriangleMesh MakeIcosphere(int levels) {
  TriangleMesh mesh = Icosahedron();
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> midpoints;
    const auto midpoint = [&](std::uint32_t a, std::uint32_t b) {
      const auto [it, is_new] = midpoints.try_emplace(
          std::minmax(a, b), static_cast<std::uint32_t>(mesh.vertices.size()));
      if (is_new) mesh.vertices.push_back((mesh.vertices[a] + mesh.vertices[b]).normalized());
      return it->second;
    };
    std::vector<std::array<std::uint32_t, 3>> finer;
    finer.reserve(4 * mesh.triangles.size());
    for (const auto& [a, b, c] : mesh.triangles) {
      const std::uint32_t ab = midpoint(a, b);
      const std::uint32_t bc = midpoint(b, c);
      const std::uint32_t ca = midpoint(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    mesh.triangles = std::move(finer);
  }
  return mesh;
}

void AppendStone(const TriangleMesh& sphere, const Stone& stone, Rng* rng, TriangleMesh* mesh) {
  const auto seed = static_cast<std::uint32_t>(rng->Next());
  const Eigen::Vector3d axes(rng->Uniform(0.8, 1.25), rng->Uniform(0.7, 1.0),
                             rng->Uniform(0.45, 0.8));
  const Quat turn =
      ExpSo3(Vec3(rng->Uniform(-0.4, 0.4), rng->Uniform(-0.4, 0.4), rng->Uniform(-3.1, 3.1)));
  const auto first = static_cast<std::uint32_t>(mesh->vertices.size());
  for (const Vec3f& v : sphere.vertices) {
    const float lumps = 0.30f * GradientNoise(1.6f * v.x(), 1.6f * v.y(), 1.6f * v.z(), seed) +
                        0.10f * GradientNoise(4.5f * v.x(), 4.5f * v.y(), 4.5f * v.z(), seed + 1);
    const Vec3 shaped = turn * axes.cwiseProduct((v * (1.0f + lumps)).cast<double>());
    mesh->vertices.push_back(stone.center_in_scene + stone.radius_m * shaped.cast<float>());
  }
  for (const auto& [a, b, c] : sphere.triangles) {
    mesh->triangles.push_back({first + a, first + b, first + c});
  }
}

}  // namespace rsfm::simulator
