#include "rsfm/estimation/window_ba.h"

#include <algorithm>
#include <cmath>

namespace rsfm {
namespace {

bool IsFinite(const Rigid3& transform) {
  return transform.rotation.coeffs().allFinite() && transform.translation.allFinite() &&
         std::abs(transform.rotation.norm() - 1.0) < 1e-6;
}

bool IsAbsolute(const PosePrior& prior) { return !prior.IsRelative(); }

}  // namespace

Status WindowBaCapacity::Validate() const noexcept {
  if (keyframes <= 0) return Fail(Errc::kInvalidArgument, "keyframes", keyframes);
  if (landmarks <= 0) return Fail(Errc::kInvalidArgument, "landmarks", landmarks);
  if (observations <= 0) return Fail(Errc::kInvalidArgument, "observations", observations);
  if (priors <= 0) return Fail(Errc::kInvalidArgument, "priors", priors);
  if (nav_factors <= 0) return Fail(Errc::kInvalidArgument, "nav_factors", nav_factors);
  return {};
}

Status WindowBaOptions::Validate() const noexcept {
  if (max_iterations < 1) return Fail(Errc::kInvalidArgument, "max_iterations", max_iterations);
  if (!(loss.scale > 0.0)) return Fail(Errc::kInvalidArgument, "loss.scale");
  if (!(function_tolerance >= 0.0)) return Fail(Errc::kInvalidArgument, "function_tolerance");
  if (!(gradient_tolerance >= 0.0)) return Fail(Errc::kInvalidArgument, "gradient_tolerance");
  if (!(parameter_tolerance >= 0.0)) return Fail(Errc::kInvalidArgument, "parameter_tolerance");
  if (!(initial_trust_radius > 0.0)) return Fail(Errc::kInvalidArgument, "initial_trust_radius");
  return {};
}

Expected<WindowBa> WindowBa::Create(const WindowBaCapacity& capacity) {
  if (const Status valid = capacity.Validate(); !valid) return tl::unexpected<Error>(valid.error());
  return WindowBa(capacity);
}

WindowBa::WindowBa(const WindowBaCapacity& capacity)
    : keyframes_(capacity.keyframes),
      poses_(capacity.keyframes),
      trial_poses_(capacity.keyframes),
      points_(capacity.landmarks),
      trial_points_(capacity.landmarks),
      point_fixed_(capacity.landmarks),
      observations_(capacity.observations),
      priors_(capacity.priors),
      nav_factors_(capacity.nav_factors),
      marginal_(capacity.keyframes),
      marginal_of_(capacity.keyframes),
      firsts_{FixedVector<Rigid3>(capacity.keyframes), FixedVector<Vec6>(capacity.keyframes),
              FixedVector<std::uint8_t>(capacity.keyframes), false},
      order_(capacity.observations),
      first_(static_cast<std::size_t>(capacity.landmarks) + 1),
      reduced_(capacity.keyframes + kNavBlocks),
      point_inverse_(capacity.landmarks),
      pose_step_(static_cast<std::size_t>(capacity.keyframes) + kNavBlocks),
      point_step_(capacity.landmarks) {
  Allocate(capacity, &current_);
  Allocate(capacity, &trial_);
}

void WindowBa::Allocate(const WindowBaCapacity& capacity, Linearisation* linearisation) const {
  linearisation->pose_hessian = FixedVector<Mat6>(capacity.keyframes);
  linearisation->pose_gradient = FixedVector<Vec6>(capacity.keyframes);
  linearisation->point_hessian = FixedVector<Mat3>(capacity.landmarks);
  linearisation->point_gradient = FixedVector<Vec3>(capacity.landmarks);
  linearisation->cross = FixedVector<Mat63>(capacity.observations);
  linearisation->priors = FixedVector<PriorEvaluation>(capacity.priors);
  linearisation->nav = FixedVector<NavEvaluation>(capacity.nav_factors);
  linearisation->status = FixedVector<Projection>(capacity.observations);
  linearisation->error_px = FixedVector<double>(capacity.observations);
}

std::size_t WindowBa::bytes() const {
  std::size_t total =
      keyframes_.bytes() + poses_.bytes() + trial_poses_.bytes() + points_.bytes() +
      trial_points_.bytes() + point_fixed_.bytes() + observations_.bytes() + priors_.bytes() +
      nav_factors_.bytes() + marginal_.bytes() + marginal_of_.bytes() + firsts_.poses.bytes() +
      firsts_.moved.bytes() + firsts_.is_known.bytes() + order_.bytes() + first_.bytes() +
      reduced_.bytes() + point_inverse_.bytes() + pose_step_.bytes() + point_step_.bytes();
  for (const Linearisation* l : {&current_, &trial_})
    total += l->pose_hessian.bytes() + l->pose_gradient.bytes() + l->point_hessian.bytes() +
             l->point_gradient.bytes() + l->cross.bytes() + l->priors.bytes() + l->nav.bytes() +
             l->status.bytes() + l->error_px.bytes();
  return total;
}

void WindowBa::Clear() {
  keyframes_.clear();
  poses_.clear();
  points_.clear();
  point_fixed_.clear();
  observations_.clear();
  priors_.clear();
  nav_factors_.clear();
  marginal_.Clear();
  marginal_of_.clear();
  states_.setZero();
  solved_ = false;
}

Expected<int> WindowBa::AddKeyframe(const Rigid3& camera_from_world, int camera, bool fixed) {
  if (!IsFinite(camera_from_world)) return Fail(Errc::kInvalidArgument, "camera_from_world");
  if (camera < 0) return Fail(Errc::kInvalidArgument, "camera", camera);
  if (!keyframes_.TryPushBack({camera, -1, fixed})) return Fail(Errc::kOutOfCapacity, "keyframes");
  poses_.TryPushBack(camera_from_world);
  solved_ = false;
  return num_keyframes() - 1;
}

Expected<int> WindowBa::AddLandmark(const Vec3& point_in_world, bool fixed) {
  if (!point_in_world.allFinite()) return Fail(Errc::kInvalidArgument, "point_in_world");
  if (!points_.TryPushBack(point_in_world)) return Fail(Errc::kOutOfCapacity, "landmarks");
  point_fixed_.TryPushBack(fixed ? 1 : 0);
  solved_ = false;
  return num_landmarks() - 1;
}

Expected<int> WindowBa::AddObservation(int keyframe, int landmark, const Vec2& pixel,
                                       double sigma_px) {
  if (keyframe < 0 || keyframe >= num_keyframes())
    return Fail(Errc::kNotFound, "keyframe", keyframe);
  if (landmark < 0 || landmark >= num_landmarks())
    return Fail(Errc::kNotFound, "landmark", landmark);
  if (!pixel.allFinite()) return Fail(Errc::kInvalidArgument, "pixel");
  if (!(sigma_px > 0.0) || !std::isfinite(sigma_px))
    return Fail(Errc::kInvalidArgument, "sigma_px");
  if (!observations_.TryPushBack({keyframe, landmark, pixel, 1.0 / sigma_px}))
    return Fail(Errc::kOutOfCapacity, "observations");
  solved_ = false;
  return num_observations() - 1;
}

Expected<int> WindowBa::AddAltitude(int keyframe, int landmark, const Rigid3& body_from_camera,
                                    double altitude_m, double sigma_m) {
  if (keyframe < 0 || keyframe >= num_keyframes())
    return Fail(Errc::kNotFound, "keyframe", keyframe);
  if (landmark < 0 || landmark >= num_landmarks())
    return Fail(Errc::kNotFound, "landmark", landmark);
  if (!IsFinite(body_from_camera)) return Fail(Errc::kInvalidArgument, "body_from_camera");
  if (!std::isfinite(altitude_m)) return Fail(Errc::kInvalidArgument, "altitude_m");
  if (!(sigma_m > 0.0) || !std::isfinite(sigma_m)) return Fail(Errc::kInvalidArgument, "sigma_m");
  if (!observations_.TryPushBack({keyframe, landmark, Vec2(altitude_m, 0.0), 1.0 / sigma_m, true,
                                  body_from_camera.OriginOfTarget()}))
    return Fail(Errc::kOutOfCapacity, "observations");
  solved_ = false;
  return num_observations() - 1;
}

Expected<int> WindowBa::AddNavFactor(const NavFactor& factor) {
  if (const Status valid = ValidateNavFactor(factor); !valid)
    return tl::unexpected<Error>(valid.error());
  if (std::max(factor.a, factor.b) >= num_keyframes())
    return Fail(Errc::kNotFound, "nav_factor.keyframe", std::max(factor.a, factor.b));
  if (!marginal_.has_states) return Fail(Errc::kInvalidArgument, "nav_factor.states");
  if (!nav_factors_.TryPushBack(factor)) return Fail(Errc::kOutOfCapacity, "nav_factors");
  solved_ = false;
  return static_cast<int>(nav_factors_.size()) - 1;
}

Expected<int> WindowBa::AddPrior(const PosePrior& prior) {
  if (prior.a < 0 || prior.a >= num_keyframes()) return Fail(Errc::kNotFound, "prior.a", prior.a);
  if (prior.IsRelative() && (prior.b < 0 || prior.b >= num_keyframes()))
    return Fail(Errc::kNotFound, "prior.b", prior.b);
  if (!prior.sqrt_information.allFinite())
    return Fail(Errc::kInvalidArgument, "prior.sqrt_information");
  if (!IsFinite(prior.measured)) return Fail(Errc::kInvalidArgument, "prior.measured");
  if (!IsFinite(prior.body_from_camera))
    return Fail(Errc::kInvalidArgument, "prior.body_from_camera");
  if (!(prior.loss.scale > 0.0)) return Fail(Errc::kInvalidArgument, "prior.loss.scale");
  if (!priors_.TryPushBack(prior)) return Fail(Errc::kOutOfCapacity, "priors");
  solved_ = false;
  return static_cast<int>(priors_.size()) - 1;
}

Status WindowBa::CheckProblem(std::span<const AnyCamera> cameras,
                              const WindowBaOptions& options) const noexcept {
  if (const Status valid = options.Validate(); !valid) return valid;
  bool held = false;
  for (const Keyframe& keyframe : keyframes_) {
    if (keyframe.camera >= static_cast<int>(cameras.size()))
      return Fail(Errc::kInvalidArgument, "camera", keyframe.camera);
    held = held || keyframe.fixed;
  }
  if (observations_.empty() && priors_.empty() && nav_factors_.empty())
    return Fail(Errc::kNotEnoughData, "observations");
  held = held || marginal_.num_keyframes() > 0;
  for (const PosePrior& prior : priors_) held = held || IsAbsolute(prior);
  for (const std::uint8_t fixed : point_fixed_) held = held || fixed != 0;
  if (!held) return Fail(Errc::kDegenerate, "gauge");
  return {};
}

Expected<WindowBaReport> WindowBa::Solve(std::span<const AnyCamera> cameras,
                                         const WindowBaOptions& options) noexcept {
  if (const Status valid = CheckProblem(cameras, options); !valid)
    return tl::unexpected<Error>(valid.error());
  SortObservations();
  trial_poses_.TryResizeForOverwrite(poses_.size());
  trial_points_.TryResizeForOverwrite(points_.size());

  TakeFirstEstimates(false);
  Linearise(cameras, options.loss, poses_, points_, states_, firsts_, &current_);
  WindowBaReport report;
  report.initial_cost = current_.cost;
  double radius = options.initial_trust_radius;
  double shrink = 2.0;
  if (GradientNorm() <= options.gradient_tolerance) report.end = WindowBaEnd::kConverged;
  while (report.end == WindowBaEnd::kIterationLimit && report.iterations < options.max_iterations) {
    ++report.iterations;
    bool accepted = false;
    if (ComputeStep(1.0 / radius)) {
      const double predicted = PredictedDecrease(1.0 / radius);
      const double relative_step = ApplyStep();
      Linearise(cameras, options.loss, trial_poses_, trial_points_, trial_states_, firsts_,
                &trial_);
      const double decrease = current_.cost - trial_.cost;
      const double gain = predicted > 0.0 ? decrease / predicted : -1.0;
      if (gain > 1e-3) {
        accepted = true;
        const bool small = decrease <= options.function_tolerance * current_.cost;
        std::swap(current_, trial_);
        std::swap(poses_, trial_poses_);
        std::swap(points_, trial_points_);
        std::swap(states_, trial_states_);
        radius = std::min(1e16, radius / std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain - 1.0, 3)));
        shrink = 2.0;
        if (small || GradientNorm() <= options.gradient_tolerance)
          report.end = WindowBaEnd::kConverged;
      }
      const bool is_tiny = relative_step <= options.parameter_tolerance ||
                           predicted <= 1e-2 * options.function_tolerance * current_.cost;
      if (is_tiny) report.end = WindowBaEnd::kConverged;
    }
    if (!accepted && report.end == WindowBaEnd::kIterationLimit) {
      radius /= shrink;
      shrink *= 2.0;
      if (radius < 1e-32) report.end = WindowBaEnd::kStuck;
    }
  }
  Summarise(&report);
  solved_ = true;
  return report;
}

double WindowBa::ApplyStep() noexcept {
  double step = 0.0, size = 0.0;
  for (std::size_t k = 0; k < poses_.size(); ++k) {
    trial_poses_[k] = poses_[k];
    if (keyframes_[k].block < 0) continue;
    const Vec6& delta = pose_step_[keyframes_[k].block];
    trial_poses_[k] = Perturb(poses_[k], delta);
    step += delta.squaredNorm();
    size += 1.0 + poses_[k].translation.squaredNorm();
  }
  for (std::size_t l = 0; l < points_.size(); ++l) {
    trial_points_[l] = points_[l] + point_step_[l];
    step += point_step_[l].squaredNorm();
    size += points_[l].squaredNorm();
  }
  trial_states_ = states_;
  if (marginal_.has_states) {
    for (int block = 0; block < kNavBlocks; ++block)
      trial_states_.segment<6>(6 * block) += pose_step_[num_free_ + block];
    step += (trial_states_ - states_).squaredNorm();
  }
  return std::sqrt(step / std::max(size, 1e-300));
}

double WindowBa::GradientNorm() const noexcept {
  double norm = 0.0;
  for (std::size_t k = 0; k < poses_.size(); ++k)
    if (!keyframes_[k].fixed)
      norm = std::max(norm, current_.pose_gradient[k].lpNorm<Eigen::Infinity>());
  for (std::size_t l = 0; l < points_.size(); ++l)
    if (point_fixed_[l] == 0)
      norm = std::max(norm, current_.point_gradient[l].lpNorm<Eigen::Infinity>());
  if (marginal_.has_states)
    norm = std::max(norm, current_.state_gradient.lpNorm<Eigen::Infinity>());
  return norm;
}

void WindowBa::Summarise(WindowBaReport* report) const noexcept {
  report->final_cost = current_.cost;
  double sum = 0.0, squares = 0.0;
  for (int i = 0; i < num_observations(); ++i) {
    if (observations_[i].is_altitude) continue;
    ++report->num_observations;
    if (current_.status[i] != Projection::kOk) {
      ++report->num_impossible;
      continue;
    }
    sum += current_.error_px[i];
    squares += current_.error_px[i] * current_.error_px[i];
  }
  const int count = report->num_observations - report->num_impossible;
  if (count == 0) return;
  report->mean_error_px = sum / count;
  report->rms_error_px = std::sqrt(squares / count);
}

}  // namespace rsfm
