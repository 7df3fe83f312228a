#include "rsfm/io/rig_onboard.h"

#include <array>
#include <type_traits>

#include "rsfm/io/rig_names.h"
#include "rsfm/io/text.h"

namespace rsfm {
namespace {

constexpr std::array<std::string_view, 8> kPixelFormats = {"auto", "grey", "y16",    "y10",
                                                           "nv12", "yuyv", "bayer8", "mjpeg"};

// A member of CaptureOptions or OnboardOptions by its type.
struct Reader {
  YamlMap* map;

  template <class T>
  void operator()(const char* key, T& value, std::int64_t low, std::int64_t high) const {
    if constexpr (std::is_same_v<T, bool>) {
      map->GetBool(key, Need::kOptional, &value);
    } else if constexpr (std::is_integral_v<T>) {
      std::int64_t number = 0;
      if (map->GetInteger(key, Need::kOptional, low, high, &number)) value = static_cast<T>(number);
    } else {
      const std::string fix =
          "give a number from " + std::to_string(low) + " to " + std::to_string(high);
      map->GetNumber(key, Need::kOptional,
                     {static_cast<double>(low), static_cast<double>(high), fix.c_str()}, &value);
    }
  }
};

std::string OptionText(bool value) { return value ? "true" : "false"; }
std::string OptionText(double value) { return FormatNumber(value); }
std::string OptionText(int value) { return std::to_string(value); }
std::string OptionText(std::int64_t value) { return std::to_string(value); }

std::string Line(const std::string& key, const std::string& value) {
  return "  " + key + ": " + value + "\n";
}

// Those options that differ from their defaults. `for_each` is one of the ForEach... above.
template <class Options, class ForEach>
std::string FormatOptions(const Options& options, ForEach&& for_each) {
  const Options defaults;
  std::vector<std::string> default_texts;
  for_each(defaults, [&](const char*, const auto& value, auto, auto) {
    default_texts.push_back(OptionText(value));
  });
  std::string text;
  std::size_t i = 0;
  for_each(options, [&](const char* key, const auto& value, auto, auto) {
    const std::string formatted = OptionText(value);
    if (formatted != default_texts[i++]) text += Line(key, formatted);
  });
  return text;
}

}  // namespace

std::string_view ToString(PixelFormat format) {
  return kPixelFormats[static_cast<std::size_t>(format)];
}

bool FromString(std::string_view name, PixelFormat* format) {
  for (std::size_t i = 0; i < kPixelFormats.size(); ++i) {
    if (kPixelFormats[i] != name) continue;
    *format = static_cast<PixelFormat>(i);
    return true;
  }
  return false;
}

void ReadCaptureSection(const YAML::Node& node, const std::string& file,
                        std::vector<Diagnostic>* problems, CaptureOptions* capture) {
  YamlMap map(node, "capture", file, problems);
  map.GetText("device", Need::kOptional, &capture->device);
  std::string format;
  if (map.GetText("format", Need::kOptional, &format) && !FromString(format, &capture->format)) {
    map.AddProblem("format", Quoted(format) + " is not a pixel format that is read here",
                   "give auto, grey, y16, y10, nv12, yuyv, bayer8 or mjpeg");
  }
  ForEachCaptureOption(*capture, Reader{&map});
  if (const YAML::Node list = map.GetMap("controls", Need::kOptional)) {
    YamlMap controls(list, "capture.controls", file, problems);
    for (const auto& entry : list) {
      const std::string name = entry.first.IsScalar() ? entry.first.Scalar() : std::string();
      std::int64_t value = 0;
      if (controls.GetInteger(name, Need::kRequired, INT64_MIN, INT64_MAX, &value))
        capture->controls[name] = value;
    }
    controls.Finish();
  }
  map.Finish();
}

void ReadOnboardSection(const YAML::Node& node, const std::string& file,
                        std::vector<Diagnostic>* problems, OnboardOptions* onboard) {
  YamlMap map(node, "onboard", file, problems);
  map.GetText("missions_folder", Need::kOptional, &onboard->missions_folder);
  ForEachOnboardOption(*onboard, Reader{&map});
  map.Finish();
}

std::string FormatCaptureSection(const CaptureOptions& capture) {
  const CaptureOptions defaults;
  std::string text;
  if (capture.device != defaults.device) text += Line("device", YamlText(capture.device));
  if (capture.format != defaults.format)
    text += Line("format", std::string(ToString(capture.format)));
  text += FormatOptions(capture, [](auto& options, auto&& f) { ForEachCaptureOption(options, f); });
  if (!capture.controls.empty()) text += "  controls:\n";
  for (const auto& [name, value] : capture.controls)
    text += "  " + Line(YamlText(name), std::to_string(value));
  return text.empty() ? text : "capture:\n" + text;
}

std::string FormatOnboardSection(const OnboardOptions& onboard) {
  const OnboardOptions defaults;
  std::string text;
  if (onboard.missions_folder != defaults.missions_folder)
    text += Line("missions_folder", YamlText(onboard.missions_folder));
  text += FormatOptions(onboard, [](auto& options, auto&& f) { ForEachOnboardOption(options, f); });
  return text.empty() ? text : "onboard:\n" + text;
}

}  // namespace rsfm
