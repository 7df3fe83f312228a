#include "tools/evaluation/mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "tools/common/ply.h"

namespace rsfm {
namespace {

constexpr std::int32_t kLeafTriangles = 4;

}  // namespace

Vec3 ClosestPointOnTriangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) return a;
  const Vec3 bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) return b;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return a + d1 / (d1 - d3) * ab;
  const Vec3 cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) return c;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return a + d2 / (d2 - d6) * ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
    return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
  }
  const double denominator = 1.0 / (va + vb + vc);
  return a + vb * denominator * ab + vc * denominator * ac;
}

TriangleMesh::TriangleMesh(std::vector<Vec3> vertices,
                           std::vector<std::array<std::int32_t, 3>> triangles)
    : vertices_(std::move(vertices)), triangles_(std::move(triangles)) {
  if (triangles_.empty()) return;
  nodes_.reserve(2 * triangles_.size());
  nodes_.emplace_back();
  Build(0, 0, static_cast<std::int32_t>(triangles_.size()));
}

void TriangleMesh::Build(std::int32_t node, std::int32_t first, std::int32_t count) {
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (std::int32_t i = first; i < first + count; ++i) {
    for (const std::int32_t v : triangles_[static_cast<std::size_t>(i)]) {
      low = low.cwiseMin(vertices_[static_cast<std::size_t>(v)]);
      high = high.cwiseMax(vertices_[static_cast<std::size_t>(v)]);
    }
  }
  nodes_[static_cast<std::size_t>(node)] = {low, high, first, count};
  if (count <= kLeafTriangles) return;
  int axis = 0;
  (high - low).maxCoeff(&axis);
  const auto centre = [&](const std::array<std::int32_t, 3>& t) {
    return vertices_[static_cast<std::size_t>(t[0])][axis] +
           vertices_[static_cast<std::size_t>(t[1])][axis] +
           vertices_[static_cast<std::size_t>(t[2])][axis];
  };
  const auto begin = triangles_.begin() + first;
  // Halves of equal size: the depth is the logarithm of the number of triangles.
  std::nth_element(begin, begin + count / 2, begin + count,
                   [&](const auto& a, const auto& b) { return centre(a) < centre(b); });
  const auto child = static_cast<std::int32_t>(nodes_.size());
  nodes_.emplace_back();
  nodes_.emplace_back();
  nodes_[static_cast<std::size_t>(node)].first = child;
  nodes_[static_cast<std::size_t>(node)].count = 0;
  Build(child, first, count / 2);
  Build(child + 1, first + count / 2, count - count / 2);
}

double TriangleMesh::SquaredDistanceToBox(const Node& node, const Vec3& point) const {
  return (node.low - point).cwiseMax(point - node.high).cwiseMax(0.0).squaredNorm();
}

Vec3 TriangleMesh::Closest(const Vec3& point) const {
  double best = std::numeric_limits<double>::infinity();
  Vec3 nearest = Vec3::Constant(best);
  if (nodes_.empty()) return nearest;
  std::array<std::int32_t, 128> stack;  // depth-first over a balanced tree: at most its depth + 1
  std::size_t size = 0;
  stack[size++] = 0;
  while (size > 0) {
    const Node& node = nodes_[static_cast<std::size_t>(stack[--size])];
    if (SquaredDistanceToBox(node, point) >= best) continue;
    if (node.count == 0) {
      const Node& left = nodes_[static_cast<std::size_t>(node.first)];
      const Node& right = nodes_[static_cast<std::size_t>(node.first) + 1];
      const bool left_is_nearer =
          SquaredDistanceToBox(left, point) < SquaredDistanceToBox(right, point);
      stack[size++] = node.first + (left_is_nearer ? 1 : 0);
      stack[size++] = node.first + (left_is_nearer ? 0 : 1);
      continue;
    }
    for (std::int32_t i = node.first; i < node.first + node.count; ++i) {
      const auto& t = triangles_[static_cast<std::size_t>(i)];
      const Vec3 closest = ClosestPointOnTriangle(point, vertices_[static_cast<std::size_t>(t[0])],
                                                  vertices_[static_cast<std::size_t>(t[1])],
                                                  vertices_[static_cast<std::size_t>(t[2])]);
      if ((closest - point).squaredNorm() >= best) continue;
      best = (closest - point).squaredNorm();
      nearest = closest;
    }
  }
  return nearest;
}

IoExpected<TriangleMesh> TriangleMesh::ReadPly(const std::filesystem::path& path) {
  auto mesh = ReadPlyMesh(path);
  if (!mesh) return Fail(mesh.error());
  return TriangleMesh(std::move(mesh->vertices), std::move(mesh->triangles));
}

}  // namespace rsfm
