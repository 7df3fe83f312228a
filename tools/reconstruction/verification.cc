#include "tools/reconstruction/verification.h"

#include <algorithm>
#include <memory>
#include <optional>

#include "tools/offline/parallel_progress.h"

namespace rsfm {
namespace {

constexpr int kProbePairs = 16;
// Steps of a factor: between them the rays' offset from the stand-in changes by a third at most.
constexpr double kRanges[] = {0.3, 0.5, 0.8, 1.2, 2.0, 3.0, 5.0, 8.0};

int MostMatches(const std::vector<PutativePair>& pairs) {
  std::size_t most = 1;
  for (const PutativePair& pair : pairs) most = std::max(most, pair.matches.size());
  return static_cast<int>(most);
}

}  // namespace

double ChooseRange(const Scene& scene, const std::vector<PutativePair>& pairs,
                   const MatchOptions& options, double fallback_m) {
  if (scene.camera.port.type == PortType::kNone || pairs.empty()) return fallback_m;
  std::vector<const PutativePair*> order;
  for (const PutativePair& pair : pairs) order.push_back(&pair);
  // Not the very strongest, which are the nearest to each other and see the least parallax.
  std::stable_sort(order.begin(), order.end(), [](const PutativePair* x, const PutativePair* y) {
    return x->matches.size() > y->matches.size();
  });
  const std::size_t step = std::max<std::size_t>(1, order.size() / (2 * kProbePairs));
  MatchOptions tight = options;
  tight.max_error_px = 1.5;
  tight.min_inlier_ratio = 0.0;
  double best_range = fallback_m;
  std::size_t best = 0;
  for (const double range : kRanges) {
    const auto camera = NominalCamera::Create(scene.camera, range);
    if (!camera) return fallback_m;
    PairVerifier verifier(*camera, tight, MostMatches(pairs));
    std::size_t inliers = 0;
    for (std::size_t k = 0; k < order.size() && k < kProbePairs * step; k += step) {
      const ImagePair& images = order[k]->images;
      const auto verified = verifier.Verify(images, scene.images[images.a].features,
                                            scene.images[images.b].features, order[k]->matches);
      if (verified) inliers += verified->matches.size();
    }
    if (inliers <= best) continue;
    best = inliers;
    best_range = range;
  }
  return best_range;
}

std::vector<VerifiedPair> VerifyPairs(const Scene& scene, const std::vector<PutativePair>& pairs,
                                      double range_m, const MatchOptions& options) {
  const auto camera = NominalCamera::Create(scene.camera, range_m);
  if (!camera) return {};
  std::vector<std::optional<VerifiedPair>> results(pairs.size());
  const int most = MostMatches(pairs);
  const bool finished =
      ForEachInParallel(static_cast<int>(pairs.size()), options.num_threads, options.progress, [&] {
        return [&, verifier = std::make_shared<PairVerifier>(*camera, options, most)](int i) {
          const ImagePair& images = pairs[i].images;
          results[i] = verifier->Verify(images, scene.images[images.a].features,
                                        scene.images[images.b].features, pairs[i].matches);
        };
      });
  std::vector<VerifiedPair> verified;
  if (!finished) return verified;
  for (std::optional<VerifiedPair>& result : results)
    if (result) verified.push_back(std::move(*result));
  return verified;
}

}  // namespace rsfm
