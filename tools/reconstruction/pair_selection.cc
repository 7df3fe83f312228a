#include "tools/reconstruction/pair_selection.h"

#include <algorithm>
#include <set>

#include "tools/offline/parallel_progress.h"

namespace rsfm {
namespace {

std::vector<ImagePair> AllPairs(int count) {
  std::vector<ImagePair> pairs;
  for (int a = 0; a < count; ++a)
    for (int b = a + 1; b < count; ++b) pairs.push_back({a, b});
  return pairs;
}

// The nearest images of each that has a place.
std::vector<std::vector<int>> Nearest(const std::vector<std::optional<Vec3>>& places, int count) {
  std::vector<std::vector<int>> nearest(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!places[i]) continue;
    std::vector<std::pair<double, int>> order;
    for (std::size_t j = 0; j < places.size(); ++j)
      if (j != i && places[j])
        order.emplace_back((*places[i] - *places[j]).squaredNorm(), static_cast<int>(j));
    const auto kept = std::min(order.size(), static_cast<std::size_t>(count));
    std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(kept),
                      order.end());
    for (std::size_t k = 0; k < kept; ++k) nearest[i].push_back(order[k].second);
  }
  return nearest;
}

int Insert(const std::vector<std::vector<int>>& neighbours, std::set<ImagePair>* pairs) {
  const std::size_t before = pairs->size();
  for (std::size_t i = 0; i < neighbours.size(); ++i) {
    for (const int j : neighbours[i]) {
      const int a = static_cast<int>(i);
      pairs->insert({std::min(a, j), std::max(a, j)});
    }
  }
  return static_cast<int>(pairs->size() - before);
}

}  // namespace

PairSelection SelectImagePairs(const Extraction& extraction, const std::filesystem::path& work,
                               const std::vector<std::optional<Vec3>>& places,
                               const PairSelectionOptions& options) {
  PairSelection selection;
  const int count = static_cast<int>(extraction.images.size());
  if (count <= options.exhaustive_up_to) {
    selection.exhaustive = true;
    selection.pairs = AllPairs(count);
    return selection;
  }
  std::set<ImagePair> pairs;
  for (int a = 0; a < count; ++a)
    for (int b = a + 1; b <= std::min(count - 1, a + options.sequence_neighbours); ++b)
      pairs.insert({a, b});
  selection.num_from_sequence = static_cast<int>(pairs.size());
  const bool has_places =
      2 * std::count_if(places.begin(), places.end(), [](const auto& p) { return p.has_value(); }) >
      count;
  if (has_places)
    selection.num_from_places = Insert(Nearest(places, options.spatial_neighbours), &pairs);
  std::vector<ImageSignature> signatures(extraction.images.size());
  selection.interrupted = !ForEachInParallel(count, options.num_threads, options.progress, [&] {
    return [&](int i) {
      const ExtractedImage& image = extraction.images[i];
      if (const auto features = ReadFeatures(FeaturesPath(work, image.name), image.key))
        signatures[i] = ComputeSignature(*features, options.signature);
    };
  });
  if (selection.interrupted) return selection;
  const int similar = has_places ? options.similar_neighbours / 2 : options.similar_neighbours;
  selection.num_from_similarity = Insert(MostSimilar(signatures, similar), &pairs);
  selection.pairs.assign(pairs.begin(), pairs.end());
  return selection;
}

}  // namespace rsfm
