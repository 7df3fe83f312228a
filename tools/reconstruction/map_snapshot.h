// A map without what the images' files hold: to be kept, written down and put back.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "rsfm/io/binary.h"
#include "tools/offline/scene.h"

namespace rsfm {

struct MapSnapshot {
  CameraConfig camera;
  std::vector<std::pair<int, Rigid3>> poses;  // placed images: index, camera_from_world
  std::vector<ScenePoint> points;             // those that are there
};

MapSnapshot TakeSnapshot(const Scene& scene);
// In place of what the scene has; its images' features are as they were when it was taken.
void PutBack(const MapSnapshot& snapshot, Scene* scene);

void AppendSnapshot(const MapSnapshot& snapshot, std::string* bytes);
// `scene` bounds the indices and gives what of the camera is not an unknown. False, and the
// snapshot is then worthless, for bytes that are none of it.
bool ReadSnapshot(BinaryReader* reader, const Scene& scene, MapSnapshot* snapshot);

}  // namespace rsfm
