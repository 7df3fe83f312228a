#include "rsfm/mapping/track_predictor.h"

#include <algorithm>
#include <limits>

namespace rsfm {
namespace {

constexpr int kMinLandmarks = 10;

// Sets the pixel where the point is seen; leaves it where it is not.
void Expect(const AnyCamera& camera, const Vec3& point_in_camera, Vec2* pixel) {
  Vec2 projected = Vec2::Zero();
  if (camera.Project(point_in_camera, &projected) == Projection::kOk) *pixel = projected;
}

}  // namespace

TrackPredictor::TrackPredictor(int max_features)
    : features_(static_cast<std::size_t>(std::max(max_features, 0))),
      expected_(features_.capacity()),
      ranges_(features_.capacity()) {}

void TrackPredictor::Remember(std::span<const Feature> features) noexcept {
  features_.clear();
  for (const Feature& feature : features) features_.TryPushBack(feature);
}

// Both lists are in ascending order of track: one pass.
int TrackPredictor::ProjectLandmarks(const Map& map, SlotId keyframe, const AnyCamera& camera,
                                     const Rigid3& camera_from_world,
                                     const Rigid3& next_from_world) noexcept {
  const std::span<const Feature> old = map.features(keyframe);
  const std::span<const SlotId> landmarks = map.landmarks_of(keyframe);
  ranges_.clear();
  for (std::size_t i = 0, j = 0; i < features_.size() && j < old.size();) {
    const std::uint32_t a = features_[i].track, b = old[j].track;
    if (a == kNoTrack || b == kNoTrack) break;
    const Landmark* landmark = a == b ? map.landmarks().Find(landmarks[j]) : nullptr;
    if (landmark != nullptr) {
      Expect(camera, next_from_world * landmark->point_in_world, &expected_[i]);
      ranges_.TryPushBack((camera_from_world * landmark->point_in_world).norm());
    }
    if (a <= b) ++i;
    if (b <= a) ++j;
  }
  return static_cast<int>(ranges_.size());
}

std::span<const Vec2> TrackPredictor::Predict(const Map& map, const AnyCamera& camera,
                                              const Rigid3& camera_from_world,
                                              const Rigid3& next_from_world) noexcept {
  expected_.TryResizeForOverwrite(features_.size());
  std::fill(expected_.begin(), expected_.end(),
            Vec2::Constant(std::numeric_limits<double>::quiet_NaN()));
  const std::span<const SlotId> keyframes = map.keyframes();
  std::size_t newest = keyframes.size();
  while (newest > 0 && !map.keyframe(keyframes[newest - 1]).is_placed) --newest;
  if (newest == 0) return {};
  if (ProjectLandmarks(map, keyframes[newest - 1], camera, camera_from_world, next_from_world) <
      kMinLandmarks)
    return {};
  double* middle = ranges_.data() + ranges_.size() / 2;
  std::nth_element(ranges_.data(), middle, ranges_.data() + ranges_.size());
  const Rigid3 next_from_camera = next_from_world * camera_from_world.Inverse();
  for (std::size_t i = 0; i < features_.size(); ++i) {
    Ray3 ray;
    if (expected_[i].allFinite() ||
        camera.Backproject(features_[i].pixel(), &ray) != Projection::kOk)
      continue;
    Expect(camera, next_from_camera * ray.At(*middle), &expected_[i]);
  }
  return expected_.span();
}

}  // namespace rsfm
