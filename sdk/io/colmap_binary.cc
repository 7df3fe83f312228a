#include <cmath>

#include "rsfm/io/binary.h"
#include "rsfm/io/colmap_files.h"

namespace rsfm {
namespace {

constexpr std::size_t kLeastImageBytes = 4 + 7 * 8 + 4 + 1 + 8;
constexpr std::size_t kFeatureBytes = 2 * 8 + 8;
constexpr std::size_t kLeastPointBytes = 8 + 3 * 8 + 3 + 8 + 8;
constexpr std::size_t kTrackElementBytes = 4 + 4;

tl::unexpected<Diagnostic> Corrupt(const std::string& name, const BinaryReader& reader,
                                   std::string field, const std::string& problem) {
  return Fail({Errc::kCorrupt, name, std::move(field),
               problem + ", at byte " + std::to_string(reader.offset()), "write the model again"});
}

std::string Which(const char* kind, std::size_t index, std::size_t count) {
  return kind + std::to_string(index + 1) + " of " + std::to_string(count);
}

bool ReadFeatures(BinaryReader* reader, ColmapImage* image) {
  std::size_t count = 0;
  if (!reader->ReadCount(kFeatureBytes, &count)) return false;
  image->image.features.resize(count);
  image->point_ids.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    Vec2& feature = image->image.features[i];
    if (!reader->Read(&feature.x()) || !reader->Read(&feature.y()) ||
        !reader->Read(&image->point_ids[i]) || !feature.allFinite()) {
      return false;
    }
  }
  return true;
}

bool ReadTrack(BinaryReader* reader, ColmapPoint* point) {
  std::size_t count = 0;
  if (!reader->ReadCount(kTrackElementBytes, &count)) return false;
  point->track.resize(count);
  for (auto& [image_id, feature] : point->track) {
    if (!reader->Read(&image_id) || !reader->Read(&feature)) return false;
  }
  return true;
}

}  // namespace

IoExpected<std::vector<ColmapImage>> ParseColmapImagesBinary(const std::string& bytes,
                                                             const std::string& name) {
  BinaryReader reader(bytes);
  std::size_t count = 0;
  if (!reader.ReadCount(kLeastImageBytes, &count)) {
    return Corrupt(name, reader, "", "is cut off or not an images.bin");
  }
  std::vector<ColmapImage> images(count);
  for (std::size_t i = 0; i < count; ++i) {
    ColmapImage& image = images[i];
    double pose[7] = {};
    reader.Read(&image.image.id);
    for (double& value : pose) reader.Read(&value);
    reader.Read(&image.camera_id);
    if (!reader.ReadText(&image.image.name) || !ReadFeatures(&reader, &image)) {
      return Corrupt(name, reader, Which("image ", i, count), "is cut off or damaged");
    }
    if (!SetPose(pose, &image.image.camera_from_world)) {
      return Corrupt(name, reader, Which("image ", i, count), "has no possible pose");
    }
  }
  if (!reader.AtEnd()) return Corrupt(name, reader, "", "has bytes after its last image");
  return images;
}

IoExpected<std::vector<ColmapPoint>> ParseColmapPointsBinary(const std::string& bytes,
                                                             const std::string& name) {
  BinaryReader reader(bytes);
  std::size_t count = 0;
  if (!reader.ReadCount(kLeastPointBytes, &count)) {
    return Corrupt(name, reader, "", "is cut off or not a points3D.bin");
  }
  std::vector<ColmapPoint> points(count);
  for (std::size_t i = 0; i < count; ++i) {
    ColmapPoint& point = points[i];
    reader.Read(&point.point.id);
    for (int k = 0; k < 3; ++k) reader.Read(&point.point.xyz[k]);
    for (std::uint8_t& colour : point.point.rgb) reader.Read(&colour);
    reader.Read(&point.point.error_px);
    if (!ReadTrack(&reader, &point)) {
      return Corrupt(name, reader, Which("point ", i, count), "is cut off or damaged");
    }
    if (!point.point.xyz.allFinite() || !std::isfinite(point.point.error_px)) {
      return Corrupt(name, reader, Which("point ", i, count), "is not finite");
    }
  }
  if (!reader.AtEnd()) return Corrupt(name, reader, "", "has bytes after its last point");
  return points;
}

std::string FormatColmapImagesBinary(const std::vector<ColmapImage>& images) {
  std::string bytes;
  AppendBinary(&bytes, static_cast<std::uint64_t>(images.size()));
  for (const ColmapImage& image : images) {
    const Quat& q = image.image.camera_from_world.rotation;
    const Vec3& t = image.image.camera_from_world.translation;
    AppendBinary(&bytes, image.image.id);
    for (const double value : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) {
      AppendBinary(&bytes, value);
    }
    AppendBinary(&bytes, image.camera_id);
    bytes.append(image.image.name).push_back('\0');
    AppendBinary(&bytes, static_cast<std::uint64_t>(image.image.features.size()));
    for (std::size_t i = 0; i < image.image.features.size(); ++i) {
      AppendBinary(&bytes, image.image.features[i].x());
      AppendBinary(&bytes, image.image.features[i].y());
      AppendBinary(&bytes, image.point_ids[i]);
    }
  }
  return bytes;
}

std::string FormatColmapPointsBinary(const std::vector<ColmapPoint>& points) {
  std::string bytes;
  AppendBinary(&bytes, static_cast<std::uint64_t>(points.size()));
  for (const ColmapPoint& point : points) {
    AppendBinary(&bytes, point.point.id);
    for (int k = 0; k < 3; ++k) AppendBinary(&bytes, point.point.xyz[k]);
    for (const std::uint8_t colour : point.point.rgb) AppendBinary(&bytes, colour);
    AppendBinary(&bytes, point.point.error_px);
    AppendBinary(&bytes, static_cast<std::uint64_t>(point.track.size()));
    for (const auto& [image_id, feature] : point.track) {
      AppendBinary(&bytes, image_id);
      AppendBinary(&bytes, feature);
    }
  }
  return bytes;
}

}  // namespace rsfm
