#include "tools/offline/guided_matching.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>

#include "rsfm/mapping/descriptor_matcher.h"
#include "tools/offline/parallel_progress.h"

namespace rsfm {
namespace {

constexpr int kCurvePoints = 12;
constexpr double kCellPx = 16.0;
constexpr double kSamePlacePx = 2.0;  // a second-best this near is the same thing seen twice

// Which features lie in which cell of the image.
class FeatureCells {
 public:
  FeatureCells(const std::vector<Vec2>& features, int width, int height)
      : columns_(static_cast<int>(width / kCellPx) + 1),
        rows_(static_cast<int>(height / kCellPx) + 1),
        features_(features),
        cells_(static_cast<std::size_t>(columns_) * rows_) {
    for (std::size_t i = 0; i < features.size(); ++i)
      cells_[Index(Column(features[i].x()), Row(features[i].y()))].push_back(
          static_cast<std::int32_t>(i));
  }

  // Calls for every feature within `band` of the straight line from a to b, perhaps repeatedly with
  // other lines.
  template <class F>
  void Along(const Vec2& a, const Vec2& b, double band, const F& call) const {
    const Vec2 low = a.cwiseMin(b) - Vec2(band, band), high = a.cwiseMax(b) + Vec2(band, band);
    const Vec2 line = b - a;
    const double inverse_square = 1.0 / std::max(line.squaredNorm(), 1e-12);
    for (int row = Row(low.y()); row <= Row(high.y()); ++row) {
      for (int column = Column(low.x()); column <= Column(high.x()); ++column) {
        for (const std::int32_t i : cells_[Index(column, row)]) {
          const Vec2 offset = features_[i] - a;
          const double along = std::clamp(offset.dot(line) * inverse_square, 0.0, 1.0);
          if ((offset - along * line).squaredNorm() <= band * band) call(i);
        }
      }
    }
  }

 private:
  int Column(double x) const { return Cell(x, columns_); }
  int Row(double y) const { return Cell(y, rows_); }
  static int Cell(double v, int count) {
    return static_cast<int>(std::clamp(v / kCellPx, 0.0, count - 1.0));
  }
  std::size_t Index(int column, int row) const {
    return static_cast<std::size_t>(row) * columns_ + column;
  }

  int columns_, rows_;
  const std::vector<Vec2>& features_;
  std::vector<std::vector<std::int32_t>> cells_;
};

struct Choice {
  std::int32_t feature = -1, distance = std::numeric_limits<std::int32_t>::max();
};

struct SearchedImage {
  DescriptorRows descriptors;
  std::optional<FeatureCells> cells;
  std::vector<Ray3> rays;                    // in water; zero direction: the pixel has none
  double nearest_m = 0.0, farthest_m = 0.0;  // along rays; zero: the image has no points
};

SearchedImage Prepare(const Scene& scene, const AnyCamera& camera, const SceneImage& image,
                      DescriptorRows descriptors) {
  constexpr double kOutermost = 0.02;
  SearchedImage view;
  view.descriptors = std::move(descriptors);
  view.cells.emplace(image.features, camera.width(), camera.height());
  std::vector<double> ranges;
  for (std::size_t i = 0; i < image.features.size(); ++i) {
    Ray3 ray{Vec3::Zero(), Vec3::Zero()};
    if (camera.Backproject(image.features[i], &ray) != Projection::kOk) ray.direction.setZero();
    view.rays.push_back(ray);
    if (image.points[i] == kNoPoint) continue;
    const double range = (image.camera_from_world * scene.points[image.points[i]].xyz).norm();
    if (range > 0.0) ranges.push_back(range);
  }
  if (ranges.empty()) return view;
  std::sort(ranges.begin(), ranges.end());
  const auto outermost = static_cast<std::size_t>(kOutermost * static_cast<double>(ranges.size()));
  view.nearest_m = ranges[outermost];
  view.farthest_m = ranges[ranges.size() - 1 - outermost];
  return view;
}

// The images last searched, ready for the search: as many as are in work, not all there are.
class SearchedImages {
 public:
  SearchedImages(const Scene& scene, const AnyCamera& camera, const GuidedMatchOptions& options)
      : scene_(scene), camera_(camera), options_(options) {}

  std::shared_ptr<const SearchedImage> Get(int image) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (auto known = Use(image)) return known;
    }
    const SceneImage& from = scene_.images[image];
    auto made = std::make_shared<const SearchedImage>(Prepare(
        scene_, camera_, from,
        options_.descriptors
            ? options_.descriptors(image)
            : PrepareDescriptors(from.descriptor_type, from.descriptors, from.sizes_px, 0)));
    const std::lock_guard<std::mutex> lock(mutex_);
    if (auto known = Use(image)) return known;  // another thread was faster
    last_used_.emplace_front(image, made);
    if (static_cast<int>(last_used_.size()) > options_.images_in_memory) last_used_.pop_back();
    return made;
  }

 private:
  std::shared_ptr<const SearchedImage> Use(int image) {
    const auto found = std::find_if(last_used_.begin(), last_used_.end(),
                                    [image](const auto& entry) { return entry.first == image; });
    if (found == last_used_.end()) return nullptr;
    last_used_.splice(last_used_.begin(), last_used_, found);
    return found->second;
  }

  const Scene& scene_;
  const AnyCamera& camera_;
  const GuidedMatchOptions& options_;
  std::mutex mutex_;
  std::list<std::pair<int, std::shared_ptr<const SearchedImage>>> last_used_;
};

class GuidedMatcher {
 public:
  GuidedMatcher(const Scene& scene, const AnyCamera& camera, SearchedImages* views,
                const GuidedMatchOptions& options)
      : scene_(scene), camera_(camera), views_(*views), options_(options) {}

  // Features of a and b, sorted by a's.
  std::vector<std::pair<std::int32_t, std::int32_t>> Match(const ImagePair& pair,
                                                           const VerifiedPair* known) {
    std::vector<std::uint8_t> taken_a(scene_.images[pair.a].features.size(), 0),
        taken_b(scene_.images[pair.b].features.size(), 0);
    if (known != nullptr) {
      for (const auto& [a, b] : known->matches) taken_a[a] = taken_b[b] = 1;
    }
    const std::vector<Choice> forth = Choose(pair.a, pair.b, taken_a, taken_b),
                              back = Choose(pair.b, pair.a, taken_b, taken_a);
    std::vector<std::pair<std::int32_t, std::int32_t>> matches;
    for (std::size_t a = 0; a < forth.size(); ++a) {
      const std::int32_t b = forth[a].feature;
      if (b >= 0 && back[b].feature == static_cast<std::int32_t>(a))
        matches.emplace_back(static_cast<std::int32_t>(a), b);
    }
    return matches;
  }

 private:
  std::vector<Choice> Choose(int from, int to, const std::vector<std::uint8_t>& taken_from,
                             const std::vector<std::uint8_t>& taken_to) {
    const auto view_a = views_.Get(from), view_b = views_.Get(to);
    const SearchedImage &a = *view_a, &b = *view_b;
    std::vector<Choice> chosen(a.rays.size());
    if (!(a.nearest_m > 0.0) || a.descriptors.type == DescriptorType::kNone ||
        a.descriptors.type != b.descriptors.type)
      return chosen;
    const Rigid3 b_from_a =
        scene_.images[to].camera_from_world * scene_.images[from].camera_from_world.Inverse();
    const DescriptorView rows_a = a.descriptors.All(), rows_b = b.descriptors.All();
    const DescriptorType type = rows_a.type;
    for (std::size_t i = 0; i < a.rays.size(); ++i) {
      if (taken_from[i] != 0 || a.rays[i].direction.isZero()) continue;
      candidates_.clear();
      FollowCurve(a, a.rays[i], b_from_a, *b.cells);
      std::sort(candidates_.begin(), candidates_.end());
      candidates_.erase(std::unique(candidates_.begin(), candidates_.end()), candidates_.end());
      Choice best;
      std::int32_t second = std::numeric_limits<std::int32_t>::max();
      const std::vector<Vec2>& pixels = scene_.images[to].features;
      for (const std::int32_t j : candidates_) {
        const std::int32_t distance =
            DescriptorDistance(type, rows_a.Row(static_cast<int>(i)), rows_b.Row(j));
        if (distance < best.distance) {
          if (best.feature >= 0 && !AreOne(pixels[j], pixels[best.feature])) second = best.distance;
          best = {j, distance};
        } else if (distance < second && !AreOne(pixels[j], pixels[best.feature])) {
          second = distance;
        }
      }
      // A candidate that is matched already still spoils the uniqueness of another.
      if (best.feature < 0 || taken_to[best.feature] != 0) continue;
      if (best.distance > MaxDescriptorDistance(type) ||
          !PassesRatio(type, best.distance, second, options_.max_ratio))
        continue;
      chosen[i] = best;
    }
    return chosen;
  }

  static bool AreOne(const Vec2& a, const Vec2& b) {
    return (a - b).squaredNorm() < kSamePlacePx * kSamePlacePx;
  }

  // Collects what lies within the band of the ray's image in b. Points at even steps of inverse
  // range.
  void FollowCurve(const SearchedImage& a, const Ray3& ray, const Rigid3& b_from_a,
                   const FeatureCells& cells) {
    const double low = 1.0 / (options_.range_margin * a.farthest_m),
                 high = options_.range_margin / a.nearest_m;
    Vec2 before = Vec2::Zero();
    bool has_before = false;
    for (int k = 0; k < kCurvePoints; ++k) {
      const double range = 1.0 / (low + (high - low) * k / (kCurvePoints - 1));
      Vec2 pixel;
      if (camera_.Project(b_from_a * ray.At(range), &pixel) != Projection::kOk || !IsNear(pixel)) {
        has_before = false;
        continue;
      }
      if (has_before)
        cells.Along(before, pixel, options_.band_px,
                    [this](std::int32_t j) { candidates_.push_back(j); });
      before = pixel;
      has_before = true;
    }
  }

  // Farther outside nothing of a piece is in the image, as far as pieces go.
  bool IsNear(const Vec2& pixel) const {
    return pixel.x() > -camera_.width() && pixel.x() < 2.0 * camera_.width() &&
           pixel.y() > -camera_.height() && pixel.y() < 2.0 * camera_.height();
  }

  const Scene& scene_;
  const AnyCamera& camera_;
  SearchedImages& views_;
  const GuidedMatchOptions& options_;
  std::vector<std::int32_t> candidates_;
};

}  // namespace

int AddGuidedMatches(const Scene& scene, const std::vector<ImagePair>& candidates,
                     const MatchOptions& match, const GuidedMatchOptions& options,
                     std::vector<VerifiedPair>* pairs) {
  const AnyCamera camera = *AnyCamera::Create(scene.camera);
  SearchedImages views(scene, camera, options);
  std::map<ImagePair, VerifiedPair> all;
  for (VerifiedPair& pair : *pairs) all.emplace(pair.images, std::move(pair));
  std::vector<ImagePair> work;
  for (const ImagePair& pair : candidates) {
    const SceneImage &a = scene.images[pair.a], &b = scene.images[pair.b];
    if (!a.placed || !b.placed) continue;
    if (std::max(Overlap(scene, camera, pair.a, pair.b), Overlap(scene, camera, pair.b, pair.a)) >
        options.min_overlap)
      work.push_back(pair);
  }
  std::vector<std::vector<std::pair<std::int32_t, std::int32_t>>> found(work.size());
  ForEachInParallel(static_cast<int>(work.size()), match.num_threads, match.progress, [&] {
    return [&, matcher = GuidedMatcher(scene, camera, &views, options)](int i) mutable {
      const auto known = all.find(work[i]);
      found[i] = matcher.Match(work[i], known == all.end() ? nullptr : &known->second);
    };
  });
  int added = 0;
  for (std::size_t i = 0; i < work.size(); ++i) {
    const auto known = all.find(work[i]);
    if (known == all.end()) {
      if (static_cast<int>(found[i].size()) < options.min_matches) continue;
      VerifiedPair pair;
      pair.images = work[i];
      const Rigid3 b_from_a = scene.images[work[i].b].camera_from_world *
                              scene.images[work[i].a].camera_from_world.Inverse();
      pair.b_from_a = Rigid3(b_from_a.rotation, b_from_a.translation.normalized());
      pair.matches = std::move(found[i]);
      added += static_cast<int>(pair.matches.size());
      all.emplace(work[i], std::move(pair));
      continue;
    }
    auto& matches = known->second.matches;
    matches.insert(matches.end(), found[i].begin(), found[i].end());
    added += static_cast<int>(found[i].size());
  }
  pairs->clear();
  for (auto& [images, pair] : all) pairs->push_back(std::move(pair));
  return added;
}

}  // namespace rsfm
