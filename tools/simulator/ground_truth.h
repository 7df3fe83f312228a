// What a simulated mission really was, in files that evaluation reads.
#pragma once

#include <filesystem>

#include "rsfm/io/model.h"
#include "tools/simulator/scene.h"

namespace rsfm {

// The scene's meshes as one binary PLY, in world coordinates (single precision).
IoStatus WriteMeshPly(const Scene& scene, const std::filesystem::path& path);

// One line per image: seconds, position, quaternion x y z w of world_from_camera.
IoStatus WriteTrajectoryTum(const std::vector<ModelImage>& images,
                            const std::filesystem::path& path);

// Portable float map, one channel, little-endian, bottom row first.
IoStatus WritePfm(int width, int height, const std::vector<float>& values,
                  const std::filesystem::path& path);

}  // namespace rsfm
