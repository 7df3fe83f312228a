#include "tools/reconstruction/consistency.h"

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <set>
#include <utility>

namespace rsfm {
namespace {

constexpr int kMinJudged = 30;          // matches whose features both have points
constexpr double kAgreeing = 0.5;       // share of them with the same point, from which on
constexpr double kContradicting = 0.1;  // and up to which

struct Edge {
  int a = 0, b = 0;
  int strength = 0;
  bool agrees = false;
};

// Disjoint groups of images, and which of them contradict each other.
class Groups {
 public:
  explicit Groups(std::size_t count) : parent_(count), size_(count, 1), rivals_(count) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }
  int Find(int image) {
    while (parent_[image] != image) image = parent_[image] = parent_[parent_[image]];
    return image;
  }
  int Size(int image) { return size_[Find(image)]; }
  bool HasRivals(int image) { return !rivals_[Find(image)].empty(); }

  void Contradict(int a, int b) {
    a = Find(a);
    b = Find(b);
    if (a == b) return;
    rivals_[a].insert(b);
    rivals_[b].insert(a);
  }
  void Join(int a, int b) {
    a = Find(a);
    b = Find(b);
    if (a == b || rivals_[a].contains(b)) return;
    if (size_[a] < size_[b]) std::swap(a, b);
    parent_[b] = a;
    size_[a] += size_[b];
    for (const int rival : rivals_[b]) {
      rivals_[rival].erase(b);
      rivals_[rival].insert(a);
      rivals_[a].insert(rival);
    }
    rivals_[b].clear();
  }

 private:
  std::vector<int> parent_, size_;
  std::vector<std::set<int>> rivals_;  // of each group's root: roots
};

}  // namespace

std::vector<int> ContradictedImages(const std::vector<VerifiedPair>& pairs, const Scene& scene) {
  std::vector<Edge> edges;
  for (const VerifiedPair& pair : pairs) {
    const SceneImage &a = scene.images[pair.images.a], &b = scene.images[pair.images.b];
    if (!a.placed || !b.placed) continue;
    int judged = 0, same = 0;
    for (const auto& [in_a, in_b] : pair.matches) {
      if (a.points[in_a] < 0 || b.points[in_b] < 0) continue;
      ++judged;
      same += a.points[in_a] == b.points[in_b];
    }
    if (judged < kMinJudged) continue;
    // By all matches: a contradicted image keeps few points beside its false ones.
    const int strength = static_cast<int>(pair.matches.size());
    if (same >= kAgreeing * judged) {
      edges.push_back({pair.images.a, pair.images.b, strength, true});
    } else if (same <= kContradicting * judged) {
      edges.push_back({pair.images.a, pair.images.b, strength, false});
    }
  }
  std::stable_sort(edges.begin(), edges.end(),
                   [](const Edge& x, const Edge& y) { return x.strength > y.strength; });
  Groups groups(scene.images.size());
  for (const Edge& edge : edges) {
    if (edge.agrees) {
      groups.Join(edge.a, edge.b);
    } else {
      groups.Contradict(edge.a, edge.b);
    }
  }
  const int count = static_cast<int>(scene.images.size());
  int largest = -1;
  for (int i = 0; i < count; ++i)
    if (scene.images[i].placed && (largest < 0 || groups.Size(i) > groups.Size(largest)))
      largest = i;
  std::vector<int> contradicted;
  for (int i = 0; i < count; ++i) {
    if (scene.images[i].placed && groups.HasRivals(i) && groups.Find(i) != groups.Find(largest))
      contradicted.push_back(i);
  }
  return contradicted;
}

}  // namespace rsfm
