// What a simulated mission really was, in files that evaluation reads.
#pragma once

#include <filesystem>
#include <vector>

#include "rsfm/io/diagnostic.h"
#include "tools/simulator/scene.h"

namespace rsfm::simulator {

// The scene's meshes as one binary PLY, in world coordinates (single precision).
IoStatus WriteMeshPly(const Scene& scene, const std::filesystem::path& path);

// Portable float map, one channel, little-endian, bottom row first.
IoStatus WritePfm(int width, int height, const std::vector<float>& values,
                  const std::filesystem::path& path);

}  // namespace rsfm::simulator
