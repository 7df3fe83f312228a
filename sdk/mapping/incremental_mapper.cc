#include "rsfm/mapping/incremental_mapper.h"

#include <algorithm>
#include <cmath>

#include "rsfm/mapping/metric_scale.h"
#include "rsfm/refraction/sea_water.h"

namespace rsfm {
namespace {

constexpr int kWaitingPerStep = 2;    // keyframes without pose tried again after each new one
constexpr int kMinSimilarity = 12;    // of its strongest features, for such a try
constexpr int kPlentyOfInliers = 80;  // below, older keyframes are asked as well
constexpr double kFloor_m = 0.02, kFloor_rad = 0.005;  // smaller jumps are none for anybody

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

}  // namespace

std::string_view ToString(MapperState state) noexcept {
  constexpr std::string_view kNames[] = {"waiting",        "initialising", "tracking",
                                         "dead_reckoning", "relocalising", "lost"};
  return kNames[static_cast<int>(state)];
}

std::size_t MemoryPlan::total() const {
  std::size_t sum = 0;
  for (const Item& item : items) sum += item.bytes;
  return sum;
}

Expected<std::unique_ptr<IncrementalMapper>> IncrementalMapper::Create(
    const MapperOptions& options, const AnyCamera& camera, const Rigid3& body_from_camera,
    const LoopOptions& loops) {
  if (const Status status = options.Validate(); !status) return tl::unexpected(status.error());
  auto nav = NavAid::Create(options, body_from_camera);
  if (!nav) return tl::unexpected(nav.error());
  auto adjuster = WindowAdjuster::Create(options, camera);
  if (!adjuster) return tl::unexpected(adjuster.error());
  return std::unique_ptr<IncrementalMapper>(
      new IncrementalMapper(options, camera, std::move(*nav), std::move(*adjuster), loops));
}

IncrementalMapper::IncrementalMapper(const MapperOptions& options, const AnyCamera& camera,
                                     NavAid nav, WindowAdjuster adjuster, const LoopOptions& loops)
    : options_(options),
      camera_(camera),
      nav_(std::move(nav)),
      map_(options),
      placer_(options, camera),
      initialiser_(options, camera),
      grower_(options, camera),
      adjuster_(std::move(adjuster)),
      loops_(options, loops, camera),
      candidates_(Count(options.max_keyframes)) {
  water_.index = camera.config().port.index_water;
}

MemoryPlan IncrementalMapper::memory_plan() const {
  MemoryPlan plan;
  plan.items.TryPushBack({"keyframes", map_.keyframe_bytes()});
  plan.items.TryPushBack({"landmarks", map_.landmark_bytes()});
  plan.items.TryPushBack({"matching and placing", placer_.bytes()});
  plan.items.TryPushBack({"two views", initialiser_.bytes()});
  plan.items.TryPushBack({"triangulation", grower_.bytes()});
  plan.items.TryPushBack({"window adjustment", adjuster_.bytes()});
  plan.items.TryPushBack({"places and loops", loops_.bytes()});
  plan.items.TryPushBack({"navigation", nav_.bytes()});
  return plan;
}

Expected<StepReport> IncrementalMapper::Step(const FrameObservations& frame) noexcept {
  if (const Status status = Check(frame); !status) return tl::unexpected(status.error());
  BeginReport(frame.utime);
  FollowWater(frame.utime);
  has_seen_ |= !frame.features.empty();
  const SlotId keyframe = StoreKeyframe(frame);
  if (!has_world()) {
    Initialise(keyframe);
  } else {
    Continue(frame, keyframe);
  }
  AnnounceJump();
  return report_;
}

void IncrementalMapper::Continue(const FrameObservations& frame, SlotId keyframe) noexcept {
  const FrameView view{frame.features, frame.descriptors};
  if (const auto placement = PlaceFrame(view, keyframe)) {
    Accept(*placement, keyframe);
    if (keyframe.valid()) {
      Extend(keyframe);
      AdjustWindow(keyframe);
      PlaceWaiting(keyframe);
    }
  } else {
    CoastOn(frame.utime);
    if (frames_lost_ >= FramesBeforeRestart()) Initialise(keyframe);
  }
}

Status IncrementalMapper::Check(const FrameObservations& frame) const noexcept {
  if (frame_count_ > 0 && frame.utime <= last_utime_) return Fail(Errc::kOutOfOrder, "utime");
  const DescriptorView& descriptors = frame.descriptors;
  if (descriptors.count > 0 && (descriptors.type != options_.descriptor ||
                                Count(descriptors.count) != frame.features.size()))
    return Fail(Errc::kInvalidArgument, "descriptors");
  if (frame.features.size() > Count(options_.max_features))
    return Fail(Errc::kOutOfCapacity, "features", options_.max_features);
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    if (!frame.features[i].pixel().allFinite())
      return Fail(Errc::kInvalidArgument, "features", static_cast<std::int32_t>(i));
  }
  return {};
}

void IncrementalMapper::BeginReport(Utime utime) noexcept {
  StepReport next;
  next.state = report_.state;
  next.reset_counter = report_.reset_counter;
  next.world = report_.world;
  next.scale_is_metric = report_.scale_is_metric;
  next.world_is_ned = report_.world_is_ned;
  report_ = next;
  has_jumped_ = false;
  last_utime_ = utime;
  ++frame_count_;
}

// The camera in the water as it was last measured. Earlier keyframes are from now on seen through
// the new water too: a step of the index moves their observations by less than their noise.
void IncrementalMapper::FollowWater(Utime utime) noexcept {
  CameraConfig config = camera_.config();
  if (options_.water_index_step <= 0.0 || config.port.type == PortType::kNone) return;
  const NavSample measured = nav_.buffer().WaterAt(utime);
  if (!measured.Has(NavField::kWater)) return;
  WaterInUse water;
  water.is_measured = true;
  water.temperature_c = measured.temperature_c;
  water.salinity_psu = measured.salinity_psu;
  water.depth_m = measured.Has(NavField::kDepth) ? std::max(measured.depth_m, 0.0) : 0.0;
  const auto index = SeaWaterIndex(
      {water.temperature_c, water.salinity_psu, water.depth_m, options_.light_wavelength_nm});
  if (!index) return;  // a measurement outside the sea's range
  water.index = config.port.index_air * *index;
  if (!(std::abs(water.index - water_.index) >= options_.water_index_step)) return;
  config.port.index_water = water.index;
  const auto camera = AnyCamera::Create(config);
  if (!camera) return;
  water_ = water;
  camera_ = *camera;
  placer_.SetCamera(*camera);
  initialiser_.SetCamera(*camera);
  grower_.SetCamera(*camera);
  adjuster_.SetCamera(*camera);
  loops_.SetCamera(*camera);
}

// A frame with descriptors becomes a keyframe, without pose to begin with.
SlotId IncrementalMapper::StoreKeyframe(const FrameObservations& frame) noexcept {
  if (frame.descriptors.count == 0) return {};
  Evict();
  Keyframe keyframe;
  keyframe.id = next_keyframe_id_;
  keyframe.nav = nav_.buffer().At(frame.utime);
  keyframe.world = report_.world;
  const std::optional<SlotId> id = map_.AddKeyframe(frame, keyframe);
  if (!id) return {};
  ++next_keyframe_id_;
  return report_.keyframe = *id;
}

// Room for one more: the oldest keyframe goes, with or without pose, but for those that the window
// still works with. A long outage fills the map with keyframes that wait; what they wait for stays.
void IncrementalMapper::Evict() noexcept {
  if (map_.keyframes().size() < map_.keyframe_capacity()) return;
  for (const SlotId id : map_.keyframes()) {
    if (adjuster_.Holds(id)) continue;
    map_.EraseKeyframe(id);
    return;
  }
  map_.EraseKeyframe(map_.keyframes().front());
}

// The newest `count` keyframes that have, or have not, a pose: newest first.
void IncrementalMapper::CollectKeyframes(bool placed, int count, SlotId except) noexcept {
  candidates_.clear();
  const std::span<const SlotId> keyframes = map_.keyframes();
  for (std::size_t i = keyframes.size(); i-- > 0 && candidates_.size() < Count(count);) {
    if (keyframes[i] != except && map_.keyframe(keyframes[i]).is_placed == placed)
      candidates_.TryPushBack(keyframes[i]);
  }
}

// Whether a pose may be true, given what navigation says has happened since the last placed frame.
bool IncrementalMapper::IsPlausible(const Placement& placement) const noexcept {
  const std::optional<KnownPose> predicted = Predict(last_utime_);
  if (!predicted) return true;
  const Vec3 at = predicted->camera_from_world.OriginOfTarget();
  const Vec3 miss = placement.camera_from_world.OriginOfTarget() - at;
  const double moved = (at - base_.camera_from_world.OriginOfTarget()).norm();
  const double angle =
      AngleBetween(placement.camera_from_world.rotation, predicted->camera_from_world.rotation);
  const double sigma_m = std::sqrt(predicted->covariance.bottomRightCorner<3, 3>().trace());
  const double sigma_rad = std::sqrt(predicted->covariance.topLeftCorner<3, 3>().trace());
  return miss.norm() < 0.1 + 0.1 * moved + 6.0 * sigma_m && angle < 0.05 + 6.0 * sigma_rad;
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

void IncrementalMapper::Accept(const Placement& placement, SlotId keyframe) noexcept {
  report_.state = MapperState::kTracking;
  report_.has_pose = true;
  report_.camera_from_world = placement.camera_from_world;
  report_.num_inliers = placement.num_inliers;
  report_.covariance = placement.covariance;
  if (placement.reference.valid()) {
    const Keyframe& reference = map_.keyframe(placement.reference);
    const Mat6 adjoint =
        AdjointSe3(placement.camera_from_world * reference.camera_from_world.Inverse());
    report_.covariance += adjoint * reference.covariance * adjoint.transpose();
  }
  if (keyframe.valid()) {
    Keyframe& placed = map_.keyframe(keyframe);
    placed.is_placed = true;
    placed.camera_from_world = report_.camera_from_world;
    placed.covariance = report_.covariance;
  }
  has_world_ = true;
  frames_lost_ = 0;
  base_ = next_base_ = {last_utime_, report_.camera_from_world, report_.covariance};
}

void IncrementalMapper::Extend(SlotId keyframe) noexcept {
  const GrowReport grown = grower_.Grow(&map_, keyframe, placer_.landmark_of(), placer_.matches());
  report_.num_observed += grown.num_observed;
  report_.num_merged += grown.num_merged;
  report_.num_triangulated += grown.num_triangulated;
}

void IncrementalMapper::AdjustWindow(SlotId keyframe) noexcept {
  FindWorld(keyframe);
  NavAid* nav = report_.world_is_ned ? &nav_ : nullptr;
  const auto adjusted = adjuster_.Adjust(&map_, nav);
  if (!adjusted) return;
  report_.window_error_px = adjusted->mean_error_px;
  report_.num_culled += grower_.Cull(&map_, adjuster_.window());
  TakeNewest(keyframe);
  if (!adjuster_.has_left()) return;
  report_.left_window = adjuster_.window().front();
  CloseLoop(report_.left_window);
}

// The keyframe that has left the window is the next of the way. Where it closes a loop, the map
// moves: keyframes as the way does, the window as one with its oldest.
void IncrementalMapper::CloseLoop(SlotId left) noexcept {
  constexpr double kUnnoticed_m = 0.005, kUnnoticed_rad = 0.001;
  const std::int32_t left_id = map_.keyframe(left).id;
  const Vec3 left_at = map_.keyframe(left).camera_from_world.OriginOfTarget();
  if (!loops_.Add(map_, left, report_.world_is_ned)) return;
  Rigid3 moved = loops_.Correction(left_id);
  if (report_.world_is_ned) {  // attitude and gravity stay
    const Quat turn = ExpSo3(Vec3(0.0, 0.0, LogSo3(moved.rotation).z()));
    moved = {turn, moved * left_at - turn * left_at};
  }
  const auto correction = [&](std::int32_t id) {
    return id < left_id ? loops_.Correction(id) : moved;
  };
  map_.landmarks().ForEach([&](SlotId, Landmark& landmark) {
    if (landmark.observations.empty()) return;
    const Keyframe& newest = map_.keyframe(landmark.observations.back().keyframe);
    landmark.point_in_world = correction(newest.id) * landmark.point_in_world;
    landmark.is_changed = true;
  });
  for (const SlotId id : map_.keyframes()) {
    Keyframe& keyframe = map_.keyframe(id);
    if (keyframe.is_placed)
      keyframe.camera_from_world = keyframe.camera_from_world * correction(keyframe.id).Inverse();
  }
  adjuster_.Move(moved);
  const Vec3 was_at = report_.camera_from_world.OriginOfTarget();
  report_.camera_from_world = report_.camera_from_world * moved.Inverse();
  base_.camera_from_world = next_base_.camera_from_world = report_.camera_from_world;
  has_jumped_ = (report_.camera_from_world.OriginOfTarget() - was_at).norm() > kUnnoticed_m ||
                LogSo3(moved.rotation).norm() > kUnnoticed_rad;
}

// The keyframe's pose is the frame's.
void IncrementalMapper::TakeNewest(SlotId keyframe) noexcept {
  const Keyframe& newest = map_.keyframe(keyframe);
  report_.camera_from_world = newest.camera_from_world;
  report_.covariance = newest.covariance;
  base_ = next_base_ = {last_utime_, report_.camera_from_world, report_.covariance};
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

// Whatever was said before is of another world.
void IncrementalMapper::BeginWorld() noexcept {
  report_.world = ++report_.reset_counter;
  has_published_ = false;
  loops_.Clear();
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
    if (!placement) continue;
    Keyframe& keyframe = map_.keyframe(id);
    keyframe.is_placed = true;
    keyframe.camera_from_world = placement->camera_from_world;
    keyframe.covariance = placement->covariance + map_.keyframe(newest).covariance;
    keyframe.world = report_.world;
    Extend(id);
    report_.placed_late.TryPushBack(id);
  }
}

// Takes out of a displacement what the window knows of the log's scale and mounting, and adds how
// well it knows them: nav_factor.h's (D + B m) / (1 + s), to first order in s, for a body that does
// not turn far.
void IncrementalMapper::CorrectVelocity(CameraMotion* motion) const noexcept {
  const NavStates& states = adjuster_.nav_states();
  const Mat6& covariance = adjuster_.nav_state_covariance();
  const Mat3 camera_from_body = nav_.body_from_camera().rotation.conjugate().toRotationMatrix();
  Vec3& moved = motion->start_from_end.translation;
  const Vec3 misalignment = camera_from_body * states.segment<3>(kMisalignment);
  moved = (1.0 - states[kVelocityScale]) * (moved + moved.cross(misalignment));
  const Mat3 lever = Hat(moved) * camera_from_body;
  motion->displacement_covariance_m2 +=
      covariance(kVelocityScale, kVelocityScale) * moved * moved.transpose() +
      lever * covariance.block<3, 3>(kMisalignment, kMisalignment) * lever.transpose();
}

// A known pose moved on by navigation, where there is navigation.
std::optional<IncrementalMapper::KnownPose> IncrementalMapper::MoveOn(const KnownPose& from,
                                                                      Utime utime) const noexcept {
  if (!report_.scale_is_metric) return std::nullopt;
  auto motion = nav_.Motion(from.utime, utime);
  if (!motion) return std::nullopt;
  CorrectVelocity(&*motion);
  const Rigid3 end_from_start = motion->start_from_end.Inverse();
  const Mat6 adjoint = AdjointSe3(end_from_start);
  Mat6 moved = Mat6::Zero();
  moved.topLeftCorner<3, 3>() = motion->rotation_covariance_rad2;
  const Mat3 rotation = end_from_start.rotation.toRotationMatrix();
  moved.bottomRightCorner<3, 3>() =
      rotation * motion->displacement_covariance_m2 * rotation.transpose();
  return KnownPose{utime, end_from_start * from.camera_from_world,
                   adjoint * from.covariance * adjoint.transpose() + moved};
}

// Navigation's pose since the last placed frame.
std::optional<IncrementalMapper::KnownPose> IncrementalMapper::Predict(Utime utime) const noexcept {
  return MoveOn(base_, utime);
}

// A pose that is not where the one before it and navigation put it, by their covariance, is a jump,
// and so is every correction by a loop.
void IncrementalMapper::AnnounceJump() noexcept {
  constexpr double kSigmas = 3.0;
  if (!report_.has_pose) return;
  if (has_jumped_) {
    ++report_.reset_counter;
    has_jumped_ = false;
  } else if (has_published_) {
    if (const auto expected = MoveOn(published_, last_utime_)) {
      const Rigid3 jump = report_.camera_from_world * expected->camera_from_world.Inverse();
      const auto is_over = [](const Vec3& by, const Mat3& covariance, double floor) {
        const Mat3 floored = covariance + floor * floor * Mat3::Identity();
        return by.dot(floored.inverse() * by) > kSigmas * kSigmas;
      };
      const Mat6& covariance = expected->covariance;
      if (is_over(LogSo3(jump.rotation), covariance.topLeftCorner<3, 3>(), kFloor_rad) ||
          is_over(jump.translation, covariance.bottomRightCorner<3, 3>(), kFloor_m))
        ++report_.reset_counter;
    }
  }
  published_ = {last_utime_, report_.camera_from_world, report_.covariance};
  has_published_ = true;
}

void IncrementalMapper::CoastOn(Utime utime) noexcept {
  constexpr Utime kRebaseUs = 20'000'000;  // navigation keeps at least twice as much
  ++frames_lost_;
  if (const auto predicted = Predict(utime)) {
    report_.state = MapperState::kDeadReckoning;
    report_.has_pose = true;
    report_.camera_from_world = predicted->camera_from_world;
    report_.covariance = predicted->covariance;
    if (utime - next_base_.utime >= kRebaseUs) {
      if (next_base_.utime > base_.utime) base_ = next_base_;
      next_base_ = *predicted;
    }
    return;
  }
  report_.state = frames_lost_ < options_.lost_frames_before_restart ? MapperState::kRelocalising
                                                                     : MapperState::kLost;
}

// Where navigation bridges the loss a new pair goes on in the same world, at once: there is no jump
// in it. Otherwise a new pair ends the map, and is not to be taken lightly.
int IncrementalMapper::FramesBeforeRestart() const noexcept {
  return report_.state == MapperState::kDeadReckoning ? 2 : options_.lost_frames_before_restart;
}

bool IncrementalMapper::Initialise(SlotId keyframe) noexcept {
  if (!has_world()) report_.state = has_seen_ ? MapperState::kInitialising : MapperState::kWaiting;
  if (!keyframe.valid()) return false;
  CollectKeyframes(false, options_.match_keyframes + options_.relocalise_keyframes, keyframe);
  const FrameView view{map_.features(keyframe), map_.descriptors(keyframe)};
  placer_.MatchWith(map_, view, candidates_.span());
  const auto pair = initialiser_.FindPair(map_, keyframe, placer_.matches(), nav_);
  if (!pair) return false;
  PlacePair(*pair);
  Extend(keyframe);
  AdjustWindow(keyframe);
  PlaceWaiting(keyframe);
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

BodyPose ToBodyPose(const Rigid3& camera_from_world, const Mat6& covariance,
                    const Rigid3& body_from_camera) noexcept {
  BodyPose result;
  const Rigid3 world_from_camera = camera_from_world.Inverse();
  result.world_from_body = world_from_camera * body_from_camera.Inverse();
  // C' = Exp(d) C makes W' = C'^-1 B^-1 = Exp(-Adjoint(C^-1) d) W.
  const Mat6 left =
      AdjointSe3(world_from_camera) * covariance * AdjointSe3(world_from_camera).transpose();
  // (rotation, translation) of a left perturbation moves the position p by translation - [p]x
  // rotation.
  Mat6 position_rotation = Mat6::Zero();
  position_rotation.topLeftCorner<3, 3>() = -Hat(result.world_from_body.translation);
  position_rotation.topRightCorner<3, 3>() = Mat3::Identity();
  position_rotation.bottomLeftCorner<3, 3>() = Mat3::Identity();
  result.covariance = position_rotation * left * position_rotation.transpose();
  return result;
}

}  // namespace rsfm
