#include "tools/evaluation/evaluate.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "rsfm/base/so3.h"
#include "rsfm/refraction/any_camera.h"
#include "tools/evaluation/mesh.h"

namespace rsfm {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;

struct Pairs {
  std::vector<Rigid3> estimate, truth;  // world_from_camera
  int num_unmatched = 0;
};

Pairs Match(const std::vector<TrajectoryPose>& estimate, const GroundTruth& truth) {
  const TruthIndex index(truth);
  Pairs pairs;
  for (const TrajectoryPose& pose : estimate) {
    const TrajectoryPose* match = index.Find(pose);
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

// Against the mesh, where there is one.
IoStatus SetPointErrors(const std::vector<Vec3>& points, const std::filesystem::path& mesh_file,
                        std::vector<Vec3>* nearest, Evaluation* result) {
  if (mesh_file.empty() || points.empty()) return {};
  const auto mesh = TriangleMesh::ReadPly(mesh_file);
  if (!mesh) return Fail(mesh.error());
  std::vector<double> errors;
  double sum = 0.0;
  for (const Vec3& point : points) {
    nearest->push_back(mesh->Closest(point));
    errors.push_back(1e3 * (nearest->back() - point).norm());
    sum += errors.back();
  }
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  result->point_error_mm = sum / static_cast<double>(errors.size());
  result->point_error_median_mm = *middle;
  return {};
}

// Of the points' heights, over the mesh where `nearest` has its places. Points far off it are wrong
// matches, not a bend.
std::optional<Bend> BendOf(std::vector<Vec3> points, const std::vector<Vec3>& nearest,
                           const Pairs& pairs, const Evaluation& result) {
  constexpr double kOneWay = 0.8, kFarOff = 10.0;
  Vec3 up = Vec3::Zero();
  for (const Rigid3& pose : pairs.estimate)
    up -= result.truth_from_estimate.transform.rotation * (pose.rotation * Vec3::UnitZ());
  if (up.norm() < kOneWay * static_cast<double>(pairs.estimate.size())) return std::nullopt;
  up.normalize();
  if (!nearest.empty()) {
    const double limit_m = kFarOff * 1e-3 * *result.point_error_median_mm;
    std::vector<Vec3> over_mesh;
    for (std::size_t i = 0; i < points.size(); ++i)
      if ((points[i] - nearest[i]).norm() <= limit_m)
        over_mesh.push_back(points[i] - up.dot(nearest[i]) * up);
    points = std::move(over_mesh);
  } else {
    points = WithoutFarOff(points, up);
  }
  const auto bend = FitBend(points, up);
  return bend ? std::optional(*bend) : std::nullopt;
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
    if (i > 0)
      result.distance_m += (pairs.truth[i].translation - pairs.truth[i - 1].translation).norm();
    rotation_sum +=
        kDegrees * AngleBetween(aligned->transform.rotation * pairs.estimate[i].rotation,
                                pairs.truth[i].rotation);
  }
  result.position_rmse_mm = std::sqrt(squares / n);
  if (truth.has_rotations) result.rotation_error_deg = rotation_sum / n;
  result.reprojection_error_px = MeanReprojectionError(model);
  std::vector<Vec3> points, nearest;
  for (const ModelPoint& point : model.points) points.push_back(*aligned * point.xyz);
  if (auto status = SetPointErrors(points, truth.mesh, &nearest, &result); !status) {
    return Fail(status.error());
  }
  if (truth.has_rotations) result.bend = BendOf(std::move(points), nearest, pairs, result);
  return result;
}

std::optional<Evaluation> EvaluateDeadReckoning(const ImageNavigation& at_images,
                                                const std::vector<TrajectoryPose>& estimate,
                                                const GroundTruth& truth, Alignment alignment) {
  if (alignment == Alignment::kNone) return std::nullopt;
  const std::vector<Rigid3> reckoned = at_images.DeadReckoned();
  if (reckoned.size() != estimate.size()) return std::nullopt;
  std::vector<TrajectoryPose> alone = estimate;
  for (std::size_t i = 0; i < alone.size(); ++i) alone[i].world_from_camera = reckoned[i];
  auto evaluation = Evaluate(Model(), alone, truth, alignment);
  return evaluation ? std::optional(std::move(*evaluation)) : std::nullopt;
}

}  // namespace rsfm
