// What the simulator renders: triangle meshes and what colour they have where.
//
// Frame: "scene" is the world (local NED) moved to an origin near the scene, so that single
// precision keeps micrometres. x north, y east, z down, metres.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "rsfm/base/linear.h"

namespace rsfm::simulator {

using Vec3f = Eigen::Vector3f;
using Rgb = std::array<float, 3>;  // linear, [0, 1] for an albedo

struct TriangleMesh {
  std::vector<Vec3f> vertices;
  std::vector<Vec3f> normals;  // unit, one per vertex, towards the water
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

// Area-weighted vertex normals; counter-clockwise triangles seen from the water.
void ComputeNormals(TriangleMesh* mesh);

struct SurfacePoint {
  Vec3f position_in_scene;
  float footprint_m = 0.0f;  // size of a pixel's sample there: texture finer than this is noise
  float lod_dither = 0.0f;  // [0, 1), constant per sample of a pixel: blends mip levels by sampling
  std::uint32_t mesh = 0;
  std::uint32_t triangle = 0;
  float u = 0.0f;  // barycentric weights of the triangle's second and third vertex
  float v = 0.0f;
};

class Scene {
 public:
  virtual ~Scene() = default;

  virtual std::span<const TriangleMesh> meshes() const = 0;
  // Thread-safe, and a function of the points alone. Both spans have the same length.
  virtual void Albedo(std::span<const SurfacePoint> points, std::span<Rgb> albedo) const = 0;
  // scene = world - offset.
  virtual Vec3 WorldOffset() const = 0;
};

}  // namespace rsfm::simulator
