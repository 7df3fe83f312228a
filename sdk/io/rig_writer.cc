#include <type_traits>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/rig.h"
#include "rsfm/io/rig_names.h"
#include "rsfm/io/rig_onboard.h"
#include "rsfm/io/text.h"

namespace rsfm {
namespace {

void AddField(std::string* text, std::string_view key, std::string_view value, int indent = 2) {
  text->append(indent, ' ');
  text->append(key).append(": ").append(value).append("\n");
}
void AddField(std::string* text, std::string_view key, double value) {
  AddField(text, key, FormatNumber(value));
}
void AddField(std::string* text, std::string_view key, const Vec3& value) {
  AddField(text, key, FormatList(value.data(), 3));
}

std::string OptionText(int value) { return std::to_string(value); }
std::string OptionText(std::uint64_t value) { return std::to_string(value); }
std::string OptionText(double value) { return FormatNumber(value); }
template <class Enum>
requires std::is_enum_v<Enum> std::string OptionText(Enum value) {
  return std::string(ToString(value));
}

std::string FormatWorld(const World& world) {
  std::string text;
  if (world.frame != WorldFrame::kAuto) AddField(&text, "frame", ToString(world.frame));
  if (world.origin) {
    text += "  origin:\n";
    AddField(&text, "latitude_deg", FormatNumber(world.origin->latitude_deg), 4);
    AddField(&text, "longitude_deg", FormatNumber(world.origin->longitude_deg), 4);
    AddField(&text, "height_m", FormatNumber(world.origin->height_m), 4);
  }
  if (!world.scale_is_metric) AddField(&text, "scale_is_metric", "false");
  return text.empty() ? text : "world:\n" + text;
}

std::string FormatSensors(const SensorPlaces& sensors) {
  std::string text;
  const auto add = [&](const char* key, const Vec3& place) {
    if (!place.isZero(0.0)) AddField(&text, key, place);
  };
  add("dvl_in_body_m", sensors.dvl_in_body_m);
  add("depth_in_body_m", sensors.depth_in_body_m);
  add("position_in_body_m", sensors.position_in_body_m);
  return text.empty() ? text : "sensors:\n" + text;
}

bool AreSame(const std::vector<BusInput>& a, const std::vector<BusInput>& b) {
  if (a.size() != b.size()) return false;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i].channel != b[i].channel || a[i].type != b[i].type ||
        a[i].convention != b[i].convention) {
      return false;
    }
  }
  return true;
}

std::string FormatBus(const BusOptions& bus) {
  const BusOptions defaults;
  std::string text;
  if (!bus.lcm_url.empty()) AddField(&text, "lcm_url", YamlText(bus.lcm_url));
  if (!AreSame(bus.inputs, defaults.inputs)) {
    text += bus.inputs.empty() ? "  inputs: []\n" : "  inputs:\n";
    for (const BusInput& input : bus.inputs) {
      text += "    - {channel: " + YamlText(input.channel) +
              ", type: " + std::string(ToString(input.type));
      if (input.convention != Convention::kRsfm) {
        text += ", convention: " + std::string(ToString(input.convention));
      }
      text += "}\n";
    }
  }
  std::vector<std::string> default_channels;
  ForEachOutputChannel(defaults, [&](const char*, const std::string& channel) {
    default_channels.push_back(channel);
  });
  std::size_t i = 0;
  ForEachOutputChannel(bus, [&](const char* key, const std::string& channel) {
    if (channel != default_channels[i++]) AddField(&text, key, YamlText(channel));
  });
  return text.empty() ? text : "bus:\n" + text;
}

std::string FormatMapper(const MapperOptions& mapper) {
  const MapperOptions defaults;
  std::vector<std::string> default_texts;
  ForEachOption(defaults, [&](const char*, const auto& value) {
    default_texts.push_back(OptionText(value));
  });
  std::string text;
  std::size_t i = 0;
  ForEachOption(mapper, [&](const char* key, const auto& value) {
    const std::string formatted = OptionText(value);
    if (formatted != default_texts[i++]) AddField(&text, key, formatted);
  });
  if (!mapper.mask.empty()) text += "  mask:\n";
  for (const MaskRectangle& r : mapper.mask) {
    text += "    - {left: " + std::to_string(r.left) + ", top: " + std::to_string(r.top) +
            ", right: " + std::to_string(r.right) + ", bottom: " + std::to_string(r.bottom) + "}\n";
  }
  return text.empty() ? text : "mapper:\n" + text;
}

}  // namespace

std::string FormatCamera(const CameraConfig& camera) {
  std::string text = "camera:\n";
  AddField(&text, "model", ToString(camera.lens));
  AddField(&text, "width", std::to_string(camera.width));
  AddField(&text, "height", std::to_string(camera.height));
  AddField(&text, "params", FormatList(camera.lens_params.data(), camera.lens_params.size()));
  const PortConfig& port = camera.port;
  text += "port:\n";
  AddField(&text, "type", ToString(port.type));
  if (port.type == PortType::kNone) return text;
  if (port.type == PortType::kFlat) {
    AddField(&text, "normal", port.normal);
    AddField(&text, "distance_m", port.distance_m);
  } else {
    AddField(&text, "center_m", port.center_m);
    AddField(&text, "radius_m", port.radius_m);
  }
  AddField(&text, "index_air", port.index_air);
  if (port.outer_layers.empty()) {
    AddField(&text, "thickness_m", port.thickness_m);
    AddField(&text, "index_glass", port.index_glass);
  } else {
    text += "  layers:  # from the inside out\n";
    const auto add = [&](double thickness_m, double index) {
      text += "    - {thickness_m: " + FormatNumber(thickness_m) +
              ", index: " + FormatNumber(index) + "}\n";
    };
    add(port.thickness_m, port.index_glass);
    for (const PortLayer& layer : port.outer_layers) add(layer.thickness_m, layer.index);
  }
  AddField(&text, "index_water", port.index_water);
  return text;
}

std::string FormatRig(const Rig& rig) {
  std::string text = FormatCamera(rig.camera);
  const Quat& q = rig.body_from_camera.rotation;
  if (!q.coeffs().isApprox(Quat::Identity().coeffs(), 0.0) ||
      !rig.body_from_camera.translation.isZero(0.0)) {
    const Vec4 wxyz(q.w(), q.x(), q.y(), q.z());
    text += "body_from_camera:\n";
    AddField(&text, "rotation_wxyz", FormatList(wxyz.data(), 4));
    AddField(&text, "translation_m", rig.body_from_camera.translation);
  }
  return text + FormatSensors(rig.sensors) + FormatWorld(rig.world) + FormatBus(rig.bus) +
         FormatMapper(rig.mapper) + FormatCaptureSection(rig.capture) +
         FormatOnboardSection(rig.onboard);
}

IoStatus WriteRig(const Rig& rig, const std::filesystem::path& path) {
  return WriteFileAtomically(path, FormatRig(rig));
}

}  // namespace rsfm
