#include "rsfm/mapping/map_grower.h"

#include <numbers>

#include "rsfm/estimation/reprojection_residual.h"
#include "rsfm/estimation/triangulation.h"

namespace rsfm {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

}  // namespace

MapGrower::MapGrower(const MapperOptions& options, const AnyCamera& camera)
    : options_(options), camera_(camera), views_(Count(options.max_features)) {
  views_.TryResize(views_.capacity());
}

bool MapGrower::Fits(const Map& map, SlotId landmark, SlotId keyframe, int feature) const noexcept {
  Vec2 error;
  const Projection status =
      ReprojectionError(camera_, map.keyframe(keyframe).camera_from_world,
                        map.landmarks().Find(landmark)->point_in_world,
                        map.features(keyframe)[Count(feature)].pixel(), &error);
  return status == Projection::kOk && error.norm() <= options_.max_error_px;
}

bool MapGrower::IsDuplicate(const Map& map, SlotId a, SlotId b) const noexcept {
  // Two landmarks seen apart in one image are two.
  for (const Observation& in_a : map.landmarks().Find(a)->observations) {
    for (const Observation& in_b : map.landmarks().Find(b)->observations) {
      if (in_a.keyframe == in_b.keyframe) return false;
    }
  }
  return true;
}

void MapGrower::Link(Map* map, SlotId keyframe, int feature, const Observation& other,
                     GrowReport* report) noexcept {
  const SlotId mine = map->landmarks_of(keyframe)[Count(feature)];
  const SlotId theirs = map->landmarks_of(other.keyframe)[Count(other.feature)];
  const bool has_mine = map->landmarks().Contains(mine);
  const bool has_theirs = map->landmarks().Contains(theirs);
  if (!has_mine && !has_theirs) {
    views_[Count(feature)].TryPushBack(other);
  } else if (has_mine && !has_theirs) {
    if (Fits(*map, mine, other.keyframe, other.feature) &&
        map->Observe(mine, other.keyframe, other.feature))
      ++report->num_observed;
  } else if (!has_mine) {
    if (Fits(*map, theirs, keyframe, feature) && map->Observe(theirs, keyframe, feature))
      ++report->num_observed;
  } else if (mine != theirs && Fits(*map, mine, other.keyframe, other.feature) &&
             Fits(*map, theirs, keyframe, feature) && IsDuplicate(*map, mine, theirs)) {
    const auto seen = [&](SlotId id) { return map->landmarks().Find(id)->observations.size(); };
    const bool keep_mine = seen(mine) >= seen(theirs);
    map->Merge(keep_mine ? theirs : mine, keep_mine ? mine : theirs);
    ++report->num_merged;
  }
}

GrowReport MapGrower::Grow(Map* map, SlotId keyframe, std::span<const SlotId> landmark_of,
                           std::span<const KeyframeMatches> matches) noexcept {
  GrowReport report;
  MakeRoom(map);
  for (std::size_t i = 0; i < landmark_of.size(); ++i) {
    if (map->Observe(landmark_of[i], keyframe, static_cast<int>(i))) ++report.num_observed;
  }
  const int num_features = map->keyframe(keyframe).num_features;
  for (int i = 0; i < num_features; ++i) views_[Count(i)].clear();
  for (const KeyframeMatches& with : matches) {
    if (with.keyframe == keyframe || !map->Contains(with.keyframe)) continue;
    if (!map->keyframe(with.keyframe).is_placed) continue;
    for (const DescriptorMatch& match : with.matches)
      Link(map, keyframe, match.query, {with.keyframe, match.train}, &report);
  }
  for (int i = 0; i < num_features; ++i) {
    if (!views_[Count(i)].empty() && Triangulate(map, keyframe, i)) ++report.num_triangulated;
  }
  return report;
}

bool MapGrower::Triangulate(Map* map, SlotId keyframe, int feature) noexcept {
  if (map->landmarks().Contains(map->landmarks_of(keyframe)[Count(feature)])) return false;
  StaticVector<Observation, kMaxViews + 1> observations;
  StaticVector<TriangulationView, kMaxViews + 1> views;
  const auto add = [&](const Observation& o) {
    // A match may have got its landmark since.
    if (map->landmarks().Contains(map->landmarks_of(o.keyframe)[Count(o.feature)])) return;
    observations.TryPushBack(o);
    views.TryPushBack({&camera_, map->keyframe(o.keyframe).camera_from_world,
                       map->features(o.keyframe)[Count(o.feature)].pixel()});
  };
  add({keyframe, feature});
  for (const Observation& view : views_[Count(feature)]) add(view);
  if (views.size() < 2) return false;

  TriangulationOptions options;
  options.sigma_px = options_.pixel_sigma;
  options.max_error_px = options_.max_error_px;
  options.min_angle_rad = options_.min_angle_deg * kRadPerDeg;
  std::array<std::uint8_t, kMaxViews + 1> inliers{};
  const auto report =
      TriangulateRobust(std::span<const TriangulationView>(views.data(), views.size()), options, 2,
                        std::span(inliers).first(views.size()));
  if (!report || inliers[0] == 0) return false;
  const SlotId landmark =
      map->AddLandmark(report->point_in_world, map->features(keyframe)[Count(feature)]);
  if (!landmark.valid()) return false;
  for (std::size_t v = observations.size(); v-- > 0;) {  // the new keyframe last: the newest
    if (inliers[v]) map->Observe(landmark, observations[v].keyframe, observations[v].feature);
  }
  return true;
}

int MapGrower::Cull(Map* map, std::span<const SlotId> keyframes) noexcept {
  int num_dropped = 0;
  const SlotId newest = map->keyframes().empty() ? SlotId{} : map->keyframes().back();
  for (const SlotId keyframe : keyframes) {
    const std::span<const SlotId> landmarks = map->landmarks_of(keyframe);
    for (std::size_t i = 0; i < landmarks.size(); ++i) {
      const SlotId id = landmarks[i];
      const Landmark* landmark = map->landmarks().Find(id);
      if (landmark == nullptr) continue;
      if (!Fits(*map, id, keyframe, static_cast<int>(i))) {
        map->Unobserve(id, keyframe);
        ++num_dropped;
      }
      const bool is_single = landmark->observations.size() < 2;
      if (is_single &&
          (landmark->observations.empty() || landmark->observations.back().keyframe != newest))
        map->EraseLandmark(id);
    }
  }
  return num_dropped;
}

void MapGrower::MakeRoom(Map* map) noexcept {
  // Room for a keyframe's worth: those whose last sight is longest ago go first.
  const std::size_t capacity = map->landmarks().capacity();
  const std::size_t wanted = std::min(capacity / 4, Count(options_.max_features));
  for (const SlotId keyframe : map->keyframes()) {
    if (capacity - map->landmarks().size() >= wanted) return;
    const std::span<const SlotId> landmarks = map->landmarks_of(keyframe);
    for (const SlotId id : landmarks) {
      const Landmark* landmark = map->landmarks().Find(id);
      if (landmark != nullptr && landmark->observations.back().keyframe == keyframe)
        map->EraseLandmark(id);
    }
  }
}

}  // namespace rsfm
