#include "tools/evaluation/evaluate.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <unordered_map>

#include "rsfm/base/so3.h"
#include "rsfm/refraction/any_camera.h"
#include "tools/evaluation/mesh.h"

namespace rsfm {
namespace {

constexpr Utime kMatchToleranceUs = 1000;
constexpr double kDegrees = 180.0 / std::numbers::pi;

std::string LastPart(const std::string& name) {
  return std::filesystem::path(name).filename().string();
}

struct Pairs {
  std::vector<Rigid3> estimate, truth;  // world_from_camera
  int num_unmatched = 0;
};

class TruthFinder {
 public:
  explicit TruthFinder(const GroundTruth& truth) {
    for (const TrajectoryPose& pose : truth.poses) {
      if (pose.image.empty()) {
        by_time_[pose.utime] = &pose;
      } else {
        by_name_[pose.image] = &pose;
        by_last_part_[LastPart(pose.image)] = &pose;
      }
    }
  }

  const TrajectoryPose* Find(const TrajectoryPose& estimate) const {
    for (const auto& [index, key] :
         {std::pair{&by_name_, estimate.image}, {&by_last_part_, LastPart(estimate.image)}}) {
      const auto found = index->find(key);
      if (found != index->end()) return found->second;
    }
    if (estimate.utime == 0) return nullptr;
    const auto next = by_time_.lower_bound(estimate.utime - kMatchToleranceUs);
    if (next == by_time_.end() || next->first > estimate.utime + kMatchToleranceUs) return nullptr;
    return next->second;
  }

 private:
  std::unordered_map<std::string, const TrajectoryPose*> by_name_, by_last_part_;
  std::map<Utime, const TrajectoryPose*> by_time_;
};

Pairs Match(const std::vector<TrajectoryPose>& estimate, const GroundTruth& truth) {
  const TruthFinder finder(truth);
  Pairs pairs;
  for (const TrajectoryPose& pose : estimate) {
    const TrajectoryPose* match = finder.Find(pose);
    if (match == nullptr) {
      ++pairs.num_unmatched;
      continue;
    }
    pairs.estimate.push_back(pose.world_from_camera);
    pairs.truth.push_back(match->world_from_camera);
  }
  return pairs;
}

Expected<Similarity> Align(const Pairs& pairs, bool has_rotations, Alignment alignment) {
  if (has_rotations) return AlignPoses(pairs.estimate, pairs.truth, alignment);
  std::vector<Vec3> from, to;
  for (const Rigid3& pose : pairs.estimate) from.push_back(pose.translation);
  for (const Rigid3& pose : pairs.truth) to.push_back(pose.translation);
  return AlignPoints(from, to, alignment);
}

IoStatus SetPointErrors(const Model& model, const std::filesystem::path& mesh_file,
                        Evaluation* result) {
  if (mesh_file.empty() || model.points.empty()) return {};
  const auto mesh = TriangleMesh::ReadPly(mesh_file);
  if (!mesh) return Fail(mesh.error());
  std::vector<double> errors;
  double sum = 0.0;
  for (const ModelPoint& point : model.points) {
    errors.push_back(1e3 * mesh->Distance(result->truth_from_estimate * point.xyz));
    sum += errors.back();
  }
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  result->point_error_mm = sum / static_cast<double>(errors.size());
  result->point_error_median_mm = *middle;
  return {};
}

}  // namespace

std::optional<double> MeanReprojectionError(const Model& model) {
  std::vector<std::optional<AnyCamera>> cameras;
  for (const ModelCamera& camera : model.cameras) {
    const auto created = AnyCamera::Create(camera.config);
    cameras.push_back(created ? std::optional<AnyCamera>(*created) : std::nullopt);
  }
  double sum = 0.0;
  std::int64_t count = 0;
  for (const ModelImage& image : model.images) {
    const auto& camera = cameras[static_cast<std::size_t>(image.camera)];
    for (std::size_t f = 0; camera && f < image.points.size(); ++f) {
      if (image.points[f] == kNoPoint) continue;
      const Vec3& xyz = model.points[static_cast<std::size_t>(image.points[f])].xyz;
      Vec2 pixel;
      if (camera->Project(image.camera_from_world * xyz, &pixel) != Projection::kOk) continue;
      sum += (pixel - image.features[f]).norm();
      ++count;
    }
  }
  return count > 0 ? std::optional(sum / static_cast<double>(count)) : std::nullopt;
}

IoExpected<Evaluation> Evaluate(const Model& model, const std::vector<TrajectoryPose>& estimate,
                                const GroundTruth& truth, Alignment alignment) {
  const Pairs pairs = Match(estimate, truth);
  if (pairs.estimate.empty()) {
    return Fail({Errc::kInvalidArgument, "", "images",
                 "none of the reconstruction's is in the ground truth, by name or by time",
                 "give the ground truth of these images"});
  }
  const auto aligned = Align(pairs, truth.has_rotations, alignment);
  if (!aligned) {
    return Fail({aligned.error().code, "", aligned.error().where,
                 std::to_string(pairs.estimate.size()) +
                     " of them do not determine an alignment: " + ToString(aligned.error().code),
                 "use --align none, or a longer trajectory that is not straight"});
  }
  Evaluation result;
  result.num_images = static_cast<int>(pairs.estimate.size());
  result.num_unmatched = pairs.num_unmatched;
  result.truth_from_estimate = *aligned;
  double rotation_sum = 0.0, squares = 0.0;
  const auto n = static_cast<double>(pairs.estimate.size());
  for (std::size_t i = 0; i < pairs.estimate.size(); ++i) {
    const double error =
        1e3 * (*aligned * pairs.estimate[i].translation - pairs.truth[i].translation).norm();
    result.position_error_mm += error / n;
    result.position_max_mm = std::max(result.position_max_mm, error);
    squares += error * error;
    rotation_sum +=
        kDegrees * AngleBetween(aligned->transform.rotation * pairs.estimate[i].rotation,
                                pairs.truth[i].rotation);
  }
  result.position_rmse_mm = std::sqrt(squares / n);
  if (truth.has_rotations) result.rotation_error_deg = rotation_sum / n;
  result.reprojection_error_px = MeanReprojectionError(model);
  if (auto status = SetPointErrors(model, truth.mesh, &result); !status) {
    return Fail(status.error());
  }
  return result;
}

}  // namespace rsfm
