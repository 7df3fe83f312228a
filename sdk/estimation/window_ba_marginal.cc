// WindowBa's navigation factors, altitudes, and the prior that one window hands to the next.
#include <Eigen/Eigenvalues>
#include <cmath>

#include "rsfm/estimation/window_ba.h"

namespace rsfm {
namespace {

constexpr RobustLoss kAltitudeLoss{LossType::kCauchy, 2.0};

// Of a keyframe that leaves: directions that nothing determines carry no information on.
Mat6 PseudoInverse(const Mat6& matrix) {
  const Eigen::SelfAdjointEigenSolver<Mat6> eigen(matrix);
  const double cutoff = 1e-13 * eigen.eigenvalues()[5];
  Mat6 inverse = Mat6::Zero();
  for (int i = 0; i < 6; ++i) {
    if (!(eigen.eigenvalues()[i] > cutoff)) continue;
    const Vec6 axis = eigen.eigenvectors().col(i);
    inverse += axis * axis.transpose() / eigen.eigenvalues()[i];
  }
  return inverse;
}

}  // namespace

Status WindowBa::SetMarginalPrior(const MarginalPrior& prior, std::span<const int> keyframe_of,
                                  const NavStates& states) {
  if (static_cast<int>(keyframe_of.size()) != prior.num_keyframes() ||
      keyframe_of.size() > marginal_of_.capacity())
    return Fail(Errc::kInvalidArgument, "keyframe_of");
  for (std::size_t i = 0; i < keyframe_of.size(); ++i) {
    const bool ascends = i == 0 || keyframe_of[i] > keyframe_of[i - 1];
    if (!ascends || keyframe_of[i] < 0 || keyframe_of[i] >= num_keyframes() ||
        keyframes_[static_cast<std::size_t>(keyframe_of[i])].fixed)
      return Fail(Errc::kInvalidArgument, "keyframe_of", static_cast<std::int32_t>(i));
  }
  if (!states.allFinite()) return Fail(Errc::kInvalidArgument, "states");
  marginal_.Clear();
  marginal_of_.clear();
  for (std::size_t i = 0; i < keyframe_of.size(); ++i) {
    marginal_of_.TryPushBack(keyframe_of[i]);
    marginal_.first_estimates.TryPushBack(prior.first_estimates[i]);
  }
  marginal_.has_states = prior.has_states;
  marginal_.first_states = prior.first_states;
  marginal_.cost = prior.cost;
  marginal_.information.Reset(prior.num_blocks());
  marginal_.gradient.TryResizeForOverwrite(static_cast<std::size_t>(prior.num_blocks()));
  for (int i = 0; i < prior.num_blocks(); ++i) {
    marginal_.gradient[static_cast<std::size_t>(i)] = prior.gradient[static_cast<std::size_t>(i)];
    for (int j = 0; j <= i; ++j) marginal_.information.Block(i, j) = prior.information.Block(i, j);
  }
  states_ = states;
  solved_ = false;
  return {};
}

// error = point.z - body.z - altitude, with body = R' (o - t), R and t of camera_from_world.
void WindowBa::LineariseAltitude(const Observation& o, const Rigid3& pose, const Vec3& point,
                                 int place, const FirstEstimates& firsts, Mat3* point_hessian,
                                 Vec3* point_gradient, Linearisation* at) const noexcept {
  Mat3 world_from_camera = pose.rotation.toRotationMatrix().transpose();
  const Vec3 body = world_from_camera * (o.body_in_camera - pose.translation);
  const double error = (point.z() - body.z() - o.pixel.x()) * o.inverse_sigma;
  at->cost += 0.5 * kAltitudeLoss.Rho(error * error);
  const double root_weight = std::sqrt(kAltitudeLoss.Weight(error * error));
  const double scale = root_weight * o.inverse_sigma;
  const Vec3 d_point(0.0, 0.0, scale);
  if (firsts.is_known[o.keyframe] != 0)
    world_from_camera = firsts.poses[o.keyframe].rotation.toRotationMatrix().transpose();
  Vec6 d_pose;
  d_pose.head<3>() = -scale * (world_from_camera * Hat(o.body_in_camera)).row(2).transpose();
  d_pose.tail<3>() = scale * world_from_camera.row(2).transpose();
  double weighted = root_weight * error;
  if (firsts.at_poses) {
    const double now = weighted;
    weighted -= d_pose.dot(firsts.moved[o.keyframe]);
    at->cost += 0.5 * (weighted * weighted - now * now);
  }
  point_hessian->noalias() += d_point * d_point.transpose();
  *point_gradient += weighted * d_point;
  if (keyframes_[o.keyframe].fixed) {
    at->cross[place].setZero();
    return;
  }
  at->pose_hessian[o.keyframe].noalias() += d_pose * d_pose.transpose();
  at->pose_gradient[o.keyframe] += weighted * d_pose;
  at->cross[place].noalias() = d_pose * d_point.transpose();
}

void WindowBa::LineariseNav(const FixedVector<Rigid3>& poses, const NavStates& states,
                            const FirstEstimates& firsts, Linearisation* at) const noexcept {
  at->state_hessian.setZero();
  at->state_gradient.setZero();
  at->nav.TryResizeForOverwrite(nav_factors_.size());
  for (std::size_t i = 0; i < nav_factors_.size(); ++i) {
    const NavFactor& factor = nav_factors_[i];
    const int b = factor.b >= 0 ? factor.b : factor.a;
    NavEvaluation& e = at->nav[i];
    e = EvaluateNavFactor(factor, poses[factor.a], poses[b], states);
    const double squared = e.residual.squaredNorm();
    at->cost += 0.5 * factor.loss.Rho(squared);
    const double scale = std::sqrt(factor.loss.Weight(squared));
    if (firsts.is_known[factor.a] != 0 || firsts.is_known[b] != 0) {
      const NavEvaluation first = EvaluateNavFactor(
          factor, firsts.is_known[factor.a] != 0 ? firsts.poses[factor.a] : poses[factor.a],
          firsts.is_known[b] != 0 ? firsts.poses[b] : poses[b], states);
      e.d_residual_d_a = first.d_residual_d_a;
      e.d_residual_d_b = first.d_residual_d_b;
      e.d_residual_d_states = first.d_residual_d_states;
      if (firsts.at_poses) {
        e.residual -= e.d_residual_d_a * firsts.moved[factor.a];
        if (factor.b >= 0) e.residual -= e.d_residual_d_b * firsts.moved[b];
        at->cost += 0.5 * scale * scale * (e.residual.squaredNorm() - squared);
      }
    }
    e.residual *= scale;
    e.d_residual_d_a *= scale;
    e.d_residual_d_b *= scale;
    e.d_residual_d_states *= scale;
    at->pose_hessian[factor.a].noalias() += e.d_residual_d_a.transpose() * e.d_residual_d_a;
    at->pose_gradient[factor.a].noalias() += e.d_residual_d_a.transpose() * e.residual;
    at->state_hessian.noalias() += e.d_residual_d_states.transpose() * e.d_residual_d_states;
    at->state_gradient.noalias() += e.d_residual_d_states.transpose() * e.residual;
    if (factor.b < 0) continue;
    at->pose_hessian[b].noalias() += e.d_residual_d_b.transpose() * e.d_residual_d_b;
    at->pose_gradient[b].noalias() += e.d_residual_d_b.transpose() * e.residual;
  }
}

int WindowBa::BlockOfMarginal(int i) const noexcept {
  const int num_poses = static_cast<int>(marginal_of_.size());
  return i < num_poses ? keyframes_[marginal_of_[i]].block : num_free_ + i - num_poses;
}

void WindowBa::LineariseMarginal(const FixedVector<Rigid3>& poses, const NavStates& states,
                                 Linearisation* at) const noexcept {
  if (marginal_.num_blocks() == 0) return;
  const int num_poses = static_cast<int>(marginal_of_.size());
  const auto difference = [&](int i, Mat6* derivative) -> Vec6 {
    if (i < num_poses)
      return PoseDifference(poses[marginal_of_[i]], marginal_.first_estimates[i], derivative);
    const int first = 6 * (i - num_poses);
    if (derivative != nullptr) derivative->setIdentity();
    return states.segment<6>(first) - marginal_.first_states.segment<6>(first);
  };
  at->cost += marginal_.cost;
  for (int i = 0; i < marginal_.num_blocks(); ++i) {
    Mat6 derivative;
    const Vec6 d_i = difference(i, &derivative);
    Vec6 product = marginal_.information.Block(i, i).selfadjointView<Eigen::Lower>() * d_i;
    for (int j = 0; j < marginal_.num_blocks(); ++j) {
      if (j < i) product.noalias() += marginal_.information.Block(i, j) * difference(j, nullptr);
      if (j > i)
        product.noalias() += marginal_.information.Block(j, i).transpose() * difference(j, nullptr);
    }
    at->cost += marginal_.gradient[i].dot(d_i) + 0.5 * d_i.dot(product);
    const Vec6 gradient = derivative.transpose() * (marginal_.gradient[i] + product);
    const Mat6 hessian = marginal_.information.Block(i, i).selfadjointView<Eigen::Lower>();
    if (i < num_poses) {
      at->pose_gradient[marginal_of_[i]] += gradient;
      at->pose_hessian[marginal_of_[i]] += hessian;
    } else {
      const int first = 6 * (i - num_poses);
      at->state_gradient.segment<6>(first) += gradient;
      at->state_hessian.block<6, 6>(first, first) += hessian;
      for (int j = num_poses; j < i; ++j) {
        const Mat6& across = marginal_.information.Block(i, j);
        at->state_hessian.block<6, 6>(first, 6 * (j - num_poses)) += across;
        at->state_hessian.block<6, 6>(6 * (j - num_poses), first) += across.transpose();
      }
    }
  }
}

// What lies off the diagonal of the poses' and states' part.
void WindowBa::ReduceNav() noexcept {
  const auto add = [&](int row, int column, const Mat6& block) {
    if (row < 0 || column < 0) return;
    if (row >= column) {
      reduced_.Block(row, column) += block;
    } else {
      reduced_.Block(column, row) += block.transpose();
    }
  };
  for (std::size_t i = 0; i < nav_factors_.size(); ++i) {
    const NavEvaluation& e = current_.nav[i];
    const int a = keyframes_[nav_factors_[i].a].block;
    const int b = nav_factors_[i].b >= 0 ? keyframes_[nav_factors_[i].b].block : -1;
    if (a >= 0 && b >= 0) add(b, a, e.d_residual_d_b.transpose() * e.d_residual_d_a);
    for (int s = 0; s < kNavBlocks; ++s) {
      const Mat36 d_states = e.d_residual_d_states.middleCols<6>(6 * s);
      add(num_free_ + s, a, d_states.transpose() * e.d_residual_d_a);
      add(num_free_ + s, b, d_states.transpose() * e.d_residual_d_b);
    }
  }
  if (marginal_.has_states) add(num_free_ + 1, num_free_, current_.state_hessian.block<6, 6>(6, 0));
  const int num_poses = static_cast<int>(marginal_of_.size());
  for (int i = 0; i < marginal_.num_blocks(); ++i) {
    for (int j = 0; j < std::min(i, num_poses); ++j)
      add(BlockOfMarginal(i), BlockOfMarginal(j), marginal_.information.Block(i, j));
  }
}

void WindowBa::TakeFirstEstimates(bool at_poses) noexcept {
  firsts_.at_poses = at_poses;
  firsts_.poses.TryResizeForOverwrite(poses_.size());
  firsts_.moved.TryResizeForOverwrite(poses_.size());
  firsts_.is_known.TryResizeForOverwrite(poses_.size());
  for (std::size_t k = 0; k < poses_.size(); ++k) {
    firsts_.poses[k] = poses_[k];
    firsts_.moved[k].setZero();
    firsts_.is_known[k] = 0;
  }
  for (std::size_t i = 0; i < marginal_of_.size(); ++i) {
    if (marginal_.information.Block(static_cast<int>(i), static_cast<int>(i)).isZero(0.0)) continue;
    const int k = marginal_of_[i];
    firsts_.poses[k] = marginal_.first_estimates[i];
    firsts_.moved[k] = PoseDifference(poses_[k], firsts_.poses[k], nullptr);
    firsts_.is_known[k] = 1;
  }
}

Status WindowBa::Marginalise(std::span<const AnyCamera> cameras, const RobustLoss& loss,
                             int num_gone, MarginalPrior* result) noexcept {
  bool was_fixed = false;
  for (const Keyframe& keyframe : keyframes_) {
    if (was_fixed && !keyframe.fixed) return Fail(Errc::kInvalidArgument, "fixed");
    was_fixed = keyframe.fixed;
    if (keyframe.camera >= static_cast<int>(cameras.size()))
      return Fail(Errc::kInvalidArgument, "camera", keyframe.camera);
  }
  SortObservations();
  if (num_gone < 0 || num_gone > num_free_)
    return Fail(Errc::kInvalidArgument, "num_gone", num_gone);
  TakeFirstEstimates(true);
  Linearise(cameras, loss, poses_, points_, states_, firsts_, &current_);
  Accumulate(0.0);
  double cost = current_.cost;
  for (int l = 0; l < num_landmarks(); ++l)
    cost -= 0.5 * current_.point_gradient[l].dot(point_inverse_[l] * current_.point_gradient[l]);
  // The gradient is the negative of what Accumulate leaves on the right hand side.
  const int num_all = num_blocks();
  for (int i = 0; i < num_all; ++i) {
    pose_step_[i] = -pose_step_[i];
    const Mat6 whole = reduced_.Block(i, i).selfadjointView<Eigen::Lower>();
    reduced_.Block(i, i) = whole;
  }
  for (int gone = 0; gone < num_gone; ++gone) {
    const Mat6 inverse = PseudoInverse(reduced_.Block(gone, gone));
    cost -= 0.5 * pose_step_[gone].dot(inverse * pose_step_[gone]);
    for (int i = gone + 1; i < num_all; ++i) {
      const Mat6 factor = reduced_.Block(i, gone) * inverse;
      pose_step_[i].noalias() -= factor * pose_step_[gone];
      for (int j = gone + 1; j <= i; ++j)
        reduced_.Block(i, j).noalias() -= factor * reduced_.Block(j, gone).transpose();
    }
  }
  for (int i = num_gone; i < num_all; ++i) {
    if (!pose_step_[i].allFinite()) return Fail(Errc::kDegenerate, "gradient");
    for (int j = num_gone; j <= i; ++j)
      if (!reduced_.Block(i, j).allFinite()) return Fail(Errc::kDegenerate, "information");
  }
  if (num_free_ - num_gone > static_cast<int>(result->first_estimates.capacity()))
    return Fail(Errc::kOutOfCapacity, "prior");
  const bool has_states = marginal_.has_states;
  result->Clear();
  for (int k = num_gone; k < num_free_; ++k) result->first_estimates.TryPushBack(firsts_.poses[k]);
  result->has_states = has_states;
  result->first_states = states_;
  result->cost = std::max(cost, 0.0);
  result->information.Reset(num_all - num_gone);
  result->gradient.TryResizeForOverwrite(static_cast<std::size_t>(num_all - num_gone));
  for (int i = num_gone; i < num_all; ++i) {
    result->gradient[i - num_gone] = pose_step_[i];
    for (int j = num_gone; j <= i; ++j)
      result->information.Block(i - num_gone, j - num_gone) = reduced_.Block(i, j);
  }
  return {};
}

}  // namespace rsfm
