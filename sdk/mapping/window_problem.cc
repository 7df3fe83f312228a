// What WindowAdjuster puts into one adjustment: keyframes, landmarks, navigation.
#include <algorithm>
#include <cmath>

#include "rsfm/estimation/reprojection_residual.h"
#include "rsfm/mapping/window_adjuster.h"

namespace rsfm {
namespace {

constexpr double kMaxNeighbour_s = 4.0;     // keyframes farther apart do not say how fast it goes
constexpr double kMaxFromKeyframe_s = 1.0;  // a position farther from any keyframe is not used
constexpr int kMinShared = 8;               // landmarks that tie two keyframes together
constexpr double kGate = 16.27;             // chi-square, three degrees of freedom, 0.1 %
constexpr int kMaxGatedInRow = 5;           // then it is not the positions that are wrong

std::size_t Count(int value) { return static_cast<std::size_t>(std::max(value, 0)); }

}  // namespace

void WindowAdjuster::MeasureMotion(const Map& map, const NavAid* nav) noexcept {
  motions_.clear();
  for (std::size_t k = 0; k < window_.size(); ++k) {
    Motion motion;
    const Keyframe& before = map.keyframe(window_[k > 0 ? k - 1 : k]);
    const Keyframe& after = map.keyframe(window_[std::min(k + 1, window_.size() - 1)]);
    const double seconds = SecondsFromUs(after.utime - before.utime);
    if (nav != nullptr && seconds > 0.0 && seconds < kMaxNeighbour_s) {
      const CarriedBody a(nav->body_from_camera(), before.camera_from_world);
      const CarriedBody b(nav->body_from_camera(), after.camera_from_world);
      motion.velocity_mps = (b.position - a.position) / seconds;
      motion.rate_radps = LogSo3(Quat(b.world_from_body * a.world_from_body.transpose())) / seconds;
    }
    motions_.TryPushBack(motion);
  }
}

Status WindowAdjuster::AddKeyframes(const Map& map) noexcept {
  ba_.Clear();
  landmarks_.clear();
  std::fill(index_of_.begin(), index_of_.end(), -1);
  std::fill(landmark_index_.begin(), landmark_index_.end(), -1);
  anchor_ = {};
  num_anchored_ = num_anchors_ = 0;
  prior_index_.clear();
  for (std::size_t k = 0; k < window_.size(); ++k) {
    if (Holds(window_[k])) prior_index_.TryPushBack(static_cast<int>(k));
    const auto index = ba_.AddKeyframe(map.keyframe(window_[k]).camera_from_world);
    if (!index) return tl::unexpected(index.error());
    index_of_[window_[k].index] = *index;
  }
  return ba_.SetMarginalPrior(prior_, prior_index_.span(), states_);
}

// Out of sight for window_keyframes keyframes or more before the window: what saw it earlier holds
// the window in place. Otherwise those are neighbours that the prior has taken the place of.
bool WindowAdjuster::IsRevisited(const Map& map, const Landmark& landmark) const noexcept {
  const std::int32_t first = map.keyframe(window_[0]).id;
  return std::none_of(landmark.observations.begin(), landmark.observations.end(),
                      [&](const Observation& o) {
                        const std::int32_t id = map.keyframe(o.keyframe).id;
                        return id < first && id >= first - options_.window_keyframes;
                      });
}

// Whether an observation counts: in the window and not summed up in the prior, or an old one of a
// landmark that is revisited.
WindowAdjuster::Use WindowAdjuster::UseOf(const Map& map, const Landmark& landmark,
                                          const Observation& o, bool is_revisited) const noexcept {
  const Keyframe& keyframe = map.keyframe(o.keyframe);
  if (!keyframe.is_placed) return Use::kNone;
  const std::int32_t first = map.keyframe(window_[0]).id;
  if (keyframe.id < first) return is_revisited ? Use::kAnchor : Use::kNone;
  return keyframe.id >= landmark.fresh_from && index_of_[o.keyframe.index] >= 0 ? Use::kFree
                                                                                : Use::kNone;
}

// The keyframe's index in the problem; an old one joins it as fixed. -1 where that is full.
int WindowAdjuster::IndexInBa(const Map& map, const Observation& o, Use use) noexcept {
  int& index = index_of_[o.keyframe.index];
  if (use == Use::kFree) return index;
  if (index < 0) {
    if (num_anchors_ >= kMaxAnchors) return -1;
    const auto added = ba_.AddKeyframe(map.keyframe(o.keyframe).camera_from_world, 0, true);
    if (!added) return -1;
    ++num_anchors_;
    index = *added;
    if (!anchor_.valid() || map.keyframe(anchor_).id < map.keyframe(o.keyframe).id)
      anchor_ = o.keyframe;
  }
  ++num_anchored_;
  return index;
}

int WindowAdjuster::CountUsable(const Map& map, const Landmark& landmark) const noexcept {
  const bool is_revisited = IsRevisited(map, landmark);
  return static_cast<int>(std::count_if(
      landmark.observations.begin(), landmark.observations.end(),
      [&](const Observation& o) { return UseOf(map, landmark, o, is_revisited) != Use::kNone; }));
}

bool WindowAdjuster::AddLandmark(const Map& map, SlotId id, bool must_fit) noexcept {
  const Landmark& landmark = *map.landmarks().Find(id);
  if (landmarks_.full()) return false;
  const auto index = ba_.AddLandmark(landmark.point_in_world);
  if (!index) return false;
  landmark_index_[id.index] = *index;
  landmarks_.TryPushBack(id);
  const bool is_revisited = IsRevisited(map, landmark);
  for (const Observation& o : landmark.observations) {
    const Use use = UseOf(map, landmark, o, is_revisited);
    if (use == Use::kNone) continue;
    const Vec2 pixel = map.features(o.keyframe)[Count(o.feature)].pixel();
    if (must_fit) {
      Vec2 error;
      const Projection status =
          ReprojectionError(camera_, map.keyframe(o.keyframe).camera_from_world,
                            landmark.point_in_world, pixel, &error);
      if (status != Projection::kOk || error.norm() > options_.max_error_px) continue;
    }
    const int keyframe = IndexInBa(map, o, use);
    if (keyframe < 0) continue;
    if (!ba_.AddObservation(keyframe, *index, pixel, options_.pixel_sigma)) return false;
  }
  return true;
}

// Newest keyframe first, so that what is seen now is in when the capacity ends.
void WindowAdjuster::AddLandmarks(const Map& map, int min_observations) noexcept {
  for (std::size_t k = window_.size(); k-- > 0;) {
    for (const SlotId id : map.landmarks_of(window_[k])) {
      const Landmark* landmark = map.landmarks().Find(id);
      if (landmark == nullptr || landmark_index_[id.index] >= 0) continue;
      if (CountUsable(map, *landmark) < min_observations) continue;
      if (!AddLandmark(map, id, false)) return;
    }
  }
}

// Of the oldest keyframe, those that the newest two no longer see.
void WindowAdjuster::AddLeavingLandmarks(Map* map) noexcept {
  const SlotId newest = window_.back(), before = window_[window_.size() - 2];
  for (const SlotId id : map->landmarks_of(window_[0])) {
    Landmark* landmark = map->landmarks().Find(id);
    if (landmark == nullptr || landmark_index_[id.index] >= 0) continue;
    const bool is_seen =
        std::any_of(landmark->observations.begin(), landmark->observations.end(),
                    [&](const auto& o) { return o.keyframe == newest || o.keyframe == before; });
    if (is_seen || CountUsable(*map, *landmark) < 2) continue;
    if (!AddLandmark(*map, id, true)) return;
    landmark->fresh_from = map->keyframe(newest).id + 1;
  }
}

void WindowAdjuster::AddGauge(int k) noexcept {
  if (window_[Count(k)] != gauge_) return;
  gauge_place_.a = k;
  static_cast<void>(ba_.AddPrior(gauge_place_));
  for (std::size_t i = 0; has_gauge_length_ && i < window_.size(); ++i) {
    if (window_[i] != gauge_second_) continue;
    gauge_length_.a = k;
    gauge_length_.b = static_cast<int>(i);
    static_cast<void>(ba_.AddPrior(gauge_length_));
  }
}

bool WindowAdjuster::AddDisplacement(const Map& map, const NavAid& nav, int k) noexcept {
  const auto factor = nav.DisplacementFactor(k - 1, k, map.keyframe(window_[Count(k - 1)]).utime,
                                             map.keyframe(window_[Count(k)]).utime);
  return factor && ba_.AddNavFactor(*factor).has_value();
}

std::optional<NavFactor> WindowAdjuster::Position(const Map& map, const NavAid& nav,
                                                  int k) const noexcept {
  constexpr Utime kReach = static_cast<Utime>(kMaxFromKeyframe_s * 1e6);
  const auto utime = [&](int i) { return map.keyframe(window_[Count(i)]).utime; };
  Utime begin = utime(k) - kReach, end = utime(k) + kReach;
  begin = std::max(begin, k > 0 ? (utime(k - 1) + utime(k)) / 2 : positions_from_);
  if (k + 1 < static_cast<int>(window_.size())) end = std::min(end, (utime(k) + utime(k + 1)) / 2);
  return nav.PositionFactor(k, utime(k), begin, end, motions_[Count(k)].velocity_mps);
}

// A position that the window contradicts, in the light of both uncertainties.
bool WindowAdjuster::IsGated(const Map& map, const NavFactor& position) const noexcept {
  if (num_gated_in_row_ >= kMaxGatedInRow || !has_left_before_) return false;
  NavFactor in_metres = position;
  in_metres.sqrt_information = Mat3::Identity();
  const Rigid3& pose = map.keyframe(window_[Count(position.a)]).camera_from_world;
  const Vec3 off = EvaluateNavFactor(in_metres, pose, pose, states_).residual;
  const Vec3 sigma = position.sqrt_information.diagonal().cwiseInverse();
  const Mat3 covariance = position_covariance_ + Mat3(sigma.cwiseAbs2().asDiagonal());
  return off.dot(covariance.inverse() * off) > kGate;
}

void WindowAdjuster::AddNav(const Map& map, const NavAid& nav, int k) noexcept {
  const NavSample sample = nav.buffer().At(map.keyframe(window_[Count(k)]).utime);
  const Motion& motion = motions_[Count(k)];
  if (const auto f = nav.AttitudeFactor(k, sample, motion.rate_radps))
    static_cast<void>(ba_.AddNavFactor(*f));
  if (const auto f = nav.DepthFactor(k, sample, motion.velocity_mps))
    static_cast<void>(ba_.AddNavFactor(*f));
  const auto position = Position(map, nav, k);
  if (position && !IsGated(map, *position)) static_cast<void>(ba_.AddNavFactor(*position));
}

// The range to the bottom goes to the landmarks nearest to the vertical below the body. What lies
// there is not what the beam measured: that error is a part of the range and, where a velocity
// gives the scale, not to be taken for noise that many pings would beat.
void WindowAdjuster::AddAltitude(const Map& map, const NavAid& nav, int k) noexcept {
  constexpr std::size_t kLandmarks = 3;
  constexpr double kMaxAside = 0.3, kPart = 0.03, kPartWithVelocity = 0.1, kSlope = 0.2;
  const SlotId id = window_[Count(k)];
  const NavSample sample = nav.buffer().At(map.keyframe(id).utime);
  if (!sample.Has(NavField::kAltitude)) return;
  const CarriedBody body(nav.body_from_camera(), map.keyframe(id).camera_from_world);
  struct Below {
    int landmark = -1;
    double aside_m = 0.0;
  };
  StaticVector<Below, kLandmarks> nearest;  // ascending
  for (const SlotId landmark : map.landmarks_of(id)) {
    const Landmark* point = map.landmarks().Find(landmark);
    if (point == nullptr || landmark_index_[landmark.index] < 0) continue;
    const double aside_m = (point->point_in_world - body.position).head<2>().norm();
    if (aside_m > kMaxAside * sample.altitude_m) continue;
    if (nearest.full() && nearest.back().aside_m <= aside_m) continue;
    if (nearest.full()) nearest.pop_back();
    nearest.TryPushBack({landmark_index_[landmark.index], aside_m});
    for (std::size_t i = nearest.size() - 1; i > 0 && nearest[i].aside_m < nearest[i - 1].aside_m;
         --i)
      std::swap(nearest[i], nearest[i - 1]);
  }
  const double part = sample.Has(NavField::kVelocity) ? kPartWithVelocity : kPart;
  const double sensor_m =
      sample.sigma_altitude_m > 0.0 ? sample.sigma_altitude_m : nav.defaults().sigma_altitude_m;
  for (const Below& below : nearest) {
    const Vec3 sigma(sensor_m, part * sample.altitude_m, kSlope * below.aside_m);
    static_cast<void>(
        ba_.AddAltitude(k, below.landmark, nav.body_from_camera(), sample.altitude_m,
                        std::sqrt(static_cast<double>(nearest.size())) * sigma.norm()));
  }
}

// Displacements between neighbours; where neither those nor landmarks tie a keyframe to the one
// before, where it was put in relation to that, roughly.
void WindowAdjuster::AddLinks(const Map& map, const NavAid* nav) noexcept {
  for (int k = 1; k < static_cast<int>(window_.size()); ++k) {
    if (nav != nullptr && AddDisplacement(map, *nav, k)) continue;
    int num_shared = 0;
    for (const SlotId id : map.landmarks_of(window_[Count(k)])) {
      const Landmark* landmark = map.landmarks().Find(id);
      if (landmark == nullptr || landmark_index_[id.index] < 0) continue;
      num_shared += std::any_of(
          landmark->observations.begin(), landmark->observations.end(), [&](const auto& o) {
            return index_of_[o.keyframe.index] >= 0 &&
                   map.keyframe(o.keyframe).id < map.keyframe(window_[Count(k)]).id;
          });
    }
    if (num_shared >= kMinShared) continue;
    const Rigid3 before_from_this = map.keyframe(window_[Count(k - 1)]).camera_from_world *
                                    map.keyframe(window_[Count(k)]).camera_from_world.Inverse();
    const double distance = before_from_this.translation.norm();
    Mat6 covariance = Mat6::Zero();
    covariance.topLeftCorner<3, 3>() = 4e-4 * Mat3::Identity();
    covariance.bottomRightCorner<3, 3>() = std::pow(0.02 + 0.1 * distance, 2) * Mat3::Identity();
    if (const auto prior = MakeRelativePosePrior(k - 1, k, Rigid3(), before_from_this, covariance))
      static_cast<void>(ba_.AddPrior(*prior));
  }
}

// Of the keyframe that leaves: what disagrees with everything else.
void WindowAdjuster::CountOutliers(const Map& map, const NavAid* nav) noexcept {
  if (nav == nullptr) return;
  constexpr double kOutlier = 5.0;  // sigmas
  const NavSample sample = nav->buffer().At(map.keyframe(window_[0]).utime);
  const Rigid3& pose = map.keyframe(window_[0]).camera_from_world;
  const Rigid3& next = map.keyframe(window_[1]).camera_from_world;
  const auto count = [&](const std::optional<NavFactor>& factor) {
    if (factor)
      num_nav_outliers_ +=
          EvaluateNavFactor(*factor, pose, next, states_).residual.norm() > kOutlier;
  };
  count(nav->AttitudeFactor(0, sample, motions_[0].rate_radps));
  count(nav->DepthFactor(0, sample, motions_[0].velocity_mps));
  count(nav->DisplacementFactor(0, 1, map.keyframe(window_[0]).utime,
                                map.keyframe(window_[1]).utime));
  const auto position = Position(map, *nav, 0);
  if (!position) return;
  const bool is_gated = IsGated(map, *position);
  num_nav_outliers_ += is_gated;
  num_gated_in_row_ = is_gated ? num_gated_in_row_ + 1 : 0;
}

}  // namespace rsfm
