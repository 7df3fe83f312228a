// The normal equations of WindowBa: linearisation, elimination of the landmarks, the step, the
// covariance.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "rsfm/estimation/reprojection_residual.h"
#include "rsfm/estimation/window_ba.h"

namespace rsfm {
namespace {

// Marquardt's damping of one unknown: its curvature over the trust radius, within bounds so that an
// unknown without curvature stays where it is.
double Damping(double curvature, double inverse_radius) {
  return std::clamp(curvature, 1e-6, 1e32) * inverse_radius;
}

// Inverse of a 3x3 symmetric matrix by its cofactors; false when it is not positive definite, or so
// nearly singular that the cofactors have lost their digits.
bool InvertSymmetric(const Mat3& a, Mat3* inverse) {
  const double c00 = a(1, 1) * a(2, 2) - a(1, 2) * a(1, 2);
  const double c01 = a(0, 2) * a(1, 2) - a(0, 1) * a(2, 2);
  const double c02 = a(0, 1) * a(1, 2) - a(0, 2) * a(1, 1);
  const double c11 = a(0, 0) * a(2, 2) - a(0, 2) * a(0, 2);
  const double c12 = a(0, 1) * a(0, 2) - a(0, 0) * a(1, 2);
  const double c22 = a(0, 0) * a(1, 1) - a(0, 1) * a(0, 1);
  const double determinant = a(0, 0) * c00 + a(0, 1) * c01 + a(0, 2) * c02;
  // Written so that NaN fails.
  if (!(a(0, 0) > 0.0) || !(c22 > 0.0) || !(determinant > 1e-13 * a(0, 0) * a(1, 1) * a(2, 2)))
    return false;
  const double s = 1.0 / determinant;
  *inverse << s * c00, s * c01, s * c02, s * c01, s * c11, s * c12, s * c02, s * c12, s * c22;
  return std::isfinite(s);
}

// For a landmark that lacks a direction: along that its derivatives to the poses vanish too, so
// that it may be left out exactly.
Mat3 PseudoInverse(const Mat3& matrix) {
  const Eigen::SelfAdjointEigenSolver<Mat3> eigen(matrix);
  const double cutoff = 1e-13 * eigen.eigenvalues()[2];
  Mat3 inverse = Mat3::Zero();
  for (int i = 0; i < 3; ++i) {
    if (!(eigen.eigenvalues()[i] > cutoff)) continue;
    const Vec3 axis = eigen.eigenvectors().col(i);
    inverse += axis * axis.transpose() / eigen.eigenvalues()[i];
  }
  return inverse;
}

}  // namespace

void WindowBa::SortObservations() noexcept {
  num_free_ = 0;
  for (Keyframe& keyframe : keyframes_) keyframe.block = keyframe.fixed ? -1 : num_free_++;
  const std::size_t num_points = points_.size();
  first_.clear();
  first_.TryResize(num_points + 1);
  for (const Observation& o : observations_) ++first_[o.landmark + 1];
  for (std::size_t l = 0; l < num_points; ++l) first_[l + 1] += first_[l];
  order_.TryResizeForOverwrite(observations_.size());
  for (int i = 0; i < num_observations(); ++i) {
    // first_ of the landmark serves as the end of what is filled and is put back below.
    const int landmark = observations_[i].landmark;
    order_[first_[landmark]++] = i;
  }
  for (std::size_t l = num_points; l > 0; --l) first_[l] = first_[l - 1];
  first_[0] = 0;
  for (std::size_t l = 0; l < num_points; ++l) {
    for (int i = first_[l] + 1; i < first_[l + 1]; ++i) {
      const int moved = order_[i];
      int j = i;
      for (; j > first_[l] && observations_[order_[j - 1]].keyframe > observations_[moved].keyframe;
           --j)
        order_[j] = order_[j - 1];
      order_[j] = moved;
    }
  }
}

void WindowBa::Linearise(std::span<const AnyCamera> cameras, const RobustLoss& loss,
                         const FixedVector<Rigid3>& poses, const FixedVector<Vec3>& points,
                         const NavStates& states, const FirstEstimates& firsts,
                         Linearisation* at) const noexcept {
  at->cost = 0.0;
  at->pose_hessian.TryResizeForOverwrite(poses.size());
  at->pose_gradient.TryResizeForOverwrite(poses.size());
  for (std::size_t k = 0; k < poses.size(); ++k) {
    at->pose_hessian[k].setZero();
    at->pose_gradient[k].setZero();
  }
  at->point_hessian.TryResizeForOverwrite(points.size());
  at->point_gradient.TryResizeForOverwrite(points.size());
  at->cross.TryResizeForOverwrite(observations_.size());
  at->status.TryResizeForOverwrite(observations_.size());
  at->error_px.TryResizeForOverwrite(observations_.size());
  at->priors.TryResizeForOverwrite(priors_.size());
  for (std::size_t l = 0; l < points.size(); ++l)
    LineariseLandmark(cameras, loss, poses, points[l], static_cast<int>(l), firsts, at);
  LinearisePriors(poses, firsts, at);
  LineariseNav(poses, states, firsts, at);
  LineariseMarginal(firsts.at_poses ? firsts.poses : poses, states, at);
}

void WindowBa::LineariseLandmark(std::span<const AnyCamera> cameras, const RobustLoss& loss,
                                 const FixedVector<Rigid3>& poses, const Vec3& point, int landmark,
                                 const FirstEstimates& firsts, Linearisation* at) const noexcept {
  Mat3 point_hessian = Mat3::Zero();
  Vec3 point_gradient = Vec3::Zero();
  for (int i = first_[landmark]; i < first_[landmark + 1]; ++i) {
    const int index = order_[i];
    const Observation& o = observations_[index];
    if (o.is_altitude) {
      at->status[index] = Projection::kOk;
      at->error_px[index] = 0.0;
      LineariseAltitude(o, poses[o.keyframe], point, i, firsts, &point_hessian, &point_gradient,
                        at);
      continue;
    }
    Vec2 error;
    Mat26 d_pose;
    Mat23 d_point;
    const Projection status =
        ReprojectionError(cameras[keyframes_[o.keyframe].camera], poses[o.keyframe], point, o.pixel,
                          &error, &d_pose, &d_point);
    at->status[index] = status;
    if (status != Projection::kOk) {
      at->error_px[index] = 0.0;
      const double whitened = kImpossibleErrorPx * o.inverse_sigma;
      at->cost += 0.5 * loss.Rho(whitened * whitened);
      at->cross[i].setZero();
      continue;
    }
    const double squared_px = error.squaredNorm();
    at->error_px[index] = std::sqrt(squared_px);
    const double information = o.inverse_sigma * o.inverse_sigma;
    at->cost += 0.5 * loss.Rho(squared_px * information);
    const double weight = information * loss.Weight(squared_px * information);
    if (firsts.is_known[o.keyframe] != 0) {
      Vec2 unused;
      Mat26 d_first;
      Mat23 d_point_first;
      if (ReprojectionError(cameras[keyframes_[o.keyframe].camera], firsts.poses[o.keyframe], point,
                            o.pixel, &unused, &d_first, &d_point_first) == Projection::kOk) {
        d_pose = d_first;
        d_point = d_point_first;
      }
      if (firsts.at_poses) {
        error -= d_pose * firsts.moved[o.keyframe];
        at->cost += 0.5 * weight * (error.squaredNorm() - squared_px);
      }
    }
    const Mat23 weighted_point = weight * d_point;
    point_hessian.noalias() += weighted_point.transpose() * d_point;
    point_gradient.noalias() += weighted_point.transpose() * error;
    if (keyframes_[o.keyframe].fixed) {
      at->cross[i].setZero();
      continue;
    }
    const Mat26 weighted_pose = weight * d_pose;
    at->pose_hessian[o.keyframe].noalias() += weighted_pose.transpose() * d_pose;
    at->pose_gradient[o.keyframe].noalias() += weighted_pose.transpose() * error;
    at->cross[i].noalias() = weighted_pose.transpose() * d_point;
  }
  at->point_hessian[landmark] = point_hessian;
  at->point_gradient[landmark] = point_gradient;
}

void WindowBa::LinearisePriors(const FixedVector<Rigid3>& poses, const FirstEstimates& firsts,
                               Linearisation* at) const noexcept {
  for (std::size_t i = 0; i < priors_.size(); ++i) {
    const PosePrior& prior = priors_[i];
    const int b = prior.IsRelative() ? prior.b : prior.a;
    PriorEvaluation& e = at->priors[i];
    e = EvaluatePrior(prior, poses[prior.a], poses[b]);
    const double squared = e.residual.squaredNorm();
    at->cost += 0.5 * prior.loss.Rho(squared);
    const double scale = std::sqrt(prior.loss.Weight(squared));
    if (firsts.is_known[prior.a] != 0 || firsts.is_known[b] != 0) {
      const PriorEvaluation first = EvaluatePrior(
          prior, firsts.is_known[prior.a] != 0 ? firsts.poses[prior.a] : poses[prior.a],
          firsts.is_known[b] != 0 ? firsts.poses[b] : poses[b]);
      e.d_residual_d_a = first.d_residual_d_a;
      e.d_residual_d_b = first.d_residual_d_b;
      if (firsts.at_poses) {
        e.residual -= e.d_residual_d_a * firsts.moved[prior.a];
        if (prior.IsRelative()) e.residual -= e.d_residual_d_b * firsts.moved[b];
        at->cost += 0.5 * scale * scale * (e.residual.squaredNorm() - squared);
      }
    }
    e.residual *= scale;
    e.d_residual_d_a *= scale;
    e.d_residual_d_b *= scale;
    at->pose_hessian[prior.a].noalias() += e.d_residual_d_a.transpose() * e.d_residual_d_a;
    at->pose_gradient[prior.a].noalias() += e.d_residual_d_a.transpose() * e.residual;
    if (!prior.IsRelative()) continue;
    at->pose_hessian[b].noalias() += e.d_residual_d_b.transpose() * e.d_residual_d_b;
    at->pose_gradient[b].noalias() += e.d_residual_d_b.transpose() * e.residual;
  }
}

bool WindowBa::Reduce(double inverse_radius) noexcept {
  Accumulate(inverse_radius);
  // Undamped, for the covariance, a direction that the data do not determine must be found out.
  return reduced_.Factorise(inverse_radius > 0.0 ? 0.0 : 1e-11);
}

void WindowBa::Accumulate(double inverse_radius) noexcept {
  reduced_.Reset(num_blocks());
  pose_step_.TryResizeForOverwrite(static_cast<std::size_t>(num_blocks()));
  for (std::size_t k = 0; k < poses_.size(); ++k) {
    const int block = keyframes_[k].block;
    if (block < 0) continue;
    Mat6& diagonal = reduced_.Block(block, block);
    diagonal = current_.pose_hessian[k];
    for (int i = 0; i < 6; ++i)
      if (inverse_radius > 0.0) diagonal(i, i) += Damping(diagonal(i, i), inverse_radius);
    pose_step_[block] = -current_.pose_gradient[k];
  }
  if (marginal_.has_states) {
    for (int block = 0; block < kNavBlocks; ++block) {
      Mat6& diagonal = reduced_.Block(num_free_ + block, num_free_ + block);
      diagonal = current_.state_hessian.block<6, 6>(6 * block, 6 * block);
      for (int i = 0; i < 6; ++i)
        if (inverse_radius > 0.0) diagonal(i, i) += Damping(diagonal(i, i), inverse_radius);
      pose_step_[num_free_ + block] = -current_.state_gradient.segment<6>(6 * block);
    }
  }
  reduced_.MarkDiagonal();
  ReduceNav();
  for (std::size_t i = 0; i < priors_.size(); ++i) {
    if (!priors_[i].IsRelative()) continue;
    const int a = keyframes_[priors_[i].a].block, b = keyframes_[priors_[i].b].block;
    if (a < 0 || b < 0) continue;
    const PriorEvaluation& e = current_.priors[i];
    if (a > b) {
      reduced_.Block(a, b).noalias() += e.d_residual_d_a.transpose() * e.d_residual_d_b;
    } else {
      reduced_.Block(b, a).noalias() += e.d_residual_d_b.transpose() * e.d_residual_d_a;
    }
  }
  point_inverse_.TryResizeForOverwrite(points_.size());
  for (int l = 0; l < num_landmarks(); ++l) EliminateLandmark(l, inverse_radius);
}

void WindowBa::EliminateLandmark(int landmark, double inverse_radius) noexcept {
  Mat3& inverse = point_inverse_[landmark];
  Mat3 hessian = current_.point_hessian[landmark];
  if (point_fixed_[landmark] != 0) {
    inverse.setZero();
  } else if (inverse_radius > 0.0) {
    for (int i = 0; i < 3; ++i) hessian(i, i) += Damping(hessian(i, i), inverse_radius);
    if (!InvertSymmetric(hessian, &inverse)) inverse.setZero();
  } else if (!InvertSymmetric(hessian, &inverse)) {
    inverse = PseudoInverse(hessian);
  }
  if (inverse.isZero(0.0)) return;
  const Vec3& gradient = current_.point_gradient[landmark];
  for (int i = first_[landmark]; i < first_[landmark + 1]; ++i) {
    const int row = keyframes_[observations_[order_[i]].keyframe].block;
    if (row < 0) continue;
    const Mat63 eliminated = current_.cross[i] * inverse;
    pose_step_[row].noalias() += eliminated * gradient;
    reduced_.Block(row, row).noalias() -= eliminated * current_.cross[i].transpose();
    for (int j = first_[landmark]; j < i; ++j) {
      const int column = keyframes_[observations_[order_[j]].keyframe].block;
      if (column < 0) continue;
      reduced_.Block(row, column).noalias() -= eliminated * current_.cross[j].transpose();
      // The same keyframe twice: both orders fall on the diagonal.
      if (row == column)
        reduced_.Block(row, row).noalias() -=
            current_.cross[j] * inverse * current_.cross[i].transpose();
    }
  }
}

bool WindowBa::ComputeStep(double inverse_radius) noexcept {
  if (!Reduce(inverse_radius)) return false;
  reduced_.SolveInPlace(pose_step_.span());
  for (const Vec6& step : pose_step_)
    if (!step.allFinite()) return false;
  point_step_.TryResizeForOverwrite(points_.size());
  for (int l = 0; l < num_landmarks(); ++l) {
    Vec3 right = -current_.point_gradient[l];
    for (int i = first_[l]; i < first_[l + 1]; ++i) {
      const int block = keyframes_[observations_[order_[i]].keyframe].block;
      if (block >= 0) right.noalias() -= current_.cross[i].transpose() * pose_step_[block];
    }
    point_step_[l].noalias() = point_inverse_[l] * right;
  }
  return true;
}

// Of the quadratic model: (H + D) d = -g makes the decrease d^T (D d - g) / 2.
double WindowBa::PredictedDecrease(double inverse_radius) const noexcept {
  double twice = 0.0;
  for (std::size_t k = 0; k < poses_.size(); ++k) {
    const int block = keyframes_[k].block;
    if (block < 0) continue;
    for (int i = 0; i < 6; ++i) {
      const double d = pose_step_[block][i];
      twice += d * (Damping(current_.pose_hessian[k](i, i), inverse_radius) * d -
                    current_.pose_gradient[k][i]);
    }
  }
  for (std::size_t l = 0; l < points_.size(); ++l) {
    for (int i = 0; i < 3; ++i) {
      const double d = point_step_[l][i];
      twice += d * (Damping(current_.point_hessian[l](i, i), inverse_radius) * d -
                    current_.point_gradient[l][i]);
    }
  }
  if (marginal_.has_states) {
    for (int i = 0; i < kNumNavStates; ++i) {
      const double d = pose_step_[num_free_ + i / 6][i % 6];
      twice += d * (Damping(current_.state_hessian(i, i), inverse_radius) * d -
                    current_.state_gradient[i]);
    }
  }
  return 0.5 * twice;
}

Expected<Mat6> WindowBa::PoseCovariance(int keyframe) noexcept {
  if (!solved_ || keyframe < 0 || keyframe >= num_keyframes())
    return Fail(Errc::kNotFound, "keyframe", keyframe);
  const int block = keyframes_[keyframe].block;
  if (block < 0) return Mat6(Mat6::Zero());
  return BlockCovariance(block);
}

Expected<Mat6> WindowBa::NavStateCovariance() noexcept {
  if (!solved_ || !marginal_.has_states) return Fail(Errc::kNotFound, "states");
  return BlockCovariance(num_free_);
}

Expected<Mat6> WindowBa::BlockCovariance(int block) noexcept {
  if (!Reduce(0.0)) return Fail(Errc::kDegenerate, "covariance", block);
  Mat6 covariance;
  for (int column = 0; column < 6; ++column) {
    for (Vec6& entry : pose_step_) entry.setZero();
    pose_step_[block][column] = 1.0;
    reduced_.SolveInPlace(pose_step_.span());
    covariance.col(column) = pose_step_[block];
  }
  if (!covariance.allFinite()) return Fail(Errc::kDegenerate, "covariance", block);
  return Mat6(0.5 * (covariance + covariance.transpose()));
}

}  // namespace rsfm
