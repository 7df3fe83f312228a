#include "tools/offline/unconfirmed_points.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace rsfm {
namespace {

struct Confirmed {
  Vec2 pixel;
  double log_range;
};

double LogRange(const SceneImage& image, const Vec3& xyz) {
  return std::log((xyz - image.camera_from_world.OriginOfTarget()).norm());
}

// Those of an image, by their pixel's x.
std::vector<Confirmed> ConfirmedPoints(const Scene& scene, const SceneImage& image) {
  std::vector<Confirmed> confirmed;
  for (std::size_t f = 0; f < image.points.size(); ++f) {
    if (image.points[f] == kNoPoint) continue;
    const ScenePoint& point = scene.points[image.points[f]];
    if (point.track.size() > 2)
      confirmed.push_back({image.features[f], LogRange(image, point.xyz)});
  }
  std::sort(confirmed.begin(), confirmed.end(),
            [](const Confirmed& a, const Confirmed& b) { return a.pixel.x() < b.pixel.x(); });
  return confirmed;
}

using Nearest = std::vector<std::pair<double, double>>;  // squared distance, logarithm of the range

void FindNear(const std::vector<Confirmed>& confirmed, const Vec2& pixel, double radius_px,
              Nearest* nearest) {
  nearest->clear();
  const auto first =
      std::lower_bound(confirmed.begin(), confirmed.end(), pixel.x() - radius_px,
                       [](const Confirmed& point, double x) { return point.pixel.x() < x; });
  for (auto it = first; it != confirmed.end() && it->pixel.x() <= pixel.x() + radius_px; ++it) {
    const double distance = (it->pixel - pixel).squaredNorm();
    if (distance <= radius_px * radius_px) nearest->emplace_back(distance, it->log_range);
  }
}

enum class Verdict { kNone, kAgrees, kContradicts };

Verdict Judge(const UnconfirmedPointOptions& options, int width,
              const std::vector<Confirmed>& confirmed, const Vec2& pixel, double log_range,
              Nearest* nearest) {
  const auto enough = [&] { return static_cast<int>(nearest->size()) >= options.min_neighbours; };
  FindNear(confirmed, pixel, options.radius * width, nearest);
  if (!enough()) FindNear(confirmed, pixel, options.far_radius * width, nearest);
  if (!enough()) return Verdict::kNone;
  const std::size_t asked = std::min(nearest->size(), static_cast<std::size_t>(options.neighbours));
  std::partial_sort(nearest->begin(), nearest->begin() + static_cast<std::ptrdiff_t>(asked),
                    nearest->end());
  nearest->resize(asked);
  std::sort(nearest->begin(), nearest->end(),
            [](const auto& a, const auto& b) { return a.second < b.second; });
  // Without the nearest and the farthest: a confirmed point may be wrong, too.
  const double low = (*nearest)[1].second, high = (*nearest)[asked - 2].second;
  const double margin = options.spreads * std::max(high - low, options.min_spread);
  return log_range < low - margin || log_range > high + margin ? Verdict::kContradicts
                                                               : Verdict::kAgrees;
}

}  // namespace

int RemoveUnconfirmedOutliers(const UnconfirmedPointOptions& options, Scene* scene) {
  std::vector<Verdict> verdicts(scene->points.size(), Verdict::kNone);
  Nearest nearest;
  for (const SceneImage& image : scene->images) {
    if (!image.placed) continue;
    const std::vector<Confirmed> confirmed = ConfirmedPoints(*scene, image);
    for (std::size_t f = 0; f < image.points.size(); ++f) {
      const std::int32_t p = image.points[f];
      if (p == kNoPoint || scene->points[p].track.size() != 2) continue;
      const Verdict verdict = Judge(options, scene->camera.width, confirmed, image.features[f],
                                    LogRange(image, scene->points[p].xyz), &nearest);
      if (verdicts[p] != Verdict::kAgrees && verdict != Verdict::kNone) verdicts[p] = verdict;
    }
  }
  int removed = 0;
  for (std::size_t p = 0; p < verdicts.size(); ++p) {
    if (verdicts[p] != Verdict::kContradicts) continue;
    scene->RemovePoint(static_cast<int>(p));
    ++removed;
  }
  return removed;
}

}  // namespace rsfm
