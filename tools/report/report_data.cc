#include "tools/report/report_data.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "rsfm/base/so3.h"
#include "rsfm/io/atomic_output.h"
#include "rsfm/io/mission.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxReportBytes = std::size_t{1} << 26;

struct Input {
  Model model;
  std::vector<ReportTrack> tracks;
  bool is_mission = false;
};

ReportTrack OnBoardTrack(const Mission& mission) {
  ReportTrack track;
  track.name = "on-board";
  track.poses = TrajectoryOf(mission);
  return track;
}

IoExpected<Input> ReadInput(const ReportRequest& request) {
  Input input;
  input.is_mission = IsMissionFolder(request.input);
  const fs::path mission_path = input.is_mission ? request.input : request.mission;
  if (!mission_path.empty()) {
    const auto mission = ReadMission(mission_path, {.keep_descriptors = false});
    if (!mission) return Fail(mission.error());
    input.tracks.push_back(OnBoardTrack(*mission));
    if (input.is_mission) input.model = ModelFromMission(*mission);
  }
  if (!input.is_mission) {
    auto model = ReadModel(request.input);
    if (!model) return Fail(model.error());
    input.model = std::move(*model);
    ReportTrack track;
    track.name = fs::exists(request.input / "report.json") ? "refined" : "model";
    track.poses = TrajectoryOf(input.model);
    input.tracks.push_back(track);
  }
  std::erase_if(input.tracks, [](const ReportTrack& track) { return track.poses.empty(); });
  return input;
}

double Median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The distance in the image from each observed feature to its point's exact projection.
void MeasureResiduals(const Model& model, ReportData* data) {
  std::vector<std::optional<AnyCamera>> cameras;
  for (const ModelCamera& camera : model.cameras) {
    const auto made = AnyCamera::Create(camera.config);
    cameras.push_back(made ? std::optional<AnyCamera>(*made) : std::nullopt);
  }
  for (const ModelImage& image : model.images) {
    std::vector<double> of_image;
    const auto& camera = cameras[image.camera];
    for (std::size_t f = 0; camera && f < image.features.size(); ++f) {
      if (image.points[f] == kNoPoint) continue;
      ++data->num_observations;
      Vec2 pixel;
      const Vec3 point = image.camera_from_world * model.points[image.points[f]].xyz;
      if (camera->Project(point, &pixel) != Projection::kOk) continue;
      of_image.push_back((pixel - image.features[f]).norm());
    }
    data->residuals_px.insert(data->residuals_px.end(), of_image.begin(), of_image.end());
    data->image_residual_px.push_back(Median(of_image));
  }
}

void Transform(const Similarity& to_from, ReportTrack* track) {
  for (TrajectoryPose& pose : track->poses) {
    pose.world_from_camera = {to_from.transform.rotation * pose.world_from_camera.rotation,
                              to_from * pose.world_from_camera.translation};
  }
}

void CompareWithTruth(const GroundTruth& truth, ReportTrack* track) {
  const TruthIndex index(truth);
  for (std::size_t i = 0; i < track->poses.size(); ++i) {
    const Rigid3& estimate = track->poses[i].world_from_camera;
    const TrajectoryPose* true_pose = index.Find(track->poses[i]);
    if (true_pose == nullptr) continue;
    track->image_number.push_back(static_cast<double>(i));
    const Rigid3& reference = true_pose->world_from_camera;
    track->position_error_mm.push_back(1e3 * (estimate.translation - reference.translation).norm());
    if (!truth.has_rotations) continue;
    track->rotation_error_deg.push_back(AngleBetween(estimate.rotation, reference.rotation) *
                                        180.0 / std::numbers::pi);
  }
}

IoStatus UseTruth(const fs::path& path, const Model& model, ReportData* data,
                  Similarity* points_to_truth) {
  auto truth = ReadGroundTruth(path);
  if (!truth) return Fail(truth.error());
  for (ReportTrack& track : data->tracks) {
    // The points belong to the last track; the others are compared by their poses alone.
    const bool has_points = &track == &data->tracks.back();
    const auto evaluation =
        Evaluate(has_points ? model : Model{}, track.poses, *truth, data->alignment);
    if (!evaluation) return Fail(evaluation.error());
    track.evaluation = *evaluation;
    Transform(evaluation->truth_from_estimate, &track);
    if (has_points) *points_to_truth = evaluation->truth_from_estimate;
    CompareWithTruth(*truth, &track);
  }
  data->truth = std::move(truth->poses);
  return {};
}

IoStatus ReadRefinement(const fs::path& path, ReportData* data) {
  if (!fs::exists(path)) return {};
  const auto text = ReadWholeFile(path, kMaxReportBytes);
  if (!text) return Fail(text.error());
  data->refinement = nlohmann::ordered_json::parse(*text, nullptr, false);
  if (!data->refinement.is_discarded()) return {};
  return Fail(
      {Errc::kCorrupt, path.string(), "", "is not JSON", "run refine again, or remove the file"});
}

fs::path FindTruth(const ReportRequest& request, bool is_mission) {
  if (!request.ground_truth.empty()) return request.ground_truth;
  const fs::path mission = is_mission ? request.input : request.mission;
  if (!mission.empty() && fs::exists(mission / kGroundTruthFolder)) {
    return mission / kGroundTruthFolder;
  }
  return {};
}

}  // namespace

IoExpected<ReportData> ReadReportData(const ReportRequest& request) {
  auto input = ReadInput(request);
  if (!input) return Fail(input.error());
  const Model& model = input->model;
  ReportData data;
  data.source = request.input.string();
  data.title = fs::absolute(request.input).lexically_normal().filename().string();
  if (data.title.empty()) data.title = "report";
  data.is_mission = input->is_mission;
  data.rig = model.rig;
  data.num_images = model.images.size();
  data.tracks = std::move(input->tracks);
  data.is_ned = model.rig.world.frame == WorldFrame::kNed;
  data.alignment = request.alignment.value_or(model.rig.world.scale_is_metric ? Alignment::kSe3
                                                                              : Alignment::kSim3);
  MeasureResiduals(model, &data);
  if (!data.is_mission) {
    if (auto status = ReadRefinement(request.input / "report.json", &data); !status) {
      return Fail(status.error());
    }
  }
  Similarity points_to_truth;
  const fs::path truth = FindTruth(request, data.is_mission);
  if (!truth.empty()) {
    if (auto status = UseTruth(truth, model, &data, &points_to_truth); !status) {
      return Fail(status.error());
    }
    // A simulated mission's ground truth is NED, whatever frame the reconstruction has.
    if (!data.is_ned && fs::exists(truth / kRigFile)) {
      const auto rig = ReadRig(truth / kRigFile);
      data.is_ned = rig && rig->world.frame == WorldFrame::kNed;
    }
  }
  if (data.tracks.empty() && data.truth.empty()) {
    return Fail({Errc::kInvalidArgument, data.source, "", "holds no pose to report on",
                 "give a model, or a mission whose mapper has run"});
  }
  for (const ModelPoint& point : model.points) {
    data.points.push_back(points_to_truth * point.xyz);
    data.colours.push_back(point.rgb);
    data.has_colours |= point.rgb != std::array<std::uint8_t, 3>{128, 128, 128};
  }
  return data;
}

}  // namespace rsfm
