// How a mapper's world begins, gets its scale and place, and ends.
#include <numbers>

#include "rsfm/mapping/incremental_mapper.h"
#include "rsfm/mapping/metric_scale.h"

namespace rsfm {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

}  // namespace

bool IncrementalMapper::Initialise(SlotId keyframe) noexcept {
  if (!has_world()) report_.state = has_seen_ ? MapperState::kInitialising : MapperState::kWaiting;
  if (!keyframe.valid()) return false;
  CollectKeyframes(false, options_.match_keyframes + options_.relocalise_keyframes, keyframe);
  const FrameView view{map_.features(keyframe), map_.descriptors(keyframe)};
  placer_.MatchWith(map_, view, candidates_.span());
  const auto pair = initialiser_.FindPair(map_, keyframe, placer_.matches(), nav_);
  if (!pair) return false;
  PlacePair(*pair);
  Grow(keyframe);
  return true;
}

// Gives the first two keyframes of a map their poses. After a loss that navigation bridges they go
// where it says; otherwise the old map ends and a new world begins: a jump.
void IncrementalMapper::PlacePair(const InitialPair& pair) noexcept {
  Keyframe& first = map_.keyframe(pair.first);
  Keyframe& second = map_.keyframe(pair.second);
  Mat6 covariance = Mat6::Zero();
  std::optional<Rigid3> start;
  if (has_world()) {
    const auto bridged = pair.is_metric ? Predict(first.utime) : std::nullopt;
    if (bridged) {
      start = bridged->camera_from_world;
      covariance = bridged->covariance;
    } else {
      BeginWorld();
      ForgetPlaced();
      adjuster_.Reset();
    }
  }
  if (!start) {
    report_.scale_is_metric = pair.is_metric;
    // Navigation may have come later than the first image.
    if (!first.nav.Has(NavField::kAttitude)) first.nav = nav_.buffer().At(first.utime);
    start = nav_.CameraFromNed(first.nav);
    report_.world_is_ned = start.has_value() && pair.is_metric;
    if (!report_.world_is_ned) start = Rigid3();
    if (report_.world_is_ned)
      covariance = nav_.CovarianceFromNed(first.nav, kRadPerDeg * options_.heading_bias_sigma_deg);
    has_position_ = report_.world_is_ned && first.nav.Has(NavField::kPosition);
  }
  first.camera_from_world = *start;
  first.covariance = covariance;
  second.camera_from_world = pair.second_from_first * first.camera_from_world;
  const Mat6 adjoint = AdjointSe3(pair.second_from_first);
  second.covariance = adjoint * first.covariance * adjoint.transpose() + pair.covariance;
  first.is_placed = second.is_placed = true;
  first.world = second.world = report_.world;
  report_.placed_late.TryPushBack(pair.first);
  Accept({second.camera_from_world, second.covariance, pair.num_inliers, {}}, pair.second);
  placer_.ClearLandmarks();
}

// Ends the map: what was placed goes; what waits stays and may be placed in the next.
void IncrementalMapper::ForgetPlaced() noexcept {
  CollectKeyframes(true, static_cast<int>(map_.keyframes().size()), {});
  for (const SlotId id : candidates_) map_.EraseKeyframe(id);
}

// A world without scale or place gets them from navigation as soon as that has them: a jump, which
// is announced.
void IncrementalMapper::FindWorld(SlotId keyframe) noexcept {
  if (!report_.world_is_ned) {
    const auto world = FindMetricWorld(map_, nav_);
    if (!world) return;
    MoveTo(*world, &map_);
    adjuster_.Reset(world->sigma_scale / world->scale);
    report_.scale_is_metric = report_.world_is_ned = true;
    has_position_ = world->has_position;
  } else if (!has_position_) {
    constexpr Utime kReach = 300000;
    const auto fix = nav_.PositionFactor(0, last_utime_, last_utime_ - kReach, last_utime_ + kReach,
                                         Vec3::Zero());
    if (!fix) return;
    const CarriedBody body(nav_.body_from_camera(), map_.keyframe(keyframe).camera_from_world);
    Vec3 by_m = fix->measured_m - body.position;
    Vec3 sigma_m = fix->sqrt_information.diagonal().cwiseInverse();
    if (nav_.buffer().At(last_utime_).Has(NavField::kDepth)) by_m.z() = sigma_m.z() = 0.0;
    Translate(by_m, sigma_m, &map_);
    adjuster_.Translate(by_m, sigma_m);
    has_position_ = true;
  } else {
    return;
  }
  BeginWorld();
  for (const SlotId id : map_.keyframes()) map_.keyframe(id).world = report_.world;
  TakeNewest(keyframe);
}

void IncrementalMapper::SetClockBack(Utime utime) noexcept {
  BeginWorld();
  map_.Clear();
  placer_.ClearLandmarks();
  adjuster_.Reset();
  to_be_adjusted_ = {};
  ForgetEvents();
  nav_.buffer().SetClockBack(utime);
  report_.state = has_seen_ ? MapperState::kInitialising : MapperState::kWaiting;
  report_.scale_is_metric = report_.world_is_ned = false;
  has_world_ = has_position_ = false;
  frames_lost_ = 0;
  last_utime_ = kNoFrame;
}

// Whatever was said before is of another world.
void IncrementalMapper::BeginWorld() noexcept {
  report_.world = ++report_.reset_counter;
  jumps_.BeginWorld();
  loops_.Clear();
  way_.placed.utime = way_.placed_before.utime = kNoFrame;
}

}  // namespace rsfm
