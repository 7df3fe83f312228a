#include "tools/evaluation/mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/binary.h"
#include "rsfm/io/text.h"

namespace rsfm {
namespace {

constexpr std::int32_t kLeafTriangles = 4;

struct Property {
  std::string type, count_type, name;  // count_type: of lists only
};
struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};
struct Header {
  bool is_ascii = false;
  std::vector<Element> elements;
  std::size_t end = 0;
};

bool ParseHeader(std::string_view text, Header* header) {
  std::string_view rest = text, line;
  std::vector<std::string_view> fields;
  bool has_format = false;
  if (!NextLine(&rest, &line) || line != "ply") return false;
  while (NextLine(&rest, &line)) {
    SplitBlanks(line, &fields);
    if (fields.empty() || fields[0] == "comment" || fields[0] == "obj_info") continue;
    if (fields[0] == "end_header") {
      header->end = text.size() - rest.size();
      return has_format;
    }
    if (fields[0] == "format" && fields.size() == 3) {
      has_format = fields[1] == "ascii" || fields[1] == "binary_little_endian";
      header->is_ascii = fields[1] == "ascii";
      if (!has_format) return false;
    } else if (fields[0] == "element" && fields.size() == 3) {
      const auto count = ParseInteger(fields[2]);
      if (!count || *count < 0) return false;
      header->elements.push_back({std::string(fields[1]), static_cast<std::uint64_t>(*count), {}});
    } else if (fields[0] == "property" && !header->elements.empty()) {
      const bool is_list = fields.size() == 5 && fields[1] == "list";
      if (!is_list && fields.size() != 3) return false;
      header->elements.back().properties.push_back(
          {std::string(fields[is_list ? 3 : 1]), is_list ? std::string(fields[2]) : std::string(),
           std::string(fields.back())});
    } else {
      return false;
    }
  }
  return false;
}

// Values of a PLY body, whatever their types.
class Body {
 public:
  Body(std::string_view bytes, bool is_ascii) : binary_(bytes), rest_(bytes), is_ascii_(is_ascii) {}

  bool Read(const std::string& type, double* value) {
    if (is_ascii_) return ReadText(value);
    if (type == "char" || type == "int8") return ReadAs<std::int8_t>(value);
    if (type == "uchar" || type == "uint8") return ReadAs<std::uint8_t>(value);
    if (type == "short" || type == "int16") return ReadAs<std::int16_t>(value);
    if (type == "ushort" || type == "uint16") return ReadAs<std::uint16_t>(value);
    if (type == "int" || type == "int32") return ReadAs<std::int32_t>(value);
    if (type == "uint" || type == "uint32") return ReadAs<std::uint32_t>(value);
    if (type == "float" || type == "float32") return ReadAs<float>(value);
    if (type == "double" || type == "float64") return ReadAs<double>(value);
    return false;
  }

 private:
  template <class T>
  bool ReadAs(double* value) {
    T raw;
    if (!binary_.Read(&raw)) return false;
    *value = static_cast<double>(raw);
    return true;
  }
  bool ReadText(double* value) {
    const std::size_t start = rest_.find_first_not_of(" \t\r\n");
    if (start == std::string_view::npos) return false;
    rest_.remove_prefix(start);
    const std::size_t end = std::min(rest_.find_first_of(" \t\r\n"), rest_.size());
    const auto parsed = ParseNumber(rest_.substr(0, end));
    rest_.remove_prefix(end);
    if (!parsed) return false;
    *value = *parsed;
    return true;
  }

  BinaryReader binary_;
  std::string_view rest_;
  bool is_ascii_;
};

bool ReadElement(const Element& element, Body* body, Vec3* xyz, std::vector<double>* list) {
  for (const Property& property : element.properties) {
    double value = 0.0;
    if (property.count_type.empty()) {
      if (!body->Read(property.type, &value)) return false;
      if (property.name == "x") xyz->x() = value;
      if (property.name == "y") xyz->y() = value;
      if (property.name == "z") xyz->z() = value;
      continue;
    }
    if (!body->Read(property.count_type, &value) || !(value >= 0.0 && value < 1e6)) return false;
    const bool is_face = property.name == "vertex_indices" || property.name == "vertex_index";
    if (is_face) list->clear();
    for (int i = 0; i < static_cast<int>(value); ++i) {
      double entry = 0.0;
      if (!body->Read(property.type, &entry)) return false;
      if (is_face) list->push_back(entry);
    }
  }
  return true;
}

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

double TriangleMesh::Distance(const Vec3& point) const {
  double best = std::numeric_limits<double>::infinity();
  if (nodes_.empty()) return best;
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
      best = std::min(best, (closest - point).squaredNorm());
    }
  }
  return std::sqrt(best);
}

IoExpected<TriangleMesh> TriangleMesh::ReadPly(const std::filesystem::path& path) {
  const auto bytes = ReadWholeFile(path);
  if (!bytes) return Fail(bytes.error());
  const auto corrupt = [&](std::string problem) {
    return Fail({Errc::kCorrupt, path.string(), "", std::move(problem),
                 "give an ascii or binary little-endian PLY mesh"});
  };
  Header header;
  if (!ParseHeader(*bytes, &header)) return corrupt("has no PLY header that is understood here");
  Body body(std::string_view(*bytes).substr(header.end), header.is_ascii);
  std::vector<Vec3> vertices;
  std::vector<std::array<std::int32_t, 3>> triangles;
  for (const Element& element : header.elements) {
    for (std::uint64_t i = 0; i < element.count; ++i) {
      Vec3 xyz = Vec3::Zero();
      std::vector<double> corners;
      if (!ReadElement(element, &body, &xyz, &corners)) {
        return corrupt("is cut off or damaged in " + element.name + " " + std::to_string(i));
      }
      if (element.name == "vertex") {
        if (!xyz.allFinite()) return corrupt("vertex " + std::to_string(i) + " is not finite");
        vertices.push_back(xyz);
      }
      for (std::size_t k = 0; element.name == "face" && k < corners.size(); ++k) {
        if (!(corners[k] >= 0.0 && corners[k] < static_cast<double>(vertices.size()))) {
          return corrupt("face " + std::to_string(i) + " has a corner that does not exist");
        }
        if (k < 2) continue;
        triangles.push_back({static_cast<std::int32_t>(corners[0]),
                             static_cast<std::int32_t>(corners[k - 1]),
                             static_cast<std::int32_t>(corners[k])});
      }
    }
  }
  if (triangles.empty()) return corrupt("holds no triangles");
  return TriangleMesh(std::move(vertices), std::move(triangles));
}

}  // namespace rsfm
