#include "rsfm/io/trajectory.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <unordered_map>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/binary.h"
#include "rsfm/io/text.h"
#include "rsfm/navigation/local_frame.h"

namespace rsfm {
namespace {

IoExpected<LocalFrame> FrameOf(const World& world) {
  if (world.frame != WorldFrame::kNed || !world.origin || !world.scale_is_metric) {
    return Fail({Errc::kInvalidArgument, "", "world",
                 "is not on earth: it must be NED in metres with an origin",
                 "give navigation with latitudes, or world.origin in rig.yaml"});
  }
  auto frame = LocalFrame::Create(*world.origin);
  if (!frame) {
    return Fail({Errc::kInvalidArgument, "", std::string("world.origin.") + frame.error().where,
                 "is not a place on earth", "correct it in rig.yaml"});
  }
  return *frame;
}

std::string Coordinates(const LocalFrame& frame, const TrajectoryPose& pose) {
  const Geodetic place = frame.GeodeticFromNed(pose.world_from_camera.translation);
  char text[96];
  std::snprintf(text, sizeof text, "%.9f,%.9f,%.3f", place.longitude_deg, place.latitude_deg,
                place.height_m);
  return text;
}

std::string XmlText(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '&') {
      result += "&amp;";
    } else if (c == '<') {
      result += "&lt;";
    } else {
      result += c;
    }
  }
  return result;
}

std::string JsonText(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      result += std::string("\\") + c;
    } else if (byte < 0x20) {
      char escaped[8];
      std::snprintf(escaped, sizeof escaped, "\\u%04x", byte);
      result += escaped;
    } else {
      result += c;
    }
  }
  return result + "\"";
}

}  // namespace

std::vector<TrajectoryPose> TrajectoryOf(const Model& model) {
  std::vector<TrajectoryPose> poses;
  for (const ModelImage& image : model.images) {
    poses.push_back({image.utime, image.name, image.camera_from_world.Inverse()});
  }
  std::stable_sort(
      poses.begin(), poses.end(),
      [](const TrajectoryPose& a, const TrajectoryPose& b) { return a.utime < b.utime; });
  return poses;
}

std::vector<TrajectoryPose> TrajectoryOf(const Mission& mission) {
  std::unordered_map<Utime, const std::string*> image_of_time;
  for (const ImageTime& image : mission.images) image_of_time[image.utime] = &image.image;
  std::map<Utime, TrajectoryPose> poses;
  for (const pose_t& message : mission.poses) {
    if (message.state != pose_t::STATE_TRACKING) continue;
    const double* q = message.frame_from_body_q;
    const Quat rotation(q[0], q[1], q[2], q[3]);
    const Vec3 position(message.position_m[0], message.position_m[1], message.position_m[2]);
    if (!(std::abs(rotation.norm() - 1.0) < 1e-6) || !position.allFinite()) continue;
    TrajectoryPose pose;
    pose.utime = message.utime;
    pose.world_from_camera = Rigid3(rotation, position) * mission.rig.body_from_camera;
    const auto image = image_of_time.find(message.utime);
    if (image != image_of_time.end()) pose.image = *image->second;
    poses[message.utime] = std::move(pose);
  }
  std::vector<TrajectoryPose> result;
  for (auto& [utime, pose] : poses) result.push_back(std::move(pose));
  return result;
}

std::string FormatTum(const std::vector<TrajectoryPose>& poses) {
  std::string text = "# timestamp tx ty tz qx qy qz qw\n";
  const bool has_times = std::any_of(poses.begin(), poses.end(),
                                     [](const TrajectoryPose& pose) { return pose.utime != 0; });
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const Utime utime = poses[i].utime;
    char stamp[40];
    std::snprintf(stamp, sizeof stamp, "%s%lld.%06lld", utime < 0 ? "-" : "",
                  std::abs(static_cast<long long>(utime / 1000000)),
                  std::abs(static_cast<long long>(utime % 1000000)));
    text += has_times ? std::string(stamp) : std::to_string(i);
    const Vec3& t = poses[i].world_from_camera.translation;
    const Quat& q = poses[i].world_from_camera.rotation;
    for (const double value : {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}) {
      text += " " + FormatNumber(value);
    }
    text += "\n";
  }
  return text;
}

IoExpected<std::vector<TrajectoryPose>> ReadTum(const std::filesystem::path& path) {
  const auto text = ReadWholeFile(path);
  if (!text) return Fail(text.error());
  std::vector<TrajectoryPose> poses;
  std::string_view rest = *text, line;
  std::vector<std::string_view> fields;
  for (int number = 1; NextLine(&rest, &line); ++number) {
    line = Trim(line);
    if (line.empty() || line.front() == '#') continue;
    SplitBlanks(line, &fields);
    double values[8] = {};
    bool is_good = fields.size() == 8;
    for (std::size_t i = 0; is_good && i < 8; ++i) {
      const auto value = ParseNumber(fields[i]);
      is_good = value && std::isfinite(*value);
      if (is_good) values[i] = *value;
    }
    const Quat q(values[7], values[4], values[5], values[6]);
    if (!is_good || !(std::abs(q.norm() - 1.0) < 1e-3) || std::abs(values[0]) > 9e12) {
      return Fail({Errc::kCorrupt, path.string(), "", "is not a pose: " + Quoted(line),
                   "write timestamp tx ty tz qx qy qz qw with a unit quaternion", number});
    }
    poses.push_back({UsFromSeconds(values[0]), "",
                     Rigid3(q.normalized(), Vec3(values[1], values[2], values[3]))});
  }
  return poses;
}

IoExpected<std::string> FormatKml(const std::vector<TrajectoryPose>& poses, const World& world,
                                  const std::string& name) {
  const auto frame = FrameOf(world);
  if (!frame) return Fail(frame.error());
  std::string text =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<kml xmlns=\"http://www.opengis.net/kml/2.2\">\n<Document>\n<name>" +
      XmlText(name) +
      "</name>\n<Placemark>\n<name>camera</name>\n<Style><LineStyle><color>ff0000ff</color>"
      "<width>2</width></LineStyle></Style>\n<LineString>\n"
      "<altitudeMode>absolute</altitudeMode>\n<coordinates>\n";
  for (const TrajectoryPose& pose : poses) text += Coordinates(*frame, pose) + "\n";
  return text + "</coordinates>\n</LineString>\n</Placemark>\n</Document>\n</kml>\n";
}

IoExpected<std::string> FormatGeoJson(const std::vector<TrajectoryPose>& poses, const World& world,
                                      const std::string& name) {
  const auto frame = FrameOf(world);
  if (!frame) return Fail(frame.error());
  std::string line, points;
  for (const TrajectoryPose& pose : poses) {
    const std::string coordinates = "[" + Coordinates(*frame, pose) + "]";
    line += (line.empty() ? "" : ",") + coordinates;
    points += ",\n{\"type\":\"Feature\",\"properties\":{\"image\":" + JsonText(pose.image) +
              ",\"utime\":" + std::to_string(pose.utime) +
              "},\"geometry\":{\"type\":\"Point\",\"coordinates\":" + coordinates + "}}";
  }
  return "{\"type\":\"FeatureCollection\",\"features\":[\n{\"type\":\"Feature\",\"properties\":{"
         "\"name\":" +
         JsonText(name) + "},\"geometry\":{\"type\":\"LineString\",\"coordinates\":[" + line +
         "]}}" + points + "\n]}\n";
}

std::string FormatPly(const Model& model, const std::vector<TrajectoryPose>& cameras) {
  const std::size_t count = model.points.size() + cameras.size();
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\ncomment metres; points, then camera centres in red\n"
      "element vertex " +
      std::to_string(count) +
      "\nproperty double x\nproperty double y\nproperty double z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
  const auto add = [&](const Vec3& xyz, const std::array<std::uint8_t, 3>& rgb) {
    for (int k = 0; k < 3; ++k) AppendBinary(&bytes, xyz[k]);
    for (const std::uint8_t colour : rgb) AppendBinary(&bytes, colour);
  };
  for (const ModelPoint& point : model.points) add(point.xyz, point.rgb);
  for (const TrajectoryPose& pose : cameras) add(pose.world_from_camera.translation, {255, 0, 0});
  return bytes;
}

}  // namespace rsfm
