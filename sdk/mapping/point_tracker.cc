#include "rsfm/mapping/point_tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "rsfm/mapping/patch_describer.h"

namespace rsfm {
namespace {

constexpr int kLevels = 5;
constexpr int kTopLevel = kLevels - 1;  // reaches a hundred pixels
constexpr int kNearLevel = 2;           // reaches thirty: enough where something is expected

PatchTrackerOptions TrackerOptions(const MapperOptions& options) {
  PatchTrackerOptions tracker;
  tracker.window_px = options.track_window_px;
  return tracker;
}

// Points are followed and described in the same image.
int Border(const PatchTracker& tracker) {
  return std::max(tracker.border_px(), PatchDescriber::kBorderPx);
}

}  // namespace

PointTracker::PointTracker(const MapperOptions& options, int width_px, int height_px,
                           int max_points)
    : check_px_(static_cast<float>(options.track_check_px)),
      tracker_(TrackerOptions(options)),
      newest_(width_px, height_px, kLevels, Border(tracker_)),
      before_(width_px, height_px, kLevels, Border(tracker_)),
      points_(static_cast<std::size_t>(max_points)),
      motions_(static_cast<std::size_t>(max_points)) {}

bool PointTracker::Add(PatchPlace place) noexcept {
  if (!points_.TryPushBack({place, place, place, next_track_, 0})) return false;
  ++next_track_;
  return true;
}

// Of the points that have been followed, along each axis.
PatchPlace PointTracker::MedianMotion() noexcept {
  const auto median = [&](auto&& motion_of) {
    motions_.clear();
    for (const TrackedPoint& point : points_) {
      if (point.age > 0) motions_.TryPushBack(motion_of(point));
    }
    if (motions_.empty()) return 0.0f;
    float* middle = motions_.data() + motions_.size() / 2;
    std::nth_element(motions_.data(), middle, motions_.data() + motions_.size());
    return *middle;
  };
  return {median([](const TrackedPoint& p) { return p.place.x - p.before.x; }),
          median([](const TrackedPoint& p) { return p.place.y - p.before.y; })};
}

bool PointTracker::FollowFrom(PatchPlace start, PatchPlace expected, int top_level,
                              PatchPlace* found) noexcept {
  PatchPlace place = expected;
  if (!tracker_.Track(before_, newest_, start, top_level, &place)) return false;
  // Back, as far off at the beginning as the way there was.
  PatchPlace back{place.x - expected.x + start.x, place.y - expected.y + start.y};
  if (!tracker_.Track(newest_, before_, place, top_level, &back)) return false;
  if (!(std::hypot(back.x - start.x, back.y - start.y) <= check_px_)) return false;
  *found = place;
  return true;
}

void PointTracker::Follow(const std::uint8_t* grey, int stride_bytes,
                          std::span<const Vec2> expected_px) noexcept {
  std::swap(newest_, before_);
  newest_.Build(grey, stride_bytes);
  if (!std::exchange(has_image_, true)) return;
  const PatchPlace motion = MedianMotion();
  const bool is_expected = expected_px.size() == points_.size();
  const auto right = static_cast<float>(newest_.level(0).width - 1);
  const auto bottom = static_cast<float>(newest_.level(0).height - 1);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    TrackedPoint point = points_[i];
    const PatchPlace last =
        point.age > 0 ? PatchPlace{point.place.x - point.before.x, point.place.y - point.before.y}
                      : motion;
    const auto within = [&](float x, float y) {
      return PatchPlace{std::clamp(x, 0.0f, right), std::clamp(y, 0.0f, bottom)};
    };
    const PatchPlace by_motion = within(point.place.x + last.x, point.place.y + last.y);
    PatchPlace expected = by_motion;
    if (is_expected && expected_px[i].allFinite())
      expected = within(static_cast<float>(expected_px[i].x() - 0.5),
                        static_cast<float>(expected_px[i].y() - 0.5));
    point.before = point.place;
    // Near where it is expected; if it is not there, about where its motion leads, further off.
    if (!FollowFrom(point.before, expected, kNearLevel, &point.place) &&
        !FollowFrom(point.before, by_motion, kTopLevel, &point.place))
      continue;
    ++point.age;
    points_[kept++] = point;
  }
  points_.TryResize(kept);
}

}  // namespace rsfm
