// Where frames are looked for, from the cheapest to the widest search.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "rsfm/mapping/incremental_mapper.h"

namespace rsfm {
namespace {

constexpr int kWaitingPerStep = 2;       // keyframes without pose tried again after each new one
constexpr int kMinSimilarity = 12;       // of its strongest features, for such a try
constexpr int kPlentyOfInliers = 80;     // below, older keyframes are asked as well
constexpr int kMinUnexpected = 25;       // inliers that say where a frame is against nothing else
constexpr double kGate = 6.0;            // sigmas
constexpr double kVelocityFrom_s = 2.0;  // two frames farther apart do not tell a velocity
constexpr double kVelocityWalk = 0.1;  // m/s after a second, of a vehicle that nothing is known of

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

// Of where navigation expects the pose, from `start` on.
bool IsNear(const Rigid3& pose, const KnownPose& expected, const Rigid3& start) {
  const Vec3 at = expected.camera_from_world.OriginOfTarget();
  const double miss_m = (pose.OriginOfTarget() - at).norm();
  const double moved_m = (at - start.OriginOfTarget()).norm();
  const double angle_rad = AngleBetween(pose.rotation, expected.camera_from_world.rotation);
  const auto sigma = [](const Mat3& covariance) {
    return std::sqrt(std::max(covariance.trace(), 0.0));
  };
  const double sigma_m = sigma(expected.covariance.bottomRightCorner<3, 3>());
  const double sigma_rad = sigma(expected.covariance.topLeftCorner<3, 3>());
  return miss_m < 0.1 + 0.1 * moved_m + kGate * sigma_m && angle_rad < 0.05 + kGate * sigma_rad;
}

}  // namespace

// The newest `count` keyframes that have, or have not, a pose: newest first.
void IncrementalMapper::CollectKeyframes(bool placed, int count, SlotId except) noexcept {
  candidates_.clear();
  const std::span<const SlotId> keyframes = map_.keyframes();
  for (std::size_t i = keyframes.size(); i-- > 0 && candidates_.size() < Count(count);) {
    if (keyframes[i] != except && map_.keyframe(keyframes[i]).is_placed == placed)
      candidates_.TryPushBack(keyframes[i]);
  }
}

// Where navigation expects the frame; the covariance is of the motion since the last placed frame
// alone. With what is not known of that frame's own place a bottom that repeats is found metres
// away.
std::optional<KnownPose> IncrementalMapper::PredictMotion() const noexcept {
  std::optional<KnownPose> predicted = Predict(last_utime_);
  if (!predicted) return std::nullopt;
  const Mat6 adjoint =
      AdjointSe3(predicted->camera_from_world * way_.placed.camera_from_world.Inverse());
  predicted->covariance -= adjoint * way_.placed.covariance * adjoint.transpose();
  return predicted;
}

// Where the vehicle may have gone since the last placed frame, when navigation does not say: on as
// it went, its velocity a random walk, in any attitude; and no farther than `max_speed_mps` allows.
//   [Bar-Shalom, Li & Kirubarajan 2001, Estimation with Applications to Tracking and Navigation,
//    6.2.2, white noise acceleration]
std::optional<KnownPose> IncrementalMapper::PredictReach() const noexcept {
  if (!report_.scale_is_metric || options_.max_speed_mps <= 0.0 || way_.placed.utime == kNoFrame)
    return std::nullopt;
  const double gone_s = std::abs(SecondsFromUs(last_utime_ - way_.placed.utime));
  const double reach_m = options_.max_speed_mps * gone_s;
  Vec3 went = Vec3::Zero();
  double variance = std::pow(reach_m / kGate, 2) / 3.0;
  const double before_s = SecondsFromUs(way_.placed.utime - way_.placed_before.utime);
  if (way_.placed_before.utime != kNoFrame && before_s <= kVelocityFrom_s) {
    went = (way_.placed.camera_from_world.OriginOfTarget() -
            way_.placed_before.camera_from_world.OriginOfTarget()) *
           (gone_s / before_s);
    if (went.norm() > reach_m) went *= reach_m / went.norm();
    variance = std::min(variance, kVelocityWalk * kVelocityWalk * std::pow(gone_s, 3) / 3.0);
  }
  constexpr double kAnyTurn = std::numbers::pi / kGate;
  KnownPose reach{last_utime_, way_.placed.camera_from_world, Mat6::Zero()};
  reach.camera_from_world.translation -= reach.camera_from_world.rotation * went;
  reach.covariance.diagonal() << Vec3::Constant(kAnyTurn * kAnyTurn), Vec3::Constant(variance);
  return reach;
}

// Whether a pose may be true, given what navigation says has happened since the last placed frame.
bool IncrementalMapper::IsPlausible(const Placement& placement) const noexcept {
  std::optional<KnownPose> expected = PredictMotion();
  if (!expected) expected = PredictReach();
  return !expected || IsNear(placement.camera_from_world, *expected, way_.placed.camera_from_world);
}

// The same of a keyframe of before, against the frame that has its pose now.
bool IncrementalMapper::LeadsHere(const Placement& placement, Utime utime) const noexcept {
  if (!report_.scale_is_metric) return true;
  const KnownPose start{utime, placement.camera_from_world, Mat6::Zero()};
  const auto expected = MoveOn(start, last_utime_, nav_, nav_errors());
  return !expected || IsNear(report_.camera_from_world, *expected, start.camera_from_world);
}

// From the cheapest to the widest search; the first that finds plenty, else the best there was.
Expected<Placement> IncrementalMapper::PlaceFrame(const FrameView& frame,
                                                  SlotId keyframe) noexcept {
  const std::uint64_t seed = options_.seed + frame_count_;
  Expected<Placement> best = Fail(Errc::kNotEnoughInliers, "inliers");
  bool is_settled = false;  // the placer's associations are those of `best`
  const auto consider = [&](const Expected<Placement>& placement) {
    is_settled = false;
    if (!placement || !IsPlausible(*placement)) return false;
    if (best && best->num_inliers >= placement->num_inliers) return false;
    best = placement;
    is_settled = true;
    return best->num_inliers >= kPlentyOfInliers;
  };
  CollectKeyframes(true, options_.match_keyframes, keyframe);
  placer_.MatchWith(map_, frame, candidates_.span());
  if (consider(placer_.Place(map_, frame, seed)) || frame.descriptors.count == 0) return best;

  if (const auto predicted = Predict(last_utime_)) {
    if (consider(placer_.PlaceNear(map_, frame, predicted->camera_from_world,
                                   options_.guided_radius_px, seed)))
      return best;
  }
  // The newest again, and the most similar of the older.
  const std::size_t num_newest = candidates_.size();
  CollectKeyframes(true, static_cast<int>(map_.keyframes().size()), keyframe);
  const std::span<const SlotId> all = candidates_.span();
  const std::span<const SlotId> similar = placer_.MostSimilar(
      map_, frame, options_.relocalise_keyframes, all.subspan(std::min(num_newest, all.size())));
  std::copy(similar.begin(), similar.end(), candidates_.begin() + num_newest);
  if (!similar.empty()) {
    placer_.MatchWith(map_, frame, all.first(num_newest + similar.size()));
    if (consider(placer_.Place(map_, frame, seed))) return best;
  }
  // Few landmarks: one neighbour's matches, landmarks or not.
  const auto beside = initialiser_.PlaceBeside(map_, frame, last_utime_, placer_.matches(), nav_,
                                               report_.scale_is_metric);
  if (beside && IsPlausible(*beside)) {
    best = beside;
    is_settled = false;
  }
  if (best && !is_settled) placer_.Associate(map_, frame, best->camera_from_world);
  return best;
}

// Roll, pitch and, as far as its bias is known, heading are measured: not every turn may be true.
bool IncrementalMapper::AgreesWithAttitude(const Placement& placement) const noexcept {
  constexpr double kRough_rad = 0.1;
  if (!report_.world_is_ned) return true;
  const auto expected = nav_.CameraFromNed(nav_.buffer().At(last_utime_));
  if (!expected) return true;
  const NavErrors errors = nav_errors();
  const double bias = std::abs(errors.states[kHeadingBias]) +
                      6.0 * std::sqrt(errors.covariance(kHeadingBias, kHeadingBias));
  return AngleBetween(placement.camera_from_world.rotation, expected->rotation) < kRough_rad + bias;
}

// Among the places that have left the map. One that generalised P3P confirms comes back as a
// keyframe, and the frame is placed against it as against any other.
Expected<Placement> IncrementalMapper::Relocalise(const FrameView& frame,
                                                  SlotId keyframe) noexcept {
  const auto failed = Fail(Errc::kNotEnoughInliers, "places");
  if (!keyframe.valid()) return failed;
  const std::uint64_t seed = options_.seed + frame_count_;
  const std::optional<KnownPose> expected = PredictMotion();
  const std::optional<KnownPose> reach = expected ? expected : PredictReach();
  const KnownPose* expected_or_null = expected ? &*expected : nullptr;
  const auto recognised =
      loops_.Recognise(map_, frame, reach ? &*reach : nullptr, expected ? 0 : kMinUnexpected, seed);
  if (!recognised) return failed;
  Evict(keyframe);
  const auto place = loops_.Restore(*recognised, report_.world, &map_);
  if (!place) return failed;
  candidates_.clear();
  candidates_.TryPushBack(*place);
  placer_.MatchWith(map_, frame, candidates_.span());
  const auto placement = placer_.Place(map_, frame, seed);
  const auto may_be_there = [&] {
    if (!reach) return true;
    KnownPose from_place = *reach;
    from_place.covariance.diagonal() += recognised->way_variance;
    return IsNear(placement->camera_from_world, from_place, way_.placed.camera_from_world);
  };
  if (!placement || !may_be_there() || !AgreesWithAttitude(*placement)) {
    placer_.ClearLandmarks();
    map_.EraseKeyframe(*place);
    return failed;
  }
  map_.keyframe(keyframe).camera_from_world = placement->camera_from_world;
  loops_.Anchor(map_, keyframe, *recognised, expected_or_null);
  if (!expected) jumps_.Expect();
  report_.recognised_keyframe = recognised->place.keyframe_id;
  return placement;
}

// Keyframes that had no pose may share landmarks with the newest one.
void IncrementalMapper::PlaceWaiting(SlotId newest) noexcept {
  CollectKeyframes(false, static_cast<int>(map_.keyframes().size()), newest);
  if (candidates_.empty()) return;
  const FrameView view{map_.features(newest), map_.descriptors(newest)};
  const std::span<const SlotId> similar =
      placer_.MostSimilar(map_, view, kWaitingPerStep, candidates_.span());
  StaticVector<SlotId, kWaitingPerStep> waiting;
  for (const SlotId id : similar) waiting.TryPushBack(id);
  for (const SlotId id : waiting) {
    const FrameView old{map_.features(id), map_.descriptors(id)};
    if (placer_.Similarity(old.descriptors, view.descriptors) < kMinSimilarity) continue;
    CollectKeyframes(true, options_.match_keyframes, id);
    placer_.MatchWith(map_, old, candidates_.span());
    const auto placement = placer_.Place(map_, old, options_.seed + frame_count_);
    Keyframe& keyframe = map_.keyframe(id);
    if (!placement || !LeadsHere(*placement, keyframe.utime)) continue;
    keyframe.is_placed = true;
    keyframe.camera_from_world = placement->camera_from_world;
    keyframe.covariance = placement->covariance + map_.keyframe(newest).covariance;
    keyframe.world = report_.world;
    Extend(id);
    report_.placed_late.TryPushBack(id);
  }
}

}  // namespace rsfm
