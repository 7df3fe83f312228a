// The words of rig.yaml for the rig's enumerations. For sdk/io's own readers and writers.
#pragma once

#include <string>
#include <string_view>

#include "rsfm/io/rig.h"

namespace rsfm {

std::string_view ToString(WorldFrame frame);       // "auto", "ned", "first_camera"
std::string_view ToString(InputType type);         // "rsfm.nav_t", "bot_core.pose_t", ...
std::string_view ToString(Convention convention);  // "rsfm", "libbot", ...
bool FromString(std::string_view name, WorldFrame* frame);
bool FromString(std::string_view name, InputType* type);
bool FromString(std::string_view name, Convention* convention);
std::string InputTypeNames();  // for messages
std::string ConventionNames(InputType type);
bool IsForeign(InputType type);  // its convention must be named
bool IsConventionOf(InputType type, Convention convention);
// Double-quoted for a YAML file: channel names, URLs and paths may hold any character.
std::string YamlText(std::string_view value);

// f(key in rig.yaml, channel name)
template <class Bus, class F>
void ForEachOutputChannel(Bus& bus, F&& f) {
  f("pose_channel", bus.pose_channel);
  f("status_channel", bus.status_channel);
  f("keyframe_channel", bus.keyframe_channel);
  f("keyframe_poses_channel", bus.keyframe_poses_channel);
  f("landmarks_channel", bus.landmarks_channel);
  f("water_channel", bus.water_channel);
}

}  // namespace rsfm
