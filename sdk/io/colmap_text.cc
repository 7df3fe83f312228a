#include <cmath>

#include "rsfm/io/colmap_files.h"
#include "rsfm/io/text.h"

namespace rsfm {
namespace {

// The fields of a line, taken one after the other; remembers the first that is not what it must be.
class LineReader {
 public:
  LineReader(std::string_view line, const std::string& name, int number)
      : name_(name), number_(number) {
    SplitBlanks(line, &fields_);
  }

  bool Number(const char* what, double* value) {
    const auto parsed = Next(what) ? ParseNumber(field_) : std::nullopt;
    if (!parsed || !std::isfinite(*parsed)) return Refuse(what, "a finite number");
    *value = *parsed;
    return true;
  }
  template <class T>
  bool Integer(const char* what, std::int64_t low, std::int64_t high, T* value) {
    const auto parsed = Next(what) ? ParseInteger(field_) : std::nullopt;
    if (!parsed || *parsed < low || *parsed > high) return Refuse(what, "a possible whole number");
    *value = static_cast<T>(*parsed);
    return true;
  }
  bool AtEnd() const { return next_ == fields_.size(); }
  std::size_t NumLeft() const { return fields_.size() - next_; }
  // Where the next field begins.
  const char* Position() const { return AtEnd() ? nullptr : fields_[next_].data(); }
  tl::unexpected<Diagnostic> Failure() const {
    return Fail({Errc::kCorrupt, name_, what_, problem_, "repair the line", number_});
  }
  bool Refuse(const char* what, const char* wanted) {
    what_ = what;
    problem_ =
        field_.data() == nullptr ? std::string("is missing") : Quoted(field_) + " is not " + wanted;
    return false;
  }

 private:
  bool Next(const char*) {
    field_ = next_ < fields_.size() ? fields_[next_++] : std::string_view();
    return field_.data() != nullptr;
  }

  std::vector<std::string_view> fields_;
  std::size_t next_ = 0;
  std::string_view field_;
  const std::string& name_;
  int number_;
  std::string what_, problem_;
};

constexpr std::int64_t kMaxId = UINT32_MAX;

bool ReadImageHead(std::string_view line, LineReader* fields, ColmapImage* image) {
  double pose[7] = {};
  if (!fields->Integer("IMAGE_ID", 1, kMaxId, &image->image.id)) return false;
  for (double& value : pose) {
    if (!fields->Number("QW QX QY QZ TX TY TZ", &value)) return false;
  }
  if (!SetPose(pose, &image->image.camera_from_world)) {
    return fields->Refuse("QW QX QY QZ TX TY TZ", "the last number of a possible pose");
  }
  if (!fields->Integer("CAMERA_ID", 1, kMaxId, &image->camera_id)) return false;
  const char* name = fields->Position();  // the rest of the line: names may hold blanks
  if (name == nullptr) return fields->Refuse("NAME", "followed by the image's name");
  image->image.name = line.substr(static_cast<std::size_t>(name - line.data()));
  return true;
}

bool ReadFeatures(LineReader* fields, ColmapImage* image) {
  image->image.features.reserve(fields->NumLeft() / 3);
  image->point_ids.reserve(fields->NumLeft() / 3);
  while (!fields->AtEnd()) {
    Vec2 feature;
    std::int64_t point_id = -1;
    if (!fields->Number("POINTS2D", &feature.x()) || !fields->Number("POINTS2D", &feature.y()) ||
        !fields->Integer("POINTS2D", -1, INT64_MAX, &point_id)) {
      return false;
    }
    image->image.features.push_back(feature);
    image->point_ids.push_back(point_id < 0 ? kNoColmapPoint
                                            : static_cast<std::uint64_t>(point_id));
  }
  return true;
}

bool ReadPoint(LineReader* fields, ColmapPoint* point) {
  if (!fields->Integer("POINT3D_ID", 0, INT64_MAX, &point->point.id)) return false;
  for (int k = 0; k < 3; ++k) {
    if (!fields->Number("X Y Z", &point->point.xyz[k])) return false;
  }
  for (std::uint8_t& colour : point->point.rgb) {
    if (!fields->Integer("R G B", 0, 255, &colour)) return false;
  }
  if (!fields->Number("ERROR", &point->point.error_px)) return false;
  point->track.reserve(fields->NumLeft() / 2);
  while (!fields->AtEnd()) {
    std::pair<std::uint32_t, std::uint32_t> element;
    if (!fields->Integer("TRACK", 1, kMaxId, &element.first) ||
        !fields->Integer("TRACK", 0, kMaxId, &element.second)) {
      return false;
    }
    point->track.push_back(element);
  }
  return true;
}

}  // namespace

bool SetPose(const double (&values)[7], Rigid3* camera_from_world) {
  const Quat q(values[0], values[1], values[2], values[3]);
  const Vec3 t(values[4], values[5], values[6]);
  constexpr double kTolerance = 1e-3;  // other programs write few digits
  if (!t.allFinite() || !(std::abs(q.norm() - 1.0) < kTolerance)) return false;
  // An exact quaternion stays as it is, so that files read and written again are the same.
  camera_from_world->rotation = std::abs(q.norm() - 1.0) < 1e-12 ? q : q.normalized();
  camera_from_world->translation = t;
  return true;
}

IoExpected<std::vector<ColmapImage>> ParseColmapImagesText(const std::string& text,
                                                           const std::string& name) {
  std::vector<ColmapImage> images;
  std::string_view rest = text, line;
  bool is_head = true;
  for (int number = 1; NextLine(&rest, &line); ++number) {
    if (line.starts_with('#') || (is_head && Trim(line).empty())) continue;
    line = Trim(line);
    LineReader fields(line, name, number);
    if (is_head) images.emplace_back();
    const bool is_good = is_head ? ReadImageHead(line, &fields, &images.back())
                                 : ReadFeatures(&fields, &images.back());
    if (!is_good) return fields.Failure();
    is_head = !is_head;
  }
  if (!is_head && !text.empty() && text.back() != '\n') {
    return Fail({Errc::kCorrupt, name, "", "is cut off: the last image has no line of features",
                 "write the model again"});
  }
  return images;
}

IoExpected<std::vector<ColmapPoint>> ParseColmapPointsText(const std::string& text,
                                                           const std::string& name) {
  std::vector<ColmapPoint> points;
  std::string_view rest = text, line;
  for (int number = 1; NextLine(&rest, &line); ++number) {
    line = Trim(line);
    if (line.empty() || line.front() == '#') continue;
    LineReader fields(line, name, number);
    points.emplace_back();
    if (!ReadPoint(&fields, &points.back())) return fields.Failure();
  }
  return points;
}

std::string FormatColmapImagesText(const std::vector<ColmapImage>& images) {
  std::string text =
      "# Image list with two lines of data per image:\n"
      "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
      "#   POINTS2D[] as (X, Y, POINT3D_ID)\n"
      "# Number of images: " +
      std::to_string(images.size()) + "\n";
  for (const ColmapImage& image : images) {
    const Quat& q = image.image.camera_from_world.rotation;
    const Vec3& t = image.image.camera_from_world.translation;
    text += std::to_string(image.image.id);
    for (const double value : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) {
      text += " " + FormatNumber(value);
    }
    text += " " + std::to_string(image.camera_id) + " " + image.image.name + "\n";
    for (std::size_t i = 0; i < image.image.features.size(); ++i) {
      const Vec2& feature = image.image.features[i];
      const std::uint64_t id = image.point_ids[i];
      text += (i > 0 ? " " : "") + FormatNumber(feature.x()) + " " + FormatNumber(feature.y()) +
              " " + (id == kNoColmapPoint ? "-1" : std::to_string(id));
    }
    text += "\n";
  }
  return text;
}

std::string FormatColmapPointsText(const std::vector<ColmapPoint>& points) {
  std::string text =
      "# 3D point list with one line of data per point:\n"
      "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
      "# Number of points: " +
      std::to_string(points.size()) + "\n";
  for (const ColmapPoint& point : points) {
    text += std::to_string(point.point.id);
    for (int k = 0; k < 3; ++k) text += " " + FormatNumber(point.point.xyz[k]);
    for (const std::uint8_t colour : point.point.rgb) text += " " + std::to_string(colour);
    text += " " + FormatNumber(point.point.error_px);
    for (const auto& [image_id, feature] : point.track) {
      text += " " + std::to_string(image_id) + " " + std::to_string(feature);
    }
    text += "\n";
  }
  return text;
}

}  // namespace rsfm
