#include "rsfm/mapping/incremental_mapper.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "rsfm/mapping/loop_correction.h"

namespace rsfm {
namespace {

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
    const MapperOptions& options, const AnyCamera& camera, const Rigid3& body_from_camera) {
  if (const Status status = options.Validate(); !status) return tl::unexpected(status.error());
  auto nav = NavAid::Create(options, body_from_camera);
  if (!nav) return tl::unexpected(nav.error());
  auto adjuster = WindowAdjuster::Create(options, camera);
  if (!adjuster) return tl::unexpected(adjuster.error());
  return std::unique_ptr<IncrementalMapper>(
      new IncrementalMapper(options, camera, std::move(*nav), std::move(*adjuster)));
}

IncrementalMapper::IncrementalMapper(const MapperOptions& options, const AnyCamera& camera,
                                     NavAid nav, WindowAdjuster adjuster)
    : options_(options),
      camera_(camera),
      nav_(std::move(nav)),
      map_(options),
      placer_(options, camera),
      initialiser_(options, camera),
      grower_(options, camera),
      adjuster_(std::move(adjuster)),
      loops_(options, camera),
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
  TakeAdjustment();
  BeginReport(frame.utime);
  way_before_ = way_;
  if (const auto camera = FollowWater(options_, nav_.buffer(), frame.utime, camera_, &water_))
    SetCamera(*camera);
  has_seen_ |= !frame.features.empty();
  const SlotId keyframe = StoreKeyframe(frame);
  if (!has_world()) {
    Initialise(keyframe);
  } else {
    Continue(frame, keyframe);
  }
  if (report_.has_pose) {
    const NavAid* nav = report_.scale_is_metric ? &nav_ : nullptr;
    const KnownPose pose{last_utime_, report_.camera_from_world, report_.covariance};
    report_.reset_counter += jumps_.Publish(pose, nav, nav_errors());
  }
  return HandOutReport();
}

Expected<StepReport> IncrementalMapper::AddKeyframe(const FrameObservations& frame) noexcept {
  const std::span<const SlotId> keyframes = map_.keyframes();
  const bool is_keyframe =
      !keyframes.empty() && map_.keyframe(keyframes.back()).utime == frame.utime;
  if (frame.utime != last_utime_ || report_.state != MapperState::kTracking || is_keyframe)
    return Fail(Errc::kOutOfOrder, "utime");
  if (const Status status = CheckContent(frame); !status) return tl::unexpected(status.error());
  if (frame.descriptors.count == 0) return Fail(Errc::kInvalidArgument, "descriptors");
  const SlotId keyframe = StoreKeyframe(frame);
  if (!keyframe.valid()) return Fail(Errc::kOutOfCapacity, "keyframes");
  const FrameView view{frame.features, frame.descriptors};
  Placement by_tracks = placement_;
  if (!map_.Contains(by_tracks.reference)) by_tracks.reference = {};  // it had to make room
  const Way way = std::exchange(way_, way_before_);
  auto placement = PlaceFrame(view, keyframe);
  if (!placement) {
    way_ = way;
    placer_.Associate(map_, view, by_tracks.camera_from_world);
    placement = by_tracks;
  }
  Accept(*placement, keyframe);
  Grow(keyframe);
  return HandOutReport();
}

// What happens from here on belongs to the next report.
StepReport IncrementalMapper::HandOutReport() noexcept {
  const StepReport report = report_;
  ForgetEvents();
  return report;
}

void IncrementalMapper::ForgetEvents() noexcept {
  report_.keyframe = report_.left_window = {};
  report_.placed_late.clear();
  report_.recognised_keyframe = -1;
  report_.num_observed = report_.num_merged = report_.num_triangulated = report_.num_culled = 0;
  report_.window_error_px = 0.0;
}

StepReport IncrementalMapper::Finish() noexcept {
  TakeAdjustment();
  return HandOutReport();
}

void IncrementalMapper::Continue(const FrameObservations& frame, SlotId keyframe) noexcept {
  const FrameView view{frame.features, frame.descriptors};
  auto placement = PlaceFrame(view, keyframe);
  if (!placement) placement = Relocalise(view, keyframe);
  if (placement) {
    Accept(*placement, keyframe);
    if (keyframe.valid()) Grow(keyframe);
  } else {
    CoastOn(frame.utime);
    if (frames_lost_ >= FramesBeforeRestart()) Initialise(keyframe);
  }
}

Status IncrementalMapper::Check(const FrameObservations& frame) const noexcept {
  if (frame.utime <= last_utime_) return Fail(Errc::kOutOfOrder, "utime");
  return CheckContent(frame);
}

Status IncrementalMapper::CheckContent(const FrameObservations& frame) const noexcept {
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
  report_.has_pose = false;
  report_.camera_from_world = {};
  report_.covariance.setZero();
  report_.num_inliers = 0;
  last_utime_ = utime;
  ++frame_count_;
}

// Earlier keyframes are from now on seen through the new water too: a step of the index moves their
// observations by less than their noise.
void IncrementalMapper::SetCamera(const AnyCamera& camera) noexcept {
  camera_ = camera;
  placer_.SetCamera(camera);
  initialiser_.SetCamera(camera);
  grower_.SetCamera(camera);
  adjuster_.SetCamera(camera);
  loops_.SetCamera(camera);
}

// A frame with descriptors becomes a keyframe, without pose to begin with.
SlotId IncrementalMapper::StoreKeyframe(const FrameObservations& frame) noexcept {
  if (frame.descriptors.count == 0) return {};
  Evict({});
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
// still works with or that the report tells of. A long outage fills the map with keyframes that
// wait; what they wait for stays.
void IncrementalMapper::Evict(SlotId except) noexcept {
  if (map_.keyframes().size() < map_.keyframe_capacity()) return;
  auto& told = report_.placed_late;
  const auto is_told = [&](SlotId id) {
    return id == report_.left_window || std::find(told.begin(), told.end(), id) != told.end();
  };
  for (const SlotId id : map_.keyframes()) {
    if (id == except || adjuster_.Holds(id) || is_told(id)) continue;
    map_.EraseKeyframe(id);
    return;
  }
  // Late ones may make the window longer than the map has room for.
  report_.left_window = {};
  told.clear();
  map_.EraseKeyframe(map_.keyframes().front());
}

void IncrementalMapper::Accept(const Placement& placement, SlotId keyframe) noexcept {
  placement_ = placement;
  report_.state = MapperState::kTracking;
  report_.has_pose = true;
  report_.camera_from_world = placement.camera_from_world;
  report_.num_inliers = placement.num_inliers;
  report_.covariance = placement.covariance;
  if (placement.reference.valid()) {
    // The map is not exact: the noise of the images that its landmarks come from is in them, and
    // comes once more in what the frame is off by against the reference.
    report_.covariance *= 2.0;
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
  KeepPlaced();
}

void IncrementalMapper::KeepPlaced() noexcept {
  if (way_.placed.utime != last_utime_) way_.placed_before = way_.placed;
  way_.placed = way_.base =
      way_.next_base = {last_utime_, report_.camera_from_world, report_.covariance};
}

// A keyframe that was placed adds to the map, and the window to its adjustment.
void IncrementalMapper::Grow(SlotId keyframe) noexcept {
  Extend(keyframe);
  BeginAdjustment(keyframe);
}

void IncrementalMapper::Extend(SlotId keyframe) noexcept {
  const GrowReport grown = grower_.Grow(&map_, keyframe, placer_.landmark_of(), placer_.matches());
  report_.num_observed += grown.num_observed;
  report_.num_merged += grown.num_merged;
  report_.num_triangulated += grown.num_triangulated;
}

void IncrementalMapper::BeginAdjustment(SlotId keyframe) noexcept {
  FindWorld(keyframe);
  static_cast<void>(adjuster_.Prepare(map_, report_.world_is_ned ? &nav_ : nullptr));
  to_be_adjusted_ = keyframe;
}

// The frame's pose is the last there was: what comes is placed, and predicted, from the new one.
void IncrementalMapper::TakeAdjustment() noexcept {
  const SlotId keyframe = std::exchange(to_be_adjusted_, {});
  if (!keyframe.valid()) return;
  if (const auto adjusted = adjuster_.Finish(&map_, report_.world_is_ned ? &nav_ : nullptr)) {
    report_.window_error_px = adjusted->mean_error_px;
    report_.num_culled += grower_.Cull(&map_, adjuster_.window());
    TakeNewest(keyframe);
    if (adjuster_.has_left()) {
      report_.left_window = adjuster_.window().front();
      CloseLoop(report_.left_window);
    }
  }
  PlaceWaiting(keyframe);
}

// The keyframe that has left the window is the next of the way. A loop that it closes is a jump
// where anybody notices.
void IncrementalMapper::CloseLoop(SlotId left) noexcept {
  constexpr double kUnnoticed_m = 0.005, kUnnoticed_rad = 0.001;
  const bool is_ned = report_.world_is_ned;
  const NavSample then = nav_.buffer().At(map_.keyframe(left).utime);
  if (!loops_.Add(map_, left, {is_ned, is_ned && then.Has(NavField::kDepth)})) return;
  const Rigid3 moved = CorrectMap(loops_, left, is_ned, &map_, &adjuster_);
  const Vec3 was_at = report_.camera_from_world.OriginOfTarget();
  report_.camera_from_world = report_.camera_from_world * moved.Inverse();
  way_.placed.camera_from_world = way_.base.camera_from_world = way_.next_base.camera_from_world =
      report_.camera_from_world;
  way_.placed_before.camera_from_world = way_.placed_before.camera_from_world * moved.Inverse();
  if ((report_.camera_from_world.OriginOfTarget() - was_at).norm() > kUnnoticed_m ||
      LogSo3(moved.rotation).norm() > kUnnoticed_rad)
    jumps_.Expect();
}

// The keyframe's pose is the frame's.
void IncrementalMapper::TakeNewest(SlotId keyframe) noexcept {
  const Keyframe& newest = map_.keyframe(keyframe);
  report_.camera_from_world = newest.camera_from_world;
  report_.covariance = newest.covariance;
  KeepPlaced();
}

// Navigation's pose since the last placed frame.
std::optional<KnownPose> IncrementalMapper::Predict(Utime utime) const noexcept {
  if (!report_.scale_is_metric) return std::nullopt;
  return MoveOn(way_.base, utime, nav_, nav_errors());
}

void IncrementalMapper::CoastOn(Utime utime) noexcept {
  // Before a full buffer of a fast sensor forgets what is still to be added.
  const Utime rebase_us = std::min<Utime>(20'000'000, nav_.buffer().ReachUs() / 4);
  ++frames_lost_;
  if (const auto predicted = Predict(utime)) {
    report_.state = MapperState::kDeadReckoning;
    report_.has_pose = true;
    report_.camera_from_world = predicted->camera_from_world;
    report_.covariance = predicted->covariance;
    if (utime - way_.next_base.utime >= rebase_us) {
      if (way_.next_base.utime > way_.base.utime) way_.base = way_.next_base;
      way_.next_base = *predicted;
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

}  // namespace rsfm
