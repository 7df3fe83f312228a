// A triangle mesh that answers how far a point is from it.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "rsfm/base/linear.h"
#include "rsfm/io/diagnostic.h"

namespace rsfm {

class TriangleMesh {
 public:
  // Precondition: indices are in range. A mesh without triangles is infinitely far.
  TriangleMesh(std::vector<Vec3> vertices, std::vector<std::array<std::int32_t, 3>> triangles);

  // PLY, ascii or binary little-endian; faces with more than three corners are fanned.
  static IoExpected<TriangleMesh> ReadPly(const std::filesystem::path& path);

  // The nearest point of any triangle; infinitely far where there is none.
  Vec3 Closest(const Vec3& point) const;

  std::size_t num_triangles() const { return triangles_.size(); }

 private:
  // A bounding volume hierarchy: inner nodes have their two children side by side.
  struct Node {
    Vec3 low, high;
    std::int32_t first = 0;  // leaf: first triangle; else: first child
    std::int32_t count = 0;  // leaf: triangles; else 0
  };
  void Build(std::int32_t node, std::int32_t first, std::int32_t count);
  double SquaredDistanceToBox(const Node& node, const Vec3& point) const;

  std::vector<Vec3> vertices_;
  std::vector<std::array<std::int32_t, 3>> triangles_;
  std::vector<Node> nodes_;
};

// The nearest point of a triangle.   [Ericson 2005, Real-Time Collision Detection, sec. 5.1.5]
Vec3 ClosestPointOnTriangle(const Vec3& point, const Vec3& a, const Vec3& b, const Vec3& c);

}  // namespace rsfm
