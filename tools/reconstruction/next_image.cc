#include "tools/reconstruction/next_image.h"

#include <algorithm>
#include <bitset>

namespace rsfm {
namespace {

constexpr int kLevels = 5;  // grids of 2, 4 ... 32 cells a side
constexpr int kFinest = 1 << kLevels;
constexpr double kStrong = 0.7;  // of the strongest pair, from which on the view decides

}  // namespace

NextImage::NextImage(const Scene& scene, const std::vector<VerifiedPair>& pairs)
    : views_(scene.images.size()), neighbours_(scene.images.size()) {
  for (const VerifiedPair& pair : pairs) {
    const int matches = static_cast<int>(pair.matches.size());
    neighbours_[pair.images.a].push_back({pair.images.b, matches});
    neighbours_[pair.images.b].push_back({pair.images.a, matches});
  }
}

void NextImage::Touch(int image) {
  for (const Neighbour& other : neighbours_[image]) views_[other.image].stale = true;
}

void NextImage::TouchAll() {
  for (View& view : views_) view.stale = true;
}

void NextImage::Update(int index, const CorrespondenceGraph& graph, const Scene& scene) {
  View& view = views_[index];
  view = {.stale = false, .points = 0, .score = 0};
  const SceneImage& image = scene.images[index];
  std::bitset<kFinest * kFinest> cells;
  for (std::int32_t f = 0; f < static_cast<std::int32_t>(image.features.size()); ++f) {
    const auto neighbours = graph.Neighbours({index, f});
    if (std::none_of(neighbours.begin(), neighbours.end(), [&scene](const TrackElement& n) {
          return scene.images[n.image].points[n.feature] != kNoPoint;
        }))
      continue;
    ++view.points;
    const auto cell = [](double x, int size) {
      return std::clamp(static_cast<int>(x / size * kFinest), 0, kFinest - 1);
    };
    cells.set(static_cast<std::size_t>(cell(image.features[f].y(), scene.camera.height) * kFinest +
                                       cell(image.features[f].x(), scene.camera.width)));
  }
  for (int level = 0; level < kLevels; ++level) {
    std::bitset<kFinest * kFinest> coarse;
    for (int y = 0; y < kFinest; ++y)
      for (int x = 0; x < kFinest; ++x)
        if (cells[static_cast<std::size_t>(y * kFinest + x)])
          coarse.set(static_cast<std::size_t>((y >> level) * kFinest + (x >> level)));
    const int side = kFinest >> level;
    view.score += side * static_cast<int>(coarse.count());
  }
}

int NextImage::Choose(const CorrespondenceGraph& graph, int min_points,
                      const std::vector<std::uint8_t>& closed, const Scene& scene) {
  std::vector<int> links(views_.size(), 0);
  int strongest = 0;
  for (int i = 0; i < static_cast<int>(views_.size()); ++i) {
    if (scene.images[i].placed || closed[i] != 0 || neighbours_[i].empty()) continue;
    if (views_[i].stale) Update(i, graph, scene);
    if (views_[i].points < min_points) continue;
    links[i] = StrongestLink(i, scene);
    strongest = std::max(strongest, links[i]);
  }
  int best = -1;
  for (int i = 0; i < static_cast<int>(views_.size()); ++i) {
    if (links[i] == 0 || links[i] < kStrong * strongest) continue;
    if (best < 0 || views_[i].score > views_[best].score) best = i;
  }
  return best;
}

int NextImage::StrongestLink(int image, const Scene& scene) const {
  int strongest = 0;
  for (const Neighbour& other : neighbours_[image])
    if (scene.images[other.image].placed) strongest = std::max(strongest, other.matches);
  return strongest;
}

}  // namespace rsfm
