#include "tools/reconstruction/start_pair.h"

#include <algorithm>
#include <cmath>

#include "rsfm/estimation/two_view.h"

namespace rsfm {
namespace {

constexpr double kWideAngle = 0.25;  // rad: beyond it more brings nothing

double Score(const VerifiedPair& pair) {
  return static_cast<double>(pair.matches.size()) * std::min(kWideAngle, pair.median_angle_rad);
}

std::vector<std::size_t> BestFirst(const std::vector<VerifiedPair>& pairs,
                                   const std::vector<std::uint8_t>& closed,
                                   const std::vector<std::uint8_t>& tried,
                                   const PlacingOptions& options) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const VerifiedPair& pair = pairs[i];
    if (tried[i] == 0 && closed[pair.images.a] == 0 && closed[pair.images.b] == 0 &&
        static_cast<int>(pair.matches.size()) >= options.min_start_matches &&
        pair.median_angle_rad >= options.min_start_angle_rad)
      order.push_back(i);
  }
  std::stable_sort(order.begin(), order.end(), [&pairs](std::size_t x, std::size_t y) {
    return Score(pairs[x]) > Score(pairs[y]);
  });
  return order;
}

struct Placed {
  TwoViewReport report;
  bool from_navigation = false;
};

std::optional<Placed> EstimatePose(const VerifiedPair& pair, const StartOptions& options,
                                   const Scene& scene) {
  std::vector<Vec2> pixels_a, pixels_b;
  for (const auto& [a, b] : pair.matches) {
    pixels_a.push_back(scene.images[pair.images.a].features[a]);
    pixels_b.push_back(scene.images[pair.images.b].features[b]);
  }
  TwoViewOptions two_view;
  two_view.ransac.seed = options.placing.seed;
  two_view.ransac.max_error_px = 3.0;
  two_view.nominal_range_m = options.range_m;
  Placed placed;
  if (options.baseline) {
    if (const auto known = options.baseline(pair.images.a, pair.images.b)) {
      two_view.baseline_m = known->length_m;
      two_view.sigma_baseline_m = known->sigma_m;
      placed.from_navigation = true;
    }
  }
  const AnyCamera camera = *AnyCamera::Create(scene.camera);
  TwoViewEstimator estimator(static_cast<std::uint32_t>(pixels_a.size()));
  const auto report = estimator.Estimate(camera, camera, pixels_a, pixels_b, two_view);
  if (!report || report->num_inliers < options.placing.min_start_matches) return std::nullopt;
  placed.report = *report;
  return placed;
}

void ForgetAll(Scene* scene) {
  for (SceneImage& image : scene->images) {
    image.placed = false;
    std::fill(image.points.begin(), image.points.end(), kNoPoint);
  }
  scene->points.clear();
}

}  // namespace

std::optional<StartPair> PlaceStartPair(const CorrespondenceGraph& graph,
                                        const std::vector<VerifiedPair>& pairs,
                                        const std::vector<std::uint8_t>& closed,
                                        const StartOptions& options,
                                        std::vector<std::uint8_t>* tried, Scene* scene) {
  tried->resize(pairs.size(), 0);
  std::vector<std::size_t> order = BestFirst(pairs, closed, *tried, options.placing);
  order.resize(std::min(order.size(), static_cast<std::size_t>(options.max_trials)));
  for (const std::size_t index : order) {
    const VerifiedPair& pair = pairs[index];
    (*tried)[index] = 1;
    const auto found = EstimatePose(pair, options, *scene);
    if (!found) continue;
    ForgetAll(scene);
    SceneImage& a = scene->images[pair.images.a];
    SceneImage& b = scene->images[pair.images.b];
    a.placed = b.placed = true;
    a.camera_from_world = Rigid3();
    b.camera_from_world = found->report.b_from_a;
    UpdateTracksOf(pair.images.a, graph, options.placing.tracks, scene);
    if (scene->NumPoints() >= options.placing.min_start_matches / 2 &&
        AdjustAndFilter(options.placing, scene)) {
      UpdateTracksOf(pair.images.a, graph, options.placing.tracks, scene);
      if (a.placed && b.placed && scene->NumPoints() >= options.placing.min_start_matches / 2) {
        return StartPair{pair.images, found->report.b_from_a.translation.norm(),
                         found->from_navigation,
                         !found->from_navigation && found->report.is_baseline_known};
      }
    }
    ForgetAll(scene);
  }
  return std::nullopt;
}

}  // namespace rsfm
