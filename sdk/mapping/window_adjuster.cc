#include "rsfm/mapping/window_adjuster.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace rsfm {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
constexpr double kMeanObservations = 8.0;  // of a landmark in a window: sizes the memory
constexpr double kTenMinutes = 600.0;
constexpr RobustLoss kImageLoss{LossType::kHuber, 1.0};

std::size_t Count(int value) { return static_cast<std::size_t>(std::max(value, 0)); }

NavStates Sigmas(const MapperOptions& options) {
  NavStates sigmas = NavStates::Zero();
  sigmas[kHeadingBias] = options.heading_bias_sigma_deg * kRadPerDeg;
  sigmas[kVelocityScale] = options.velocity_scale_sigma;
  sigmas.segment<3>(kMisalignment).setConstant(options.misalignment_sigma_deg * kRadPerDeg);
  sigmas[kClockOffset] = options.clock_sigma_s;
  sigmas.segment<3>(kVelocityLever).setConstant(options.velocity_lever_sigma_m);
  return sigmas;
}

// Of the random walk, a second long.
NavStates DriftVariances(const MapperOptions& options) {
  NavStates variances = NavStates::Zero();
  const double drift = options.heading_drift_deg * kRadPerDeg;
  variances[kHeadingBias] = drift * drift / kTenMinutes;
  return variances;
}

}  // namespace

WindowAdjuster::WindowAdjuster(const MapperOptions& options, const AnyCamera& camera, WindowBa ba)
    : options_(options),
      camera_(camera),
      ba_(std::move(ba)),
      prior_(MaxWindow(options)),
      prior_keyframes_(Count(MaxWindow(options))),
      prior_index_(Count(MaxWindow(options))),
      window_(Count(MaxWindow(options))),
      motions_(Count(MaxWindow(options))),
      landmarks_(Count(options.window_landmarks)),
      index_of_(Count(options.max_keyframes)),
      landmark_index_(Count(options.max_landmarks)) {
  index_of_.TryResize(index_of_.capacity());
  landmark_index_.TryResize(landmark_index_.capacity());
  Reset();
}

Expected<WindowAdjuster> WindowAdjuster::Create(const MapperOptions& options,
                                                const AnyCamera& camera) {
  WindowBaCapacity capacity;
  capacity.keyframes = MaxWindow(options) + kMaxAnchors;
  capacity.landmarks = options.window_landmarks;
  capacity.observations = static_cast<int>(kMeanObservations * options.window_landmarks);
  capacity.priors = MaxWindow(options) + 2;
  capacity.nav_factors = 4 * MaxWindow(options);
  auto ba = WindowBa::Create(capacity);
  if (!ba) return tl::unexpected(ba.error());
  return WindowAdjuster(options, camera, std::move(*ba));
}

std::size_t WindowAdjuster::bytes() const {
  return ba_.bytes() + prior_.bytes() + landmarks_.bytes() + landmark_index_.bytes();
}

void WindowAdjuster::Reset(double sigma_scale) noexcept {
  sigma_scale_ = sigma_scale;
  prior_.Clear();
  prior_keyframes_.clear();
  window_.clear();
  states_.setZero();
  state_covariance_.setZero();
  base_covariance_.setZero();
  first_id_ = 0;
  gauge_ = gauge_second_ = {};
  positions_from_ = 0;
  is_prepared_ = has_left_ = has_left_before_ = false;
  num_gated_in_row_ = 0;
}

bool WindowAdjuster::Holds(SlotId keyframe) const noexcept {
  return std::find(prior_keyframes_.begin(), prior_keyframes_.end(), keyframe) !=
         prior_keyframes_.end();
}

void WindowAdjuster::Translate(const Vec3& by_m, const Vec3& sigma_m) noexcept {
  prior_.Translate(by_m);
  gauge_place_.measured.translation += by_m;
  base_from_world_.translation -= base_from_world_.rotation * by_m;
  for (int axis = 0; axis < 3; ++axis)
    if (prior_.num_keyframes() > 0 && sigma_m[axis] > 0.0)
      prior_.AddTranslationNoise(Vec3::Unit(axis), sigma_m[axis] * sigma_m[axis]);
}

void WindowAdjuster::Move(const Rigid3& new_world_from_world) noexcept {
  const Rigid3 back = new_world_from_world.Inverse();
  for (Rigid3& pose : prior_.first_estimates) pose = pose * back;
  base_from_world_ = base_from_world_ * back;
  gauge_place_.measured = new_world_from_world * gauge_place_.measured;
  if (!prior_.has_states) return;
  // The compass says what it said: its bias takes the turn.
  const double turned_rad = LogSo3(new_world_from_world.rotation).z();
  states_[kHeadingBias] -= turned_rad;
  prior_.first_states[kHeadingBias] -= turned_rad;
}

// The newest placed keyframes. Those that the prior knows are in; of others that were placed late
// the oldest stay out when there are too many.
void WindowAdjuster::SelectWindow(const Map& map) noexcept {
  for (const SlotId id : prior_keyframes_) {
    if (!map.Contains(id)) Reset();  // evicted before it left: what the prior knew is void
  }
  std::size_t num_others = 0;
  for (const SlotId id : map.keyframes()) {
    const Keyframe& keyframe = map.keyframe(id);
    num_others += keyframe.is_placed && keyframe.id >= first_id_ && !Holds(id);
  }
  const std::size_t limit =
      prior_keyframes_.empty() ? Count(options_.window_keyframes) : window_.capacity();
  const std::size_t room = limit - std::min(limit, prior_keyframes_.size());
  window_.clear();
  for (const SlotId id : map.keyframes()) {
    const Keyframe& keyframe = map.keyframe(id);
    if (!keyframe.is_placed || keyframe.id < first_id_) continue;
    if (!Holds(id) && num_others-- > room) continue;
    window_.TryPushBack(id);
  }
}

// A world begins: where the first keyframe is says where everything is. What is measured there
// (depth, a fix, the attitude) is left to its factors.
void WindowAdjuster::StartPrior(const Map& map, const NavAid* nav) noexcept {
  if (nav != nullptr && !prior_.has_states) {
    prior_.StartWithStates(states_, Sigmas(options_));
    prior_keyframes_.clear();
  }
  if (prior_.num_keyframes() > 0 || map.Contains(gauge_)) return;
  const Keyframe& first = map.keyframe(window_[0]);
  gauge_ = window_[0];
  gauge_second_ = nav == nullptr ? window_[1] : window_.back();
  Mat6 covariance = 1e-8 * Mat6::Identity();
  Rigid3 body_from_camera;
  if (nav != nullptr) {
    constexpr double kUnknown = 1e3;
    const NavSample sample = nav->buffer().At(first.utime);
    covariance = 1e-6 * Mat6::Identity();
    covariance.topLeftCorner<3, 3>() = Mat3::Identity();
    if (sample.Has(NavField::kPosition)) covariance(3, 3) = covariance(4, 4) = kUnknown * kUnknown;
    if (sample.Has(NavField::kPosition) || sample.Has(NavField::kDepth))
      covariance(5, 5) = kUnknown * kUnknown;
    body_from_camera = nav->body_from_camera();
  }
  const Rigid3 world_from_body = first.camera_from_world.Inverse() * body_from_camera.Inverse();
  if (const auto place = MakePosePrior(0, body_from_camera, world_from_body, covariance))
    gauge_place_ = *place;
  has_gauge_length_ = false;
  const double part = nav == nullptr ? 1e-3 : sigma_scale_;
  if (part <= 0.0) return;
  const double length = (map.keyframe(gauge_second_).camera_from_world.OriginOfTarget() -
                         first.camera_from_world.OriginOfTarget())
                            .norm();
  if (const auto prior = MakeBaselinePrior(0, 1, Rigid3(), length, part * length)) {
    gauge_length_ = *prior;
    has_gauge_length_ = true;
  }
}

Status WindowAdjuster::Prepare(const Map& map, const NavAid* nav) noexcept {
  has_left_ = is_prepared_ = false;
  solution_.reset();
  SelectWindow(map);
  if (window_.size() < 2) return Fail(Errc::kNotEnoughData, "window");
  StartPrior(map, nav);
  MeasureMotion(map, nav);
  if (const Status status = AddKeyframes(map); !status) return status;
  AddLandmarks(map, 3);
  AddLandmarks(map, 2);
  for (int k = 0; k < static_cast<int>(window_.size()); ++k) {
    AddGauge(k);
    if (nav == nullptr) continue;
    AddNav(map, *nav, k);
    AddAltitude(map, *nav, k);
  }
  AddLinks(map, nav);
  is_prepared_ = true;
  return {};
}

void WindowAdjuster::Solve() noexcept {
  if (!is_prepared_ || solution_) return;
  WindowBaOptions options;
  options.loss = kImageLoss;
  options.max_iterations = options_.window_iterations;
  options.function_tolerance = 1e-5;
  solution_ = ba_.Solve(std::span(&camera_, 1), options);
  if (!*solution_) return;
  const auto keep = [](const Expected<Mat6>& covariance) {
    return covariance ? std::optional(*covariance) : std::nullopt;
  };
  newest_covariance_ = keep(ba_.PoseCovariance(static_cast<int>(window_.size()) - 1));
  solved_state_covariance_ = keep(ba_.NavStateCovariance());
}

Expected<WindowBaReport> WindowAdjuster::Finish(Map* map, NavAid* nav) noexcept {
  if (!is_prepared_) return Fail(Errc::kNotEnoughData, "window");
  Solve();
  is_prepared_ = false;
  if (!*solution_) return *solution_;
  WriteBack(map, nav != nullptr);
  if (window_.size() >= Count(options_.window_keyframes)) Leave(map, nav);
  return *solution_;
}

void WindowAdjuster::WriteBack(Map* map, bool has_nav) noexcept {
  for (std::size_t k = 0; k < window_.size(); ++k) {
    Keyframe& keyframe = map->keyframe(window_[k]);
    keyframe.camera_from_world = ba_.camera_from_world(static_cast<int>(k));
  }
  for (std::size_t l = 0; l < landmarks_.size(); ++l) {
    Landmark* landmark = map->landmarks().Find(landmarks_[l]);
    const Vec3& point = ba_.point_in_world(static_cast<int>(l));
    landmark->is_changed |= point != landmark->point_in_world;
    landmark->point_in_world = point;
  }
  if (has_nav) {
    states_ = ba_.nav_states();
    if (solved_state_covariance_) state_covariance_ = *solved_state_covariance_;
  }
  // Where old keyframes hold the window, it is as uncertain as they are and what comes on top, be
  // it by a few points that were missed for a while: fixed poses say where the yaw is, and its
  // bias. Level and plumb it stands by its own sensors.
  if (num_anchored_ > 0 && map->Contains(anchor_)) {
    base_covariance_ = map->keyframe(anchor_).covariance;
    base_from_world_ = map->keyframe(anchor_).camera_from_world;
    if (has_nav) {
      Mat6 unlevelled = Mat6::Identity();
      const Vec3 down = base_from_world_.rotation * Vec3::UnitZ();
      unlevelled.topLeftCorner<3, 3>() = down * down.transpose();
      base_covariance_ = unlevelled * base_covariance_ * unlevelled.transpose();
    }
  }
  Keyframe& newest = map->keyframe(window_.back());
  if (!newest_covariance_) return;
  const Mat6 adjoint = AdjointSe3(newest.camera_from_world * base_from_world_.Inverse());
  newest.covariance = *newest_covariance_ + adjoint * base_covariance_ * adjoint.transpose();
  const Mat3 world_from_camera = newest.camera_from_world.rotation.toRotationMatrix().transpose();
  position_covariance_ = world_from_camera * newest.covariance.bottomRightCorner<3, 3>() *
                         world_from_camera.transpose();
}

// The oldest keyframe leaves: everything that speaks of it goes into the prior.
void WindowAdjuster::Leave(Map* map, NavAid* nav) noexcept {
  CountOutliers(*map, nav);  // while the positions' gate is as it was for this window
  // A first estimate that nothing depends on yet is taken anew.
  for (int i = 0; i < prior_.num_keyframes(); ++i)
    if (prior_.information.Block(i, i).isZero(0.0))
      prior_.first_estimates[Count(i)] =
          map->keyframe(prior_keyframes_[Count(i)]).camera_from_world;
  if (!AddKeyframes(*map)) return;
  AddLeavingLandmarks(map);
  AddGauge(0);
  if (nav != nullptr) {
    AddNav(*map, *nav, 0);
    AddDisplacement(*map, *nav, 1);
    AddAltitude(*map, *nav, 0);
  }
  if (!ba_.Marginalise(std::span(&camera_, 1), kImageLoss, 1, &prior_)) return;
  const Keyframe& gone = map->keyframe(window_[0]);
  const Keyframe& first = map->keyframe(window_[1]);
  prior_keyframes_.clear();
  for (std::size_t k = 1; k < window_.size(); ++k) prior_keyframes_.TryPushBack(window_[k]);
  first_id_ = first.id;
  positions_from_ = (gone.utime + first.utime) / 2;
  const double seconds = SecondsFromUs(first.utime - gone.utime);
  if (nav != nullptr) {
    prior_.AddNoise(seconds * DriftVariances(options_));
    nav->buffer().SetHorizon(gone.utime);
  }
  has_left_ = has_left_before_ = true;
}

}  // namespace rsfm
