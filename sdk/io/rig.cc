#include "rsfm/io/rig.h"

#include <cmath>
#include <set>
#include <type_traits>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/camera_yaml.h"
#include "rsfm/io/colmap_cameras.h"
#include "rsfm/io/rig_names.h"
#include "rsfm/io/rig_onboard.h"
#include "rsfm/io/text.h"
#include "rsfm/io/yaml_map.h"

namespace rsfm {
namespace {

constexpr std::size_t kMaxRigBytes = std::size_t{1} << 20;
constexpr double kUnitTolerance = 1e-6;

constexpr Bounds kLatitude{-90.0, 90.0, "give degrees from -90 to 90"};
constexpr Bounds kLongitude{-180.0, 180.0, "give degrees from -180 to 180"};
constexpr Bounds kHeight{-12000.0, 10000.0, "give metres above the ellipsoid"};
constexpr double kMaxLeverArm = 100.0;

void ReadBodyFromCamera(const YAML::Node& node, const std::string& file,
                        std::vector<Diagnostic>* problems, Rigid3* body_from_camera) {
  YamlMap map(node, "body_from_camera", file, problems);
  std::vector<double> q;
  if (map.GetNumbers("rotation_wxyz", Need::kRequired, &q)) {
    const double norm =
        q.size() == 4 ? std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]) : 0.0;
    if (q.size() != 4) {
      map.AddProblem("rotation_wxyz", "has " + std::to_string(q.size()) + " elements",
                     "give a unit quaternion [w, x, y, z]");
    } else if (std::abs(norm - 1.0) > kUnitTolerance) {
      for (double& value : q) value /= norm > 0.0 ? norm : 1.0;
      map.AddProblem("rotation_wxyz",
                     "is not a unit quaternion: its length is " + FormatNumber(norm),
                     norm > 0.0 ? "give " + FormatList(q.data(), 4) : "give [1, 0, 0, 0]");
    } else {
      body_from_camera->rotation = Quat(q[0], q[1], q[2], q[3]).normalized();
    }
  }
  map.GetVec3("translation_m", Need::kRequired, &body_from_camera->translation);
  map.Finish();
}

void ReadSensors(const YAML::Node& node, const std::string& file, std::vector<Diagnostic>* problems,
                 SensorPlaces* sensors) {
  YamlMap map(node, "sensors", file, problems);
  const auto get = [&](const char* key, Vec3* place) {
    Vec3 value;
    if (!map.GetVec3(key, Need::kOptional, &value)) return;
    if (value.norm() > kMaxLeverArm) {
      map.AddProblem(key, "is " + FormatNumber(value.norm()) + " m from the body's origin",
                     "give metres in the body frame: forward, right, down");
      return;
    }
    *place = value;
  };
  get("dvl_in_body_m", &sensors->dvl_in_body_m);
  get("depth_in_body_m", &sensors->depth_in_body_m);
  get("position_in_body_m", &sensors->position_in_body_m);
  map.Finish();
}

void ReadWorld(const YAML::Node& node, const std::string& file, std::vector<Diagnostic>* problems,
               World* world) {
  YamlMap map(node, "world", file, problems);
  std::string frame;
  if (map.GetText("frame", Need::kOptional, &frame) && !FromString(frame, &world->frame)) {
    map.AddProblem("frame", Quoted(frame) + " is not a world frame",
                   "give auto, ned or first_camera");
  }
  if (const YAML::Node origin = map.GetMap("origin", Need::kOptional)) {
    YamlMap place(origin, "world.origin", file, problems);
    Geodetic geodetic;
    bool is_whole =
        place.GetNumber("latitude_deg", Need::kRequired, kLatitude, &geodetic.latitude_deg);
    is_whole &=
        place.GetNumber("longitude_deg", Need::kRequired, kLongitude, &geodetic.longitude_deg);
    place.GetNumber("height_m", Need::kOptional, kHeight, &geodetic.height_m);
    place.Finish();
    if (is_whole) world->origin = geodetic;
  }
  map.GetBool("scale_is_metric", Need::kOptional, &world->scale_is_metric);
  map.Finish();
}

void CheckChannel(YamlMap* map, const char* key, const std::string& channel) {
  if (channel.size() <= 63) return;
  map->AddProblem(key, "is longer than LCM's 63 characters", "give a shorter channel name");
}

void ReadInput(const YAML::Node& node, std::size_t index, const std::string& file,
               std::vector<Diagnostic>* problems, std::vector<BusInput>* inputs) {
  YamlMap map(node, "bus.inputs[" + std::to_string(index) + "]", file, problems);
  BusInput input;
  std::string type, convention;
  const bool has_channel = map.GetText("channel", Need::kRequired, &input.channel);
  if (has_channel) CheckChannel(&map, "channel", input.channel);
  if (map.GetText("type", Need::kRequired, &type) && !FromString(type, &input.type)) {
    map.AddProblem("type", Quoted(type) + " is not a message type that is read here",
                   "give one of " + InputTypeNames());
  }
  const bool is_foreign = IsForeign(input.type);
  if (map.GetText("convention", is_foreign ? Need::kRequired : Need::kOptional, &convention)) {
    const bool is_known = FromString(convention, &input.convention);
    if (!is_known || !IsConventionOf(input.type, input.convention)) {
      map.AddProblem(
          "convention", Quoted(convention) + " is no convention of " + type,
          is_foreign ? "give " + ConventionNames(input.type) : "give rsfm, or leave it out");
    }
  }
  map.Finish();
  inputs->push_back(input);
}

// A channel has one meaning: two inputs on it would read each message in two ways, and what is
// published on it would be heard.
void CheckChannelsDiffer(YamlMap* map, const BusOptions& bus) {
  std::set<std::string_view> channels;
  for (const BusInput& input : bus.inputs) {
    if (input.channel.empty() || channels.insert(input.channel).second) continue;
    map->AddProblem("inputs", Quoted(input.channel) + " is there twice",
                    "give each channel once, with the one type and convention that it has");
  }
  ForEachOutputChannel(bus, [&](const char* key, const std::string& channel) {
    if (channels.insert(channel).second) return;
    map->AddProblem(key, Quoted(channel) + " is the name of another channel, too",
                    "give each channel a name of its own");
  });
}

void ReadBus(const YAML::Node& node, const std::string& file, std::vector<Diagnostic>* problems,
             BusOptions* bus) {
  YamlMap map(node, "bus", file, problems);
  map.GetText("lcm_url", Need::kOptional, &bus->lcm_url);
  if (const YAML::Node list = map.GetList("inputs", Need::kOptional)) {
    bus->inputs.clear();
    for (std::size_t i = 0; i < list.size(); ++i) {
      ReadInput(list[i], i, file, problems, &bus->inputs);
    }
  }
  ForEachOutputChannel(*bus, [&](const char* key, std::string& channel) {
    if (map.GetText(key, Need::kOptional, &channel)) CheckChannel(&map, key, channel);
  });
  CheckChannelsDiffer(&map, *bus);
  map.Finish();
}

// A member of MapperOptions by its type; its range is asked of MapperOptions afterwards.
struct OptionReader {
  YamlMap* map;

  void operator()(const char* key, int& value) const {
    std::int64_t number = 0;
    if (map->GetInteger(key, Need::kOptional, -(1 << 30), 1 << 30, &number))
      value = static_cast<int>(number);
  }
  void operator()(const char* key, std::uint64_t& value) const {
    std::int64_t number = 0;
    if (map->GetInteger(key, Need::kOptional, 0, INT64_MAX, &number)) {
      value = static_cast<std::uint64_t>(number);
    }
  }
  void operator()(const char* key, double& value) const {
    map->GetNumber(key, Need::kOptional, {}, &value);
  }
  template <class Enum>
  requires std::is_enum_v<Enum>
  void operator()(const char* key, Enum& value) const {
    std::string name;
    if (!map->GetText(key, Need::kOptional, &name) || FromString(name, &value)) return;
    std::string known;
    for (int i = 0; i < 16; ++i) {
      const auto candidate = static_cast<Enum>(i);
      Enum back;
      if (!FromString(ToString(candidate), &back) || back != candidate) break;
      known += (i > 0 ? ", " : "") + std::string(ToString(candidate));
    }
    map->AddProblem(key, Quoted(name) + " is not one of its values", "give one of " + known);
  }
};

void ReadMask(YamlMap* map, const std::string& file, ImageMask* mask) {
  const YAML::Node list = map->GetList("mask", Need::kOptional);
  if (!list) return;
  mask->clear();
  for (std::size_t i = 0; i < list.size(); ++i) {
    YamlMap entry(list[i], "mapper.mask[" + std::to_string(i) + "]", file, map->problems());
    MaskRectangle rectangle;
    const auto get = [&](const char* key, int* value) {
      std::int64_t number = 0;
      if (entry.GetInteger(key, Need::kRequired, -(1 << 16), 1 << 16, &number)) {
        *value = static_cast<int>(number);
      }
    };
    get("left", &rectangle.left);
    get("top", &rectangle.top);
    get("right", &rectangle.right);
    get("bottom", &rectangle.bottom);
    if (rectangle.right < rectangle.left || rectangle.bottom < rectangle.top) {
      entry.AddProblem("", "ends before it begins", "give left < right and top < bottom");
    }
    entry.Finish();
    if (!mask->TryPushBack(rectangle)) {
      map->AddProblem("mask", "has more than " + std::to_string(kMaxMaskRectangles) + " rectangles",
                      "join some of them");
      return;
    }
  }
}

void ReadMapper(const YAML::Node& node, const std::string& file, std::vector<Diagnostic>* problems,
                MapperOptions* mapper) {
  YamlMap map(node, "mapper", file, problems);
  const std::size_t first_problem = problems->size();
  ForEachOption(*mapper, OptionReader{&map});
  ReadMask(&map, file, &mapper->mask);
  map.Finish();
  if (problems->size() != first_problem) return;
  const Status status = mapper->Validate();
  if (status) return;
  const std::string see = "see this option in rsfm/mapping/mapper_options.h";
  for (const OptionRange& range : mapper->Ranges()) {
    if (range.is_met()) continue;
    map.AddProblem(range.name, "is out of range: " + FormatNumber(range.value),
                   "give a number from " + FormatNumber(range.low) + " to " +
                       FormatNumber(range.high) + "; " + see);
    return;
  }
  map.AddProblem(status.error().where, "contradicts another option", see);
}

// The light that water measured during the mission is judged by: what the port says of it.
void ReadWavelength(const YAML::Node& port, MapperOptions* mapper) {
  for (const YAML::Node& node : {port, YAML::Node(port["water"])}) {
    if (!node || !node.IsMap() || !node["wavelength_nm"] || !node["wavelength_nm"].IsScalar())
      continue;
    const auto value = ParseNumber(node["wavelength_nm"].Scalar());
    // ReadPortSection has said what is wrong with any other.
    if (value && *value >= 400.0 && *value <= 700.0) mapper->light_wavelength_nm = *value;
  }
}

void ReadRigSections(const YAML::Node& root, const std::string& file,
                     std::vector<Diagnostic>* problems, Rig* rig) {
  YamlMap map(root, "", file, problems);
  if (const YAML::Node node = map.GetMap("camera", Need::kRequired)) {
    ReadCameraSection(node, file, problems, &rig->camera);
  }
  if (const YAML::Node node = map.GetMap("port", Need::kRequired)) {
    ReadPortSection(node, file, problems, &rig->camera.port);
    ReadWavelength(node, &rig->mapper);
  }
  if (const YAML::Node node = map.GetMap("body_from_camera", Need::kOptional)) {
    ReadBodyFromCamera(node, file, problems, &rig->body_from_camera);
  }
  if (const YAML::Node node = map.GetMap("sensors", Need::kOptional)) {
    ReadSensors(node, file, problems, &rig->sensors);
  }
  if (const YAML::Node node = map.GetMap("world", Need::kOptional)) {
    ReadWorld(node, file, problems, &rig->world);
  }
  if (const YAML::Node node = map.GetMap("bus", Need::kOptional)) {
    ReadBus(node, file, problems, &rig->bus);
  }
  if (const YAML::Node node = map.GetMap("mapper", Need::kOptional)) {
    ReadMapper(node, file, problems, &rig->mapper);
  }
  if (const YAML::Node node = map.GetMap("capture", Need::kOptional)) {
    ReadCaptureSection(node, file, problems, &rig->capture);
  }
  if (const YAML::Node node = map.GetMap("onboard", Need::kOptional)) {
    ReadOnboardSection(node, file, problems, &rig->onboard);
  }
  map.Finish();
}

}  // namespace

IoExpected<Rig> ParseRig(const std::string& text, const std::string& name,
                         std::vector<Diagnostic>* problems) {
  std::vector<Diagnostic> found;
  Rig rig;
  const auto root = ParseYaml(text, name);
  if (!root) {
    found.push_back(root.error());
  } else {
    try {
      if (IsCalibmar(*root)) {
        ReadCalibmar(*root, name, &found, &rig.camera);
      } else {
        ReadRigSections(*root, name, &found, &rig);
      }
    } catch (const YAML::Exception& error) {
      found.push_back({Errc::kCorrupt, name, "", "cannot be read: " + error.msg, "repair the line",
                       error.mark.line + 1});
    }
  }
  if (problems != nullptr) *problems = found;
  if (!found.empty()) return Fail(found.front());
  return rig;
}

IoExpected<Rig> ReadRig(const std::filesystem::path& path, std::vector<Diagnostic>* problems) {
  const auto fail = [&](const Diagnostic& diagnostic) {
    if (problems != nullptr) *problems = {diagnostic};
    return Fail(diagnostic);
  };
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    return fail({Errc::kInvalidArgument, path.string(), "", "is a folder, not a rig file",
                 "give the file, " + (path / "rig.yaml").string()});
  }
  const auto text = ReadWholeFile(path, kMaxRigBytes);
  if (!text) return fail(text.error());
  const std::string extension = path.extension().string();
  if (extension == ".txt" || extension == ".bin") {
    const auto cameras = extension == ".txt" ? ParseColmapCamerasText(*text, path.string())
                                             : ParseColmapCamerasBinary(*text, path.string());
    if (!cameras) return fail(cameras.error());
    if (cameras->size() != 1) {
      return fail({Errc::kInvalidArgument, path.string(), "",
                   "holds " + std::to_string(cameras->size()) + " cameras",
                   "give a file with the one camera that is meant"});
    }
    Rig rig;
    rig.camera = cameras->front().config;
    return rig;
  }
  return ParseRig(*text, path.string(), problems);
}

}  // namespace rsfm
