#include "rsfm/mapping/window_adjuster.h"

#include <algorithm>

namespace rsfm {
namespace {

constexpr int kMaxFixedKeyframes = 24;
constexpr double kMeanObservations = 8.0;  // of a landmark in a window: sizes the memory

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

}  // namespace

WindowAdjuster::WindowAdjuster(const MapperOptions& options, const AnyCamera& camera, WindowBa ba)
    : options_(options),
      camera_(camera),
      ba_(std::move(ba)),
      window_(Count(options.window_keyframes)),
      landmarks_(Count(options.window_landmarks)),
      index_of_(Count(options.max_keyframes)),
      added_(Count(options.max_landmarks)) {
  index_of_.TryResize(index_of_.capacity());
  added_.TryResize(added_.capacity());
}

Expected<WindowAdjuster> WindowAdjuster::Create(const MapperOptions& options,
                                                const AnyCamera& camera) {
  WindowBaCapacity capacity;
  capacity.keyframes = options.window_keyframes + kMaxFixedKeyframes;
  capacity.landmarks = options.window_landmarks;
  capacity.observations = static_cast<int>(kMeanObservations * options.window_landmarks);
  capacity.priors = 4 * options.window_keyframes;
  auto ba = WindowBa::Create(capacity);
  if (!ba) return tl::unexpected(ba.error());
  return WindowAdjuster(options, camera, std::move(*ba));
}

void WindowAdjuster::SelectWindow(const Map& map, int count) noexcept {
  window_.clear();
  const std::span<const SlotId> keyframes = map.keyframes();
  std::size_t first = keyframes.size();
  for (int found = 0; first > 0 && found < count && Count(found) < window_.capacity();) {
    --first;
    if (map.keyframe(keyframes[first]).is_placed) ++found;
  }
  for (std::size_t i = first; i < keyframes.size(); ++i) {
    if (map.keyframe(keyframes[i]).is_placed) window_.TryPushBack(keyframes[i]);
  }
}

// The keyframe's index in the problem; one outside the window joins it as fixed. -1 when full.
int WindowAdjuster::BaIndexOf(const Map& map, SlotId keyframe) noexcept {
  int& index = index_of_[keyframe.index];
  if (index >= 0 || num_fixed_ >= kMaxFixedKeyframes) return index;
  const Keyframe& seen_from = map.keyframe(keyframe);
  if (!seen_from.is_placed) return -1;
  const auto added = ba_.AddKeyframe(seen_from.camera_from_world, 0, true);
  if (!added) return -1;
  ++num_fixed_;
  if (!newest_fixed_.valid() || map.keyframe(newest_fixed_).id < seen_from.id)
    newest_fixed_ = keyframe;
  return index = *added;
}

// Newest keyframe first, so that what is seen now is in when the capacity ends.
void WindowAdjuster::AddLandmarks(const Map& map, int min_observations) noexcept {
  for (std::size_t k = window_.size(); k-- > 0;) {
    for (const SlotId id : map.landmarks_of(window_[k])) {
      const Landmark* landmark = map.landmarks().Find(id);
      if (landmark == nullptr || added_[id.index] || landmarks_.full()) continue;
      if (static_cast<int>(landmark->observations.size()) < min_observations) continue;
      const auto index = ba_.AddLandmark(landmark->point_in_world);
      if (!index) return;
      added_[id.index] = 1;
      landmarks_.TryPushBack(id);
      for (const Observation& o : landmark->observations) {
        const int keyframe = BaIndexOf(map, o.keyframe);
        if (keyframe < 0) continue;
        const Vec2 pixel = map.features(o.keyframe)[Count(o.feature)].pixel();
        if (!ba_.AddObservation(keyframe, *index, pixel, options_.pixel_sigma)) return;
      }
    }
  }
}

void WindowAdjuster::AddPriors(const Map& map, const NavAid& nav) noexcept {
  const auto add = [&](const PosePrior& prior) { static_cast<void>(ba_.AddPrior(prior)); };
  for (std::size_t k = 0; k < window_.size(); ++k) {
    const Keyframe& keyframe = map.keyframe(window_[k]);
    nav.ForEachPrior(static_cast<int>(k), keyframe.nav, add);
    if (k == 0) continue;
    const auto displacement =
        nav.DisplacementPrior(static_cast<int>(k) - 1, static_cast<int>(k),
                              map.keyframe(window_[k - 1]).utime, keyframe.utime);
    if (displacement) add(*displacement);
  }
}

Expected<WindowBaReport> WindowAdjuster::Adjust(Map* map, int count, const NavAid* nav) noexcept {
  SelectWindow(*map, count);
  if (window_.size() < 2) return Fail(Errc::kNotEnoughData, "window");
  ba_.Clear();
  landmarks_.clear();
  std::fill(index_of_.begin(), index_of_.end(), -1);
  std::fill(added_.begin(), added_.end(), std::uint8_t{0});
  newest_fixed_ = {};
  num_fixed_ = 0;
  bool has_absolute = false;
  for (const SlotId id : window_) has_absolute |= map->keyframe(id).nav.Has(NavField::kPosition);
  has_absolute = has_absolute && nav != nullptr;
  // Without anything older or absolute to hold it, the window's own first pose is the anchor.
  const bool is_whole_map =
      !std::any_of(map->keyframes().begin(), map->keyframes().end(), [&](SlotId id) {
        return map->keyframe(id).is_placed && map->keyframe(id).id < map->keyframe(window_[0]).id;
      });
  for (std::size_t k = 0; k < window_.size(); ++k) {
    const bool fixed = k == 0 && is_whole_map && !has_absolute;
    const auto index = ba_.AddKeyframe(map->keyframe(window_[k]).camera_from_world, 0, fixed);
    if (!index) return tl::unexpected(index.error());
    index_of_[window_[k].index] = *index;
  }
  AddLandmarks(*map, 3);
  AddLandmarks(*map, 2);
  if (nav != nullptr) AddPriors(*map, *nav);

  WindowBaOptions options;
  options.max_iterations = options_.window_iterations;
  options.function_tolerance = 1e-5;
  const auto report = ba_.Solve(std::span(&camera_, 1), options);
  if (!report) return tl::unexpected(report.error());
  WriteBack(map);
  return *report;
}

void WindowAdjuster::WriteBack(Map* map) noexcept {
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
  // The newest keyframe's uncertainty: its own given what is held, and that of what holds it.
  Keyframe& newest = map->keyframe(window_.back());
  const auto covariance = ba_.PoseCovariance(static_cast<int>(window_.size()) - 1);
  if (!covariance) return;
  Mat6 held = Mat6::Zero();
  if (newest_fixed_.valid()) {
    const Keyframe& holder = map->keyframe(newest_fixed_);
    const Mat6 adjoint = AdjointSe3(newest.camera_from_world * holder.camera_from_world.Inverse());
    held = adjoint * holder.covariance * adjoint.transpose();
  }
  newest.covariance = *covariance + held;
}

}  // namespace rsfm
