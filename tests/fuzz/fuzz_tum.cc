// Trajectories as TUM text: finite, of unit rotations, and what is written of them reads back.
#include <cmath>

#include "rsfm/io/trajectory.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace rsfm;
  const std::filesystem::path path = FuzzFolder() / "trajectory.tum";
  WriteFuzzFile(path, AsText(data, size));
  const auto poses = ReadTum(path);
  if (!poses) return 0;
  bool has_times = false;
  for (const TrajectoryPose& pose : *poses) {
    Require(pose.world_from_camera.translation.allFinite());
    Require(std::abs(pose.world_from_camera.rotation.norm() - 1.0) < 1e-9);
    has_times |= pose.utime != 0;
  }
  WriteFuzzFile(path, FormatTum(*poses));
  const auto back = ReadTum(path);
  Require(back && back->size() == poses->size());
  for (std::size_t i = 0; i < poses->size(); ++i) {
    const TrajectoryPose &a = (*poses)[i], &b = (*back)[i];
    Require(a.world_from_camera.translation == b.world_from_camera.translation);
    // Seconds are read as double: to the microsecond for 285 years.
    const auto utime = static_cast<double>(a.utime);
    Require(!has_times ||
            std::abs(utime - static_cast<double>(b.utime)) <= 1e-15 * std::abs(utime));
  }
  return 0;
}
