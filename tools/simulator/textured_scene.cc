#include "tools/simulator/textured_scene.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "tools/common/parallel.h"
#include "tools/simulator/ray_caster.h"

namespace rsfm::simulator {
namespace {

constexpr int kSkyDirections = 32;

// Directions of equal weight under an even sky: cosine-weighted about the axis z, on a Fibonacci
// spiral.
std::vector<Vec3f> CosineDirections() {
  std::vector<Vec3f> directions;
  for (int i = 0; i < kSkyDirections; ++i) {
    const double squared = (i + 0.5) / kSkyDirections;
    const double angle = 2.0 * std::numbers::pi * i / std::numbers::phi;
    const double radius = std::sqrt(squared);
    directions.push_back(
        Vec3(radius * std::cos(angle), radius * std::sin(angle), std::sqrt(1.0 - squared))
            .cast<float>());
  }
  return directions;
}

// Share of the sky that is seen from just above a vertex.
float SkyShare(const Vec3f& vertex, const Vec3f& normal, float reach_m,
               std::span<const Vec3f> directions, const RayCaster& caster, RaySoa* rays,
               std::vector<RayHit>* hits) {
  constexpr float kLift = 1e-3f;
  const Vec3f side = normal.unitOrthogonal();
  const Vec3f other = normal.cross(side);
  const Vec3f origin = vertex + kLift * normal;
  rays->Resize(directions.size());
  hits->resize(directions.size());
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const Vec3f d =
        directions[i].x() * side + directions[i].y() * other + directions[i].z() * normal;
    rays->ox[i] = origin.x();
    rays->oy[i] = origin.y();
    rays->oz[i] = origin.z();
    rays->dx[i] = d.x();
    rays->dy[i] = d.y();
    rays->dz[i] = d.z();
  }
  caster.Trace(*rays, *hits);
  float seen = 0.0f;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const bool is_open = (*hits)[i].range_m < 0.0f || (*hits)[i].range_m > reach_m;
    // Light comes from above; walls and floor send a part of it on from all sides.
    const float from_above = 0.5f - 0.5f * rays->dz[i];
    if (is_open) seen += from_above;
  }
  return seen / static_cast<float>(directions.size());
}

}  // namespace

TexturedScene::TexturedScene(std::vector<TexturedMesh> meshes, std::vector<Texture> textures,
                             const Vec3& world_offset)
    : textures_(std::move(textures)), world_offset_(world_offset) {
  for (TexturedMesh& mesh : meshes) {
    Skin& skin = skins_.emplace_back();
    for (const float density : mesh.texels_per_m) skin.level_offset.push_back(RoughLog2(density));
    skin.corner_uv = std::move(mesh.corner_uv);
    skin.tint = std::move(mesh.tint);
    skin.texture = mesh.texture;
    meshes_.push_back(std::move(mesh.mesh));
  }
}

void TexturedScene::Albedo(std::span<const SurfacePoint> points, std::span<Rgb> albedo) const {
  for (std::size_t i = 0; i < points.size(); ++i) {
    const SurfacePoint& point = points[i];
    const Skin& skin = skins_[point.mesh];
    const float w = 1.0f - point.u - point.v;
    Float4 colour = {1.0f, 1.0f, 1.0f, 1.0f};
    if (skin.texture >= 0) {
      const auto& [a, b, c] = skin.corner_uv[point.triangle];
      const float u = w * a.x() + point.u * b.x() + point.v * c.x();
      const float v = w * a.y() + point.u * b.y() + point.v * c.y();
      const float level =
          RoughLog2(point.footprint_m) + skin.level_offset[point.triangle] + point.lod_dither;
      const Texture& texture = textures_[static_cast<std::size_t>(skin.texture)];
      colour = texture.edge() == Texture::Edge::kRepeat
                   ? texture.Sample<Texture::Edge::kRepeat>(u, v, level)
                   : texture.Sample<Texture::Edge::kClamp>(u, v, level);
    }
    albedo[i] = {colour[0], colour[1], colour[2]};
    if (skin.tint.empty()) continue;
    const auto& corners = meshes_[point.mesh].triangles[point.triangle];
    const Rgb& a = skin.tint[corners[0]];
    const Rgb& b = skin.tint[corners[1]];
    const Rgb& c = skin.tint[corners[2]];
    for (int k = 0; k < 3; ++k) albedo[i][k] *= w * a[k] + point.u * b[k] + point.v * c[k];
  }
}

void BakeSkyLight(float floor, float reach_m, int num_threads, std::vector<TexturedMesh>* meshes) {
  std::vector<TriangleMesh> bare;
  for (const TexturedMesh& mesh : *meshes) bare.push_back(mesh.mesh);
  const auto caster = RayCaster::Create(bare);
  if (caster == nullptr) return;  // the same failure stops the simulation when it traces images
  const std::vector<Vec3f> directions = CosineDirections();
  for (TexturedMesh& mesh : *meshes) {
    const std::size_t size = mesh.mesh.vertices.size();
    if (mesh.tint.empty()) mesh.tint.assign(size, {1.0f, 1.0f, 1.0f});
    constexpr std::size_t kBlock = 512;
    ParallelFor(static_cast<int>((size + kBlock - 1) / kBlock), num_threads, [&](int block) {
      RaySoa rays;
      std::vector<RayHit> hits;
      const std::size_t first = static_cast<std::size_t>(block) * kBlock;
      for (std::size_t i = first; i < std::min(first + kBlock, size); ++i) {
        const float share = SkyShare(mesh.mesh.vertices[i], mesh.mesh.normals[i], reach_m,
                                     directions, *caster, &rays, &hits);
        for (float& channel : mesh.tint[i]) channel *= floor + (1.0f - floor) * share;
      }
    });
  }
}

}  // namespace rsfm::simulator
