// Everything a report shows, gathered from a model or mission, and its ground truth.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "rsfm/io/model.h"
#include "rsfm/io/trajectory.h"
#include "tools/evaluation/evaluate.h"

namespace rsfm {

struct ReportRequest {
  std::filesystem::path input;         // model or mission
  std::filesystem::path mission;       // of a model: where its on-board trajectory is; may be empty
  std::filesystem::path ground_truth;  // empty: that of the mission, if it has one
  std::optional<Alignment> alignment;  // to the ground truth; absent: see ReadReportData
};

struct ReportTrack {
  std::string name;                   // "on-board", "refined"
  std::vector<TrajectoryPose> poses;  // in the ground truth's frame where there is one
  std::optional<Evaluation> evaluation;
  // Per image that has a ground truth, in order of time.
  std::vector<double> image_number;
  std::vector<double> position_error_mm;
  std::vector<double> rotation_error_deg;
};

struct ReportData {
  std::string title;
  std::string source;
  bool is_mission = false;
  Rig rig;
  Alignment alignment = Alignment::kNone;
  bool is_ned = false;  // tracks and points are north, east, down
  std::vector<ReportTrack> tracks;
  std::vector<TrajectoryPose> truth;

  std::vector<Vec3> points;  // in the tracks' frame
  std::vector<std::array<std::uint8_t, 3>> colours;
  bool has_colours = false;

  std::size_t num_images = 0;
  std::size_t num_observations = 0;
  std::vector<double> residuals_px;       // of every observation
  std::vector<double> image_residual_px;  // median of each image, NaN where it has none
  nlohmann::ordered_json refinement;      // the model's report.json; null: there is none
};

// Where no alignment is asked for: rotation and translation when the reconstruction is metric, as
// its origin is seldom the ground truth's; a similarity otherwise.
IoExpected<ReportData> ReadReportData(const ReportRequest& request);

}  // namespace rsfm
