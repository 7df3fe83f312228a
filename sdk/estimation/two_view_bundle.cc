#include "rsfm/estimation/two_view_bundle.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "rsfm/estimation/reprojection_residual.h"

namespace rsfm {
namespace {

using Mat43 = Eigen::Matrix<double, 4, 3>;
using Mat46 = Eigen::Matrix<double, 4, 6>;

// The unit vector orthogonal to the three columns: the cofactors of a fourth one.
Vec4 LeftNullVector(const Mat43& m) {
  Vec4 result;
  for (int skipped = 0; skipped < 4; ++skipped) {
    const Vec3 first = m.row(skipped == 0 ? 1 : 0).transpose();
    const Vec3 second = m.row(skipped <= 1 ? 2 : 1).transpose();
    const Vec3 third = m.row(skipped <= 2 ? 3 : 2).transpose();
    const double minor = first.dot(second.cross(third));
    result[skipped] = skipped % 2 == 0 ? minor : -minor;
  }
  return result.normalized();
}

class Bundle {
 public:
  Bundle(const TwoViewImages& images, std::span<const RayPair> pairs, std::span<const int> active,
         const EpipolarRefineOptions& options, std::span<BundlePair> memory)
      : images_(images), pairs_(pairs), active_(active), options_(options), memory_(memory) {}

  // Points where the rays come nearest to each other.
  void Start(const RelativePose& pose) {
    const Rigid3 a_from_b = pose.ToRigid().Inverse();
    for (std::size_t k = 0; k < active_.size(); ++k) {
      const RayPair& pair = pairs_[active_[k]];
      double range_a = 0.0, range_b = 0.0, angle = 0.0;
      memory_[k].has_point = MeetingRanges(pose, pair, &range_a, &range_b, &angle) &&
                             range_a > 0.0 && range_b > 0.0 &&
                             angle > ParallaxNoise(pair, options_.sigma_px);
      if (!memory_[k].has_point) continue;
      const Vec3 point = 0.5 * (pair.a.ray.At(range_a) + a_from_b * pair.b.ray.At(range_b));
      memory_[k].states[0].point_in_a = point;
      Vec2 pixel;
      memory_[k].has_point =
          images_.camera_a->Project(point, &pixel) == Projection::kOk &&
          images_.camera_b->Project(pose.ToRigid() * point, &pixel) == Projection::kOk;
    }
  }

  EpipolarNormal Linearise(const RelativePose& pose, int slot) {
    EpipolarNormal normal;
    const Eigen::Matrix<double, 3, 2> basis = TangentBasis(pose.direction);
    for (std::size_t k = 0; k < active_.size(); ++k) {
      const RayPair& pair = pairs_[active_[k]];
      if (memory_[k].has_point) {
        AddPoint(pose, basis, pair, &memory_[k].states[slot], &normal);
      } else {
        AddEpipolar(pose, basis, pair, options_, &normal);
      }
    }
    normal.cost += AddBaselinePriors(pose, options_, &normal);
    return normal;
  }

  void MovePoints(const Vec6& pose_step, int from, int to) {
    for (std::size_t k = 0; k < active_.size(); ++k) {
      const BundlePair::State& state = memory_[k].states[from];
      memory_[k].states[to].point_in_a =
          state.point_in_a + state.step + state.step_per_pose * pose_step;
    }
  }

  void KeepPoints(int slot) {
    if (slot == 0) return;
    for (std::size_t k = 0; k < active_.size(); ++k) memory_[k].states[0] = memory_[k].states[slot];
  }

 private:
  void AddPoint(const RelativePose& pose, const Eigen::Matrix<double, 3, 2>& basis,
                const RayPair& pair, BundlePair::State* state, EpipolarNormal* normal) const {
    const Vec3 turned = pose.rotation * state->point_in_a;
    const Vec3 point_in_b = turned + pose.direction / pose.inverse_baseline;
    Vec2 pixel_a, pixel_b;
    Mat23 d_a, d_b;
    state->step.setZero();
    state->step_per_pose.setZero();
    if (images_.camera_a->Project(state->point_in_a, &pixel_a, &d_a) != Projection::kOk ||
        images_.camera_b->Project(point_in_b, &pixel_b, &d_b) != Projection::kOk) {
      normal->cost += options_.loss.Rho(kImpossibleErrorPx * kImpossibleErrorPx);
      return;
    }
    Vec4 error;
    error << pixel_a - images_.pixels_a[pair.index], pixel_b - images_.pixels_b[pair.index];
    Mat43 d_point;
    d_point << d_a, d_b * pose.rotation;
    // d point_in_b / d (rotation, direction, inverse baseline); the direction does not turn.
    Mat36 d_point_in_b;
    d_point_in_b << -Hat(turned), basis / pose.inverse_baseline,
        -pose.direction / (pose.inverse_baseline * pose.inverse_baseline);
    const Mat26 d_pose = d_b * d_point_in_b;  // of b's error; a's does not depend on the pose

    const Vec4 null = LeftNullVector(d_point);
    const Vec6 jacobian = d_pose.transpose() * null.tail<2>();
    const double reduced = null.dot(error);
    const double squared_error = error.squaredNorm();
    const double weight = options_.loss.Weight(squared_error);
    if (!std::isfinite(squared_error) || !jacobian.allFinite()) return;
    normal->cost += options_.loss.Rho(squared_error);
    normal->information.noalias() += weight * jacobian * jacobian.transpose();
    normal->gradient.noalias() += weight * reduced * jacobian;

    const Mat3 information = d_point.transpose() * d_point;
    const Eigen::Matrix<double, 3, 4> solve = information.inverse() * d_point.transpose();
    if (!solve.allFinite()) return;
    state->step = -solve * error;
    state->step_per_pose = -solve.rightCols<2>() * d_pose;
  }

  const TwoViewImages& images_;
  std::span<const RayPair> pairs_;
  std::span<const int> active_;
  const EpipolarRefineOptions& options_;
  std::span<BundlePair> memory_;
};

}  // namespace

int RefineTwoViewBundle(const TwoViewImages& images, std::span<const RayPair> pairs,
                        std::span<const int> active, const EpipolarRefineOptions& options,
                        std::span<BundlePair> memory, RelativePose* pose) noexcept {
  Bundle bundle(images, pairs, active, options, memory);
  bundle.Start(*pose);
  int slot = 0;  // of the best so far
  EpipolarNormal normal = bundle.Linearise(*pose, slot);
  double damping = 1e-6;
  int iteration = 0;
  while (iteration < options.max_iterations) {
    ++iteration;
    const std::optional<Vec6> solved = DampedStep(normal, damping);
    if (!solved) {
      damping *= 10.0;
      continue;
    }
    const Vec6& step = *solved;
    if (!step.allFinite()) break;
    const RelativePose candidate = Perturb(*pose, step, options);
    bundle.MovePoints(step, slot, 1 - slot);
    const EpipolarNormal next = bundle.Linearise(candidate, 1 - slot);
    if (next.cost < normal.cost) {
      const bool is_small = normal.cost - next.cost < 1e-8 * normal.cost;
      *pose = candidate;
      normal = next;
      slot = 1 - slot;
      damping = std::max(1e-9, damping * 0.1);
      if (is_small) break;
    } else {
      if (-step.dot(normal.gradient) < 1e-10 * normal.cost) break;
      damping = std::max(1e-4, damping * 10.0);
    }
  }
  bundle.KeepPoints(slot);
  return iteration;
}

}  // namespace rsfm
