#include "tools/evaluation/consistency.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <map>

#include "rsfm/base/so3.h"

namespace rsfm {
namespace {

constexpr double kChiSquare95 = 12.592;  // six degrees of freedom

struct Error {
  Vec6 error = Vec6::Zero();
  Mat6 covariance = Mat6::Zero();
};

Rigid3 WorldFromBody(const pose_t& pose) {
  const double* q = pose.frame_from_body_q;
  return {Quat(q[0], q[1], q[2], q[3]),
          Vec3(pose.position_m[0], pose.position_m[1], pose.position_m[2])};
}

// Of a pose that says how good it is.
std::optional<Error> ErrorOf(const pose_t& pose, const Rigid3& truth) {
  const Rigid3 found = WorldFromBody(pose);
  Error e;
  e.covariance = Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(pose.covariance);
  if (!(e.covariance(0, 0) > 0.0) || !e.covariance.allFinite()) return std::nullopt;
  if (!found.translation.allFinite() || !(std::abs(found.rotation.norm() - 1.0) < 1e-6))
    return std::nullopt;
  e.error << found.translation - truth.translation,
      LogSo3(found.rotation * truth.rotation.conjugate());
  return e;
}

std::array<double, 4> NeesOfParts(const Error& e) {
  const auto of_pair = [&](int i) {
    return e.error.segment<2>(i).dot(e.covariance.block<2, 2>(i, i).inverse() *
                                     e.error.segment<2>(i));
  };
  const auto of_one = [&](int i) { return e.error[i] * e.error[i] / e.covariance(i, i); };
  return {of_pair(0), of_one(2), of_pair(3), of_one(5)};
}

}  // namespace

std::optional<Consistency> EvaluateConsistency(const Mission& mission, const GroundTruth& truth) {
  const TruthIndex index(truth);
  std::map<Utime, const pose_t*> poses;
  for (const pose_t& pose : mission.poses) poses[pose.utime] = &pose;
  std::map<Utime, std::string> names;
  for (const ImageTime& image : mission.images) names[image.utime] = image.image;

  Consistency result;
  std::optional<Vec3> origin;  // of the world the poses are in, in the truth's
  const pose_t* before = nullptr;
  for (const auto& [utime, pose] : poses) {
    if (result.spells.empty() || result.spells.back().state != pose->state) {
      if (!result.spells.empty()) result.spells.back().end = utime;
      result.spells.push_back({.state = pose->state, .begin = utime});
    }
    Consistency::Spell& spell = result.spells.back();
    spell.end = utime;
    ++spell.num_frames;
    spell.num_jumps += before != nullptr ? pose->reset_counter - before->reset_counter : 0;
    before = pose;
    const TrajectoryPose* match = index.Find({utime, names[utime], Rigid3()});
    if (match == nullptr || pose->frame_id != "ned") continue;
    auto e = ErrorOf(*pose, match->world_from_camera * mission.rig.body_from_camera.Inverse());
    if (!e) continue;
    if (!origin) origin = Vec3(e->error[0], e->error[1], 0.0);
    e->error.head<3>() -= *origin;
    const double nees = e->error.dot(e->covariance.ldlt().solve(e->error));
    spell.position_error_max_m = std::max(spell.position_error_max_m, e->error.head<3>().norm());
    spell.nees += nees;
    ++spell.num_judged;
    ++result.num_judged;
    result.nees += nees;
    const auto parts = NeesOfParts(*e);
    for (std::size_t i = 0; i < parts.size(); ++i) result.nees_of_parts[i] += parts[i];
    result.within_95 += nees <= kChiSquare95 ? 1.0 : 0.0;
  }
  if (result.num_judged == 0) return std::nullopt;
  result.nees /= result.num_judged;
  for (double& part : result.nees_of_parts) part /= result.num_judged;
  result.within_95 /= result.num_judged;
  for (Consistency::Spell& spell : result.spells)
    if (spell.num_judged > 0) spell.nees /= spell.num_judged;
  return result;
}

}  // namespace rsfm
