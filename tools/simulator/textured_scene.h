// Triangle meshes with pictures on them: the tank, and meshes that users bring.
#pragma once

#include <vector>

#include "tools/simulator/scene.h"
#include "tools/simulator/texture.h"

namespace rsfm::simulator {

struct TexturedMesh {
  TriangleMesh mesh;
  // Where each triangle's corners lie in the texture, texels of its finest level.
  std::vector<std::array<Eigen::Vector2f, 3>> corner_uv;
  std::vector<float> texels_per_m;  // per triangle
  // One per vertex, red, green, blue: multiplies the texture. Empty: 1.
  std::vector<Rgb> tint;
  int texture = -1;  // index; -1: the tint alone
};

// All textures clamp at their edges, or repeat where Edge says so; mip levels are built.
class TexturedScene final : public Scene {
 public:
  // Preconditions: per mesh, corner_uv and texels_per_m have one entry per triangle where it has a
  // texture; the normals are there.
  TexturedScene(std::vector<TexturedMesh> meshes, std::vector<Texture> textures,
                const Vec3& world_offset);

  std::span<const TriangleMesh> meshes() const override { return meshes_; }
  Vec3 WorldOffset() const override { return world_offset_; }
  void Albedo(std::span<const SurfacePoint> points, std::span<Rgb> albedo) const override;

 private:
  struct Skin {
    std::vector<std::array<Eigen::Vector2f, 3>> corner_uv;
    std::vector<float> level_offset;  // per triangle: log2 of texels_per_m
    std::vector<Rgb> tint;
    int texture = -1;
  };

  std::vector<TriangleMesh> meshes_;
  std::vector<Skin> skins_;
  std::vector<Texture> textures_;
  Vec3 world_offset_;
};

// Multiplies each vertex's tint by how much of an even sky (up is -z) it sees past the other
// meshes within `reach_m`: `floor` where it sees nothing, 1 where nothing is in the way. Light of
// the scene itself, the same from wherever it is seen.
void BakeSkyLight(float floor, float reach_m, int num_threads, std::vector<TexturedMesh>* meshes);

}  // namespace rsfm::simulator
