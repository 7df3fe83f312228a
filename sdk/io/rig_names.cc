#include "rsfm/io/rig_names.h"

#include <array>

namespace rsfm {
namespace {

// Index = value of the enumerator.
constexpr std::array<std::string_view, 3> kWorldFrames = {"auto", "ned", "first_camera"};
constexpr std::array<std::string_view, 8> kInputTypes = {
    "rsfm.nav_t", "rsfm.dvl_t", "rsfm.ahrs_t",     "rsfm.depth_t",
    "rsfm.ctd_t", "rsfm.fix_t", "bot_core.pose_t", "acfrlcm.auv_acfr_nav_t"};
constexpr std::array<std::string_view, 4> kConventions = {"rsfm", "libbot", "openhumanoids",
                                                          "acfr"};

template <class Enum, std::size_t N>
bool Find(const std::array<std::string_view, N>& names, std::string_view name, Enum* value) {
  for (std::size_t i = 0; i < N; ++i) {
    if (names[i] != name) continue;
    *value = static_cast<Enum>(i);
    return true;
  }
  return false;
}

}  // namespace

std::string_view ToString(WorldFrame frame) {
  return kWorldFrames[static_cast<std::size_t>(frame)];
}
std::string_view ToString(InputType type) { return kInputTypes[static_cast<std::size_t>(type)]; }
std::string_view ToString(Convention convention) {
  return kConventions[static_cast<std::size_t>(convention)];
}
bool FromString(std::string_view name, WorldFrame* frame) {
  return Find(kWorldFrames, name, frame);
}
bool FromString(std::string_view name, InputType* type) { return Find(kInputTypes, name, type); }
bool FromString(std::string_view name, Convention* convention) {
  return Find(kConventions, name, convention);
}

std::string InputTypeNames() {
  std::string text;
  for (const std::string_view name : kInputTypes) {
    text += (text.empty() ? "" : ", ") + std::string(name);
  }
  return text;
}

std::string ConventionNames(InputType type) {
  std::string text;
  for (std::size_t i = 0; i < kConventions.size(); ++i) {
    if (!IsConventionOf(type, static_cast<Convention>(i))) continue;
    text += (text.empty() ? "" : " or ") + std::string(kConventions[i]);
  }
  return text;
}

bool IsForeign(InputType type) {
  return type == InputType::kBotCorePose || type == InputType::kAcfrNav;
}

bool IsConventionOf(InputType type, Convention convention) {
  switch (type) {
    case InputType::kBotCorePose:
      return convention == Convention::kLibbot || convention == Convention::kOpenHumanoids;
    case InputType::kAcfrNav:
      return convention == Convention::kAcfr;
    default:
      return convention == Convention::kRsfm;
  }
}

std::string YamlText(std::string_view value) {
  std::string result = "\"";
  for (const char c : value) {
    if (c == '"' || c == '\\') result += '\\';
    result += c;
  }
  return result + "\"";
}

}  // namespace rsfm
