// A reconstruction in memory, for the desk. Elements refer to each other by index into the model's
// vectors; `id` is what COLMAP's files call them.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "rsfm/base/rigid3.h"
#include "rsfm/base/time.h"
#include "rsfm/io/diagnostic.h"
#include "rsfm/io/rig.h"
#include "rsfm/refraction/camera_config.h"

namespace rsfm {

inline constexpr std::int32_t kNoPoint = -1;

struct ModelCamera {
  std::uint32_t id = 0;  // 0: the writer gives one
  CameraConfig config;
};

struct ModelImage {
  std::uint32_t id = 0;  // 0: the writer gives one
  std::string name;      // file name, relative to the images folder
  Utime utime = 0;       // mid-exposure; 0: not known
  std::int32_t camera = 0;
  Rigid3 camera_from_world;
  std::vector<Vec2> features;        // px, as observed (refracted, distorted)
  std::vector<std::int32_t> points;  // per feature: index into Model::points, or kNoPoint
};

struct TrackElement {
  std::int32_t image = 0;    // index into Model::images
  std::int32_t feature = 0;  // index into that image's features
};

struct ModelPoint {
  std::uint64_t id = 0;  // 0: the writer gives one
  Vec3 xyz = Vec3::Zero();
  std::array<std::uint8_t, 3> rgb = {128, 128, 128};
  double error_px = -1.0;  // mean reprojection error; negative: not known
  std::vector<TrackElement> track;
};

struct Model {
  Rig rig;  // rig.camera is cameras[0].config where there is one
  std::vector<ModelCamera> cameras;
  std::vector<ModelImage> images;
  std::vector<ModelPoint> points;
};

// kInvalidArgument unless every index is in range and images and tracks agree about each other.
Status Validate(const Model& model);

enum class ModelFormat : std::uint8_t {
  kColmapBinary,            // cameras.bin images.bin points3D.bin
  kColmapText,              // .txt
  kColmapUnderwater,        // .txt, with colmap_underwater's port columns in cameras.txt
  kColmapUnderwaterBinary,  // .bin, with the port behind each camera in cameras.bin
};

// A model folder: COLMAP's three files (.bin preferred where both exist), rig.yaml with the port,
// body and world where there is one, times.csv (image,utime) where times are known. A model without
// rig.yaml has no port, unless its cameras carry colmap_underwater's columns.
IoExpected<Model> ReadModel(const std::filesystem::path& folder);

// Writes the files into an existing folder, as they come: give AtomicFolder::aside(). All cameras
// must have the same port, as rig.yaml holds one.
IoStatus WriteModelFiles(const Model& model, const std::filesystem::path& folder,
                         ModelFormat format = ModelFormat::kColmapBinary);
// The whole folder at once, atomically; an earlier model in its place is replaced.
IoStatus WriteModel(const Model& model, const std::filesystem::path& folder,
                    ModelFormat format = ModelFormat::kColmapBinary);

}  // namespace rsfm
