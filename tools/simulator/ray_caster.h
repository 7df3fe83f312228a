// Nearest hits of rays with a scene's meshes, by Embree.
#pragma once

#include <memory>
#include <optional>

#include "tools/simulator/scene.h"

namespace rsfm::simulator {

// Structure of arrays: what Embree's packets and the compiler's vectors both like.
struct RaySoa {
  std::vector<float> ox, oy, oz, dx, dy, dz;

  void Resize(std::size_t size);
  std::size_t size() const { return ox.size(); }
};

struct RayHit {
  float range_m = 0.0f;  // along the ray's unit direction; negative: nothing was hit
  std::uint32_t mesh = 0;
  std::uint32_t triangle = 0;
  float u = 0.0f;  // barycentric weights of the triangle's second and third vertex
  float v = 0.0f;
};

class RayCaster {
 public:
  // Builds the search structure; the meshes must outlive the caster and not change. Single-threaded
  // and so repeatable; about a second per million triangles. Null when Embree cannot be started.
  static std::unique_ptr<RayCaster> Create(std::span<const TriangleMesh> meshes);

  virtual ~RayCaster() = default;
  // Thread-safe. A ray of zero direction hits nothing. hits.size() == rays.size().
  virtual void Trace(const RaySoa& rays, std::span<RayHit> hits) const = 0;
  // One ray; the direction is of unit length.
  virtual std::optional<RayHit> Trace(const Vec3f& origin, const Vec3f& direction) const = 0;
};

}  // namespace rsfm::simulator
