// A path that some vehicle really took.
#pragma once

#include <filesystem>
#include <memory>

#include "rsfm/io/diagnostic.h"
#include "tools/simulator/trajectory.h"

namespace rsfm::simulator {

struct RecordedOptions {
  // NAV.csv (by its name's ending) with positions north, east, down and attitudes of the body; or
  // TUM: world_from_camera, or world_from_body where `poses_are_body`.
  std::filesystem::path file;
  bool poses_are_body = false;
  double start_s = 0.0;     // what is used of it, from its first pose on
  double duration_s = 0.0;  // 0: to its end
  double smooth_s =
      -1.0;            // averaged over this long; 0: as recorded; below 0: 1 s for NAV.csv, else 0
  bool center = true;  // moved north and east so that its middle is at the world's origin
  double altitude_m = 0.0;  // moved down or up to this mean height above the floor; 0: as recorded
};

// Smooth through the recorded poses (cubic in position, normalised cubic in the quaternion). Errors
// name file and fix. `mean_altitude_m` gets the mean height above the floor.
IoExpected<std::unique_ptr<Trajectory>> LoadRecorded(const RecordedOptions& options,
                                                     const Rigid3& body_from_camera,
                                                     double floor_depth_m, double* mean_altitude_m);

}  // namespace rsfm::simulator
