#include "tools/common/ply.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>
#include <utility>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/binary.h"
#include "rsfm/io/text.h"

namespace rsfm {
namespace {

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

// What of one vertex or face is of use here; NaN where the file does not say.
struct Row {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  Vec3 xyz = Vec3::Zero();
  Vec2 texcoord = Vec2::Constant(kNone);
  std::array<double, 3> colour = {kNone, kNone, kNone};
  std::vector<double> corners, corner_texcoords;
};

void SetScalar(const Property& property, double value, Row* row) {
  const std::string& name = property.name;
  const bool is_byte = property.type == "uchar" || property.type == "uint8";
  if (name == "x") row->xyz.x() = value;
  if (name == "y") row->xyz.y() = value;
  if (name == "z") row->xyz.z() = value;
  if (name == "red") row->colour[0] = is_byte ? value / 255.0 : value;
  if (name == "green") row->colour[1] = is_byte ? value / 255.0 : value;
  if (name == "blue") row->colour[2] = is_byte ? value / 255.0 : value;
  if (name == "s" || name == "u" || name == "texture_u") row->texcoord.x() = value;
  if (name == "t" || name == "v" || name == "texture_v") row->texcoord.y() = value;
}

bool ReadRow(const Element& element, Body* body, Row* row) {
  for (const Property& property : element.properties) {
    double value = 0.0;
    if (property.count_type.empty()) {
      if (!body->Read(property.type, &value)) return false;
      SetScalar(property, value, row);
      continue;
    }
    if (!body->Read(property.count_type, &value) || !(value >= 0.0 && value < 1e6)) return false;
    std::vector<double> list;
    for (int i = 0; i < static_cast<int>(value); ++i) {
      double entry = 0.0;
      if (!body->Read(property.type, &entry)) return false;
      list.push_back(entry);
    }
    if (property.name == "vertex_indices" || property.name == "vertex_index") {
      row->corners = std::move(list);
    } else if (property.name == "texcoord") {
      row->corner_texcoords = std::move(list);
    }
  }
  return true;
}

class Builder {
 public:
  // An empty text is success; anything else says what is wrong.
  std::string AddVertex(const Row& row, std::uint64_t index) {
    if (!row.xyz.allFinite()) return "vertex " + std::to_string(index) + " is not finite";
    mesh_.vertices.push_back(row.xyz);
    texcoords_.push_back(row.texcoord);
    mesh_.colours.push_back(row.colour);
    for (const double channel : row.colour) has_colours_ &= std::isfinite(channel);
    return {};
  }

  std::string AddFace(const Row& row, std::uint64_t index) {
    const std::vector<double>& corners = row.corners;
    for (std::size_t k = 0; k < corners.size(); ++k) {
      if (!(corners[k] >= 0.0 && corners[k] < static_cast<double>(mesh_.vertices.size()))) {
        return "face " + std::to_string(index) + " has a corner that does not exist";
      }
    }
    const bool has_own = row.corner_texcoords.size() == 2 * corners.size();
    for (std::size_t k = 2; k < corners.size(); ++k) {
      std::array<Vec2, 3> texcoords;
      std::array<std::int32_t, 3> triangle;
      const std::size_t of_corner[3] = {0, k - 1, k};
      for (std::size_t c = 0; c < 3; ++c) {
        const std::size_t i = of_corner[c];
        triangle[c] = static_cast<std::int32_t>(corners[i]);
        texcoords[c] = has_own ? Vec2(row.corner_texcoords[2 * i], row.corner_texcoords[2 * i + 1])
                               : texcoords_[static_cast<std::size_t>(triangle[c])];
        has_all_texcoords_ &= texcoords[c].allFinite();
      }
      mesh_.triangles.push_back(triangle);
      mesh_.corner_texcoords.push_back(texcoords);
    }
    return {};
  }

  PlyMesh Finish() {
    if (!has_all_texcoords_) mesh_.corner_texcoords.clear();
    if (!has_colours_) mesh_.colours.clear();
    return std::move(mesh_);
  }
  bool HasTriangles() const { return !mesh_.triangles.empty(); }

 private:
  PlyMesh mesh_;
  std::vector<Vec2> texcoords_;
  bool has_all_texcoords_ = true;
  bool has_colours_ = true;
};

}  // namespace

IoExpected<PlyMesh> ReadPlyMesh(const std::filesystem::path& path) {
  const auto bytes = ReadWholeFile(path);
  if (!bytes) return Fail(bytes.error());
  const auto corrupt = [&](std::string problem) {
    return Fail({Errc::kCorrupt, path.string(), "", std::move(problem),
                 "give an ascii or binary little-endian PLY mesh"});
  };
  Header header;
  if (!ParseHeader(*bytes, &header)) return corrupt("has no PLY header that is understood here");
  Body body(std::string_view(*bytes).substr(header.end), header.is_ascii);
  Builder builder;
  for (const Element& element : header.elements) {
    // A row of nothing would be read for ever.
    if (element.properties.empty() && element.count > 0)
      return corrupt("has no properties of its element " + element.name);
    for (std::uint64_t i = 0; i < element.count; ++i) {
      Row row;
      if (!ReadRow(element, &body, &row)) {
        return corrupt("is cut off or damaged in " + element.name + " " + std::to_string(i));
      }
      std::string problem;
      if (element.name == "vertex") problem = builder.AddVertex(row, i);
      if (element.name == "face") problem = builder.AddFace(row, i);
      if (!problem.empty()) return corrupt(std::move(problem));
    }
  }
  if (!builder.HasTriangles()) return corrupt("holds no triangles");
  return builder.Finish();
}

}  // namespace rsfm
