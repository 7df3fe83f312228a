// What a reconstruction is compared with.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <unordered_map>
#include <vector>

#include "rsfm/io/diagnostic.h"
#include "rsfm/io/trajectory.h"

namespace rsfm {

struct GroundTruth {
  std::vector<TrajectoryPose> poses;
  bool has_rotations = true;
  std::filesystem::path mesh;  // empty: none
};

// The truth's pose of the same image: by name, by the last part of it where the folders differ, or
// by time to within a millisecond where one side has no names. The truth must outlive this.
class TruthIndex {
 public:
  explicit TruthIndex(const GroundTruth& truth);
  const TrajectoryPose* Find(const TrajectoryPose& estimate) const;  // null: none

 private:
  std::unordered_map<std::string, const TrajectoryPose*> by_name_, by_last_part_;
  std::map<Utime, const TrajectoryPose*> by_time_;
};

// Reads, by what it finds at `path`: a model folder; a mission's ground_truth folder, or the
// mission that has one; a TUM file (by time); a CSV with `image` and any of x, y, z, each with the
// unit as suffix (x_m, x_cm, x_mm; an axis that is not there is 0): positions without rotations.
IoExpected<GroundTruth> ReadGroundTruth(const std::filesystem::path& path);

}  // namespace rsfm
