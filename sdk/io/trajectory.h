// Trajectories and what other programs show of them: TUM, KML, GeoJSON, and PLY for points.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "rsfm/base/rigid3.h"
#include "rsfm/base/time.h"
#include "rsfm/io/diagnostic.h"
#include "rsfm/io/mission.h"
#include "rsfm/io/model.h"

namespace rsfm {

struct TrajectoryPose {
  Utime utime = 0;    // 0: not known
  std::string image;  // empty: not known
  Rigid3 world_from_camera;
};

// Sorted by time where times are known, else in the model's order.
std::vector<TrajectoryPose> TrajectoryOf(const Model& model);
// The on-board trajectory: every tracked pose of the log, the last one of each time, turned into
// the camera's; images by their times in images.csv.
std::vector<TrajectoryPose> TrajectoryOf(const Mission& mission);

// `timestamp tx ty tz qx qy qz qw`, seconds with six decimals, world_from_camera. Without times the
// image's number takes their place.
std::string FormatTum(const std::vector<TrajectoryPose>& poses);
IoExpected<std::vector<TrajectoryPose>> ReadTum(const std::filesystem::path& path);

// The camera's path on earth. kInvalidArgument unless the world is NED with a known origin.
IoExpected<std::string> FormatKml(const std::vector<TrajectoryPose>& poses, const World& world,
                                  const std::string& name);
IoExpected<std::string> FormatGeoJson(const std::vector<TrajectoryPose>& poses, const World& world,
                                      const std::string& name);

// Binary PLY: the model's points with colours; the cameras' centres as red vertices behind them.
std::string FormatPly(const Model& model, const std::vector<TrajectoryPose>& cameras);

}  // namespace rsfm
