#include "tools/evaluation/ground_truth.h"

#include <cmath>
#include <set>

#include "rsfm/io/csv.h"
#include "rsfm/io/mission.h"
#include "rsfm/io/model.h"
#include "rsfm/io/text.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

struct AxisColumn {
  std::size_t field = 0;
  int axis = 0;
  double metres = 1.0;
};

IoExpected<GroundTruth> ReadPositionsCsv(const fs::path& path) {
  const auto csv = ReadCsv(path);
  if (!csv) return Fail(csv.error());
  std::vector<AxisColumn> axes;
  std::size_t image_field = csv->columns.size();
  for (std::size_t i = 0; i < csv->columns.size(); ++i) {
    const std::string& name = csv->columns[i];
    const std::size_t axis = name.size() > 2 ? std::string_view("xyz").find(name[0]) : 3;
    const std::string_view unit = name.size() > 2 ? std::string_view(name).substr(1) : "";
    const double metres = unit == "_m" ? 1.0 : unit == "_cm" ? 1e-2 : unit == "_mm" ? 1e-3 : 0.0;
    if (name == "image") {
      image_field = i;
    } else if (axis < 3 && metres > 0.0) {
      axes.push_back({i, static_cast<int>(axis), metres});
    } else {
      return Fail({Errc::kInvalidArgument, path.string(), "column " + Quoted(name), "is not known",
                   "give image and x_m, y_m, z_m (or _cm, _mm)", csv->header_line});
    }
  }
  if (image_field == csv->columns.size() || axes.empty()) {
    return Fail({Errc::kInvalidArgument, path.string(), "header", "has no image or no axis",
                 "give image and x_m, y_m, z_m (or _cm, _mm)", csv->header_line});
  }
  GroundTruth truth;
  truth.has_rotations = false;
  for (const CsvRow& row : csv->rows) {
    TrajectoryPose pose;
    pose.image = row.fields[image_field];
    for (const AxisColumn& column : axes) {
      const auto value = ParseNumber(row.fields[column.field]);
      if (!value || !std::isfinite(*value)) {
        return Fail({Errc::kInvalidArgument, path.string(), "column " + csv->columns[column.field],
                     Quoted(row.fields[column.field]) + " is not a finite number", "give a number",
                     row.line});
      }
      pose.world_from_camera.translation[column.axis] = *value * column.metres;
    }
    truth.poses.push_back(std::move(pose));
  }
  return truth;
}

IoExpected<GroundTruth> ReadTumTruth(const fs::path& path) {
  auto poses = ReadTum(path);
  if (!poses) return Fail(poses.error());
  GroundTruth truth;
  truth.poses = std::move(*poses);
  return truth;
}

std::string LastPart(const std::string& name) { return fs::path(name).filename().string(); }

}  // namespace

TruthIndex::TruthIndex(const GroundTruth& truth) {
  for (const TrajectoryPose& pose : truth.poses) {
    if (pose.utime != 0 || pose.image.empty()) by_time_[pose.utime] = &pose;
    if (pose.image.empty()) continue;
    by_name_[pose.image] = &pose;
    by_last_part_[LastPart(pose.image)] = &pose;
  }
}

const TrajectoryPose* TruthIndex::Find(const TrajectoryPose& estimate) const {
  for (const auto& [index, key] :
       {std::pair{&by_name_, estimate.image}, {&by_last_part_, LastPart(estimate.image)}}) {
    const auto found = index->find(key);
    if (!key.empty() && found != index->end()) return found->second;
  }
  constexpr Utime kToleranceUs = 1000;
  if (estimate.utime == 0) return nullptr;
  const auto next = by_time_.lower_bound(estimate.utime - kToleranceUs);
  return next != by_time_.end() && next->first <= estimate.utime + kToleranceUs ? next->second
                                                                                : nullptr;
}

IoExpected<GroundTruth> ReadGroundTruth(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error)) return Fail(FromErrno(ENOENT, path.string(), "open"));
  if (!fs::is_directory(path, error)) {
    return path.extension() == ".csv" ? ReadPositionsCsv(path) : ReadTumTruth(path);
  }
  const bool is_model =
      fs::exists(path / "cameras.bin", error) || fs::exists(path / "cameras.txt", error);
  if (!is_model && fs::is_directory(path / kGroundTruthFolder, error)) {
    return ReadGroundTruth(path / kGroundTruthFolder);
  }
  if (!is_model && !fs::exists(path / "trajectory.tum", error)) {
    return Fail({Errc::kNotFound, path.string(), "",
                 "is no ground truth: it holds neither a model nor trajectory.tum",
                 "give a model folder, a ground_truth folder, a TUM file or a CSV"});
  }
  GroundTruth truth;
  if (is_model) {
    const auto model = ReadModel(path);
    if (!model) return Fail(model.error());
    truth.poses = TrajectoryOf(*model);
  } else {
    auto read = ReadTumTruth(path / "trajectory.tum");
    if (!read) return Fail(read.error());
    truth = std::move(*read);
  }
  if (fs::exists(path / "mesh.ply", error)) truth.mesh = path / "mesh.ply";
  return truth;
}

}  // namespace rsfm
