// The rig: everything a vehicle has to say about its camera, port, mounting, bus and mapper. One
// YAML file, rig.yaml; a file with just `camera` and `port` is a complete camera file.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "rsfm/base/rigid3.h"
#include "rsfm/io/diagnostic.h"
#include "rsfm/io/onboard_options.h"
#include "rsfm/mapping/mapper_options.h"
#include "rsfm/navigation/local_frame.h"
#include "rsfm/refraction/camera_config.h"

namespace rsfm {

// What the coordinates of poses and points refer to.
enum class WorldFrame : std::uint8_t {
  kAuto,         // not decided: NED when navigation places the first image, else kFirstCamera
  kNed,          // local north-east-down at World::origin, or at an unknown place without it
  kFirstCamera,  // x right, y down, z forward of the first keyframe's camera
};

struct World {
  WorldFrame frame = WorldFrame::kAuto;
  std::optional<Geodetic> origin;
  bool scale_is_metric = true;  // false: no sensor gave scale
};

// Where the sensors sit, in the body frame (forward-right-down).
struct SensorPlaces {
  Vec3 dvl_in_body_m = Vec3::Zero();
  Vec3 depth_in_body_m = Vec3::Zero();
  Vec3 position_in_body_m = Vec3::Zero();  // the antenna or transponder of fix_t
};

// A channel to listen to, and how to read it. rsfm's own types have one meaning each; of a foreign
// type the convention must be named, because its fingerprint does not tell.
enum class InputType : std::uint8_t {
  kNav,
  kDvl,
  kAhrs,
  kDepth,
  kCtd,
  kFix,
  kBotCorePose,
  kAcfrNav
};
enum class Convention : std::uint8_t {
  kRsfm,           // rsfm's own types
  kLibbot,         // bot_core.pose_t: body x forward z up, velocity and rates in the local frame
  kOpenHumanoids,  // bot_core.pose_t: ENU position, body z down, velocity and rates in the body
  kAcfr,           // acfrlcm.auv_acfr_nav_t: north-east-down, velocity in the body
};
struct BusInput {
  std::string channel;
  InputType type = InputType::kNav;
  Convention convention = Convention::kRsfm;
};

struct BusOptions {
  std::string lcm_url;  // empty: LCM_DEFAULT_URL, else LCM's default
  std::vector<BusInput> inputs = {
      {"RSFM_NAV", InputType::kNav, Convention::kRsfm},
      {"RSFM_DVL", InputType::kDvl, Convention::kRsfm},
      {"RSFM_AHRS", InputType::kAhrs, Convention::kRsfm},
      {"RSFM_DEPTH", InputType::kDepth, Convention::kRsfm},
      {"RSFM_CTD", InputType::kCtd, Convention::kRsfm},
      {"RSFM_FIX", InputType::kFix, Convention::kRsfm},
  };
  std::string pose_channel = "RSFM_POSE";
  std::string status_channel = "RSFM_STATUS";
  std::string keyframe_channel = "RSFM_KEYFRAME";
  std::string keyframe_poses_channel = "RSFM_KEYFRAME_POSES";
  std::string landmarks_channel = "RSFM_LANDMARKS";
  std::string water_channel = "RSFM_WATER";
};

struct Rig {
  CameraConfig camera;
  Rigid3 body_from_camera;  // default: the camera is the body
  SensorPlaces sensors;
  World world;
  BusOptions bus;
  MapperOptions mapper;
  CaptureOptions capture;
  OnboardOptions onboard;
};

// Reads a rig file: rig.yaml, calibmar's YAML, or COLMAP's cameras.txt / cameras.bin with one
// camera (also with colmap_underwater's columns). Every missing, unknown, mistyped or out-of-range
// field is an error that names file, line, field and fix. `problems`, where given, gets all of
// them, the first of which is returned.
IoExpected<Rig> ReadRig(const std::filesystem::path& path,
                        std::vector<Diagnostic>* problems = nullptr);
// The same from text; `name` stands for the file in messages.
IoExpected<Rig> ParseRig(const std::string& text, const std::string& name,
                         std::vector<Diagnostic>* problems = nullptr);

// rig.yaml as text. What has its default value is left out, except camera and port; numbers keep
// their full precision.
std::string FormatRig(const Rig& rig);
// Only `camera` and `port`.
std::string FormatCamera(const CameraConfig& camera);
IoStatus WriteRig(const Rig& rig, const std::filesystem::path& path);

}  // namespace rsfm
