#include "tools/offline/placing.h"

#include <algorithm>
#include <map>
#include <numeric>

#include "rsfm/estimation/absolute_pose.h"
#include "rsfm/estimation/window_ba.h"

namespace rsfm {
namespace {

// Feature -> point pairs of an image through its matches, one point a feature: the one with the
// longest track.
std::vector<std::pair<std::int32_t, std::int32_t>> MatchedPoints(const CorrespondenceGraph& graph,
                                                                 int image, const Scene& scene) {
  std::vector<std::pair<std::int32_t, std::int32_t>> result;
  for (std::int32_t f = 0; f < static_cast<std::int32_t>(scene.images[image].features.size());
       ++f) {
    int best = kNoPoint;
    for (const TrackElement& n : graph.Neighbours({image, f})) {
      const int point = scene.images[n.image].points[n.feature];
      if (point != kNoPoint &&
          (best == kNoPoint || scene.points[point].track.size() > scene.points[best].track.size()))
        best = point;
    }
    if (best != kNoPoint) result.emplace_back(f, best);
  }
  return result;
}

bool AdjustAll(const PlacingOptions& options, Scene* scene) {
  SceneBundle bundle = ToBundle(*scene);
  BundleOptions adjust;
  adjust.max_iterations = 30;
  if (!AdjustBundle(adjust, &bundle.problem)) return false;
  FromBundle(bundle, scene);
  FilterScene(options.filter, scene);
  return true;
}

}  // namespace

bool PlaceFirstPair(const CorrespondenceGraph& graph, const std::vector<VerifiedPair>& pairs,
                    const PlacingOptions& options, Scene* scene) {
  // Many matches and a wide angle; beyond 10 degrees more angle brings nothing.
  std::vector<std::pair<double, const VerifiedPair*>> order;
  for (const VerifiedPair& pair : pairs) {
    if (static_cast<int>(pair.matches.size()) < options.min_start_matches ||
        pair.median_angle_rad < options.min_start_angle_rad)
      continue;
    order.emplace_back(
        static_cast<double>(pair.matches.size()) * std::min(0.17, pair.median_angle_rad), &pair);
  }
  std::stable_sort(order.begin(), order.end(),
                   [](const auto& x, const auto& y) { return x.first > y.first; });
  if (order.size() > 20) order.resize(20);  // the best ones or none
  for (const auto& [score, pair] : order) {
    Scene trial = *scene;
    SceneImage& a = trial.images[pair->images.a];
    SceneImage& b = trial.images[pair->images.b];
    a.placed = b.placed = true;
    a.camera_from_world = Rigid3();
    b.camera_from_world = pair->b_from_a;
    b.camera_from_world.translation *= options.start_baseline_m;
    // The central approximation is some pixels off: generous at first.
    TrackOptions generous = options.tracks;
    generous.max_error_px *= 3.0;
    UpdateTracksOf(pair->images.a, graph, generous, &trial);
    if (!AdjustAll(options, &trial)) continue;
    UpdateTracksOf(pair->images.a, graph, options.tracks, &trial);
    if (!a.placed || !b.placed || trial.NumPoints() < options.min_start_matches / 2) continue;
    *scene = std::move(trial);
    return true;
  }
  return false;
}

int NextToPlace(const CorrespondenceGraph& graph, const PlacingOptions& options,
                const std::vector<std::uint8_t>& tried, const Scene& scene) {
  int best = -1;
  std::size_t best_count = static_cast<std::size_t>(options.min_inliers);
  for (int i = 0; i < static_cast<int>(scene.images.size()); ++i) {
    if (scene.images[i].placed || tried[i] != 0) continue;
    const std::size_t count = MatchedPoints(graph, i, scene).size();
    if (count < best_count) continue;
    best_count = count + 1;
    best = i;
  }
  return best;
}

bool PlaceImage(int image, const CorrespondenceGraph& graph, const PlacingOptions& options,
                Scene* scene) {
  const auto matched = MatchedPoints(graph, image, *scene);
  std::vector<Vec2> pixels;
  std::vector<Vec3> points;
  for (const auto& [feature, point] : matched) {
    pixels.push_back(scene->images[image].features[feature]);
    points.push_back(scene->points[point].xyz);
  }
  if (pixels.empty()) return false;
  AbsolutePoseOptions pose_options;
  pose_options.ransac.max_error_px = options.max_error_px;
  pose_options.ransac.seed = options.seed + static_cast<std::uint64_t>(image);
  pose_options.min_inliers = options.min_inliers;
  AbsolutePoseEstimator estimator(static_cast<std::uint32_t>(pixels.size()));
  const AnyCamera camera = *AnyCamera::Create(scene->camera);
  const auto pose = estimator.Estimate(camera, pixels, points, pose_options);
  if (!pose) return false;
  scene->images[image].placed = true;
  scene->images[image].camera_from_world = pose->camera_from_world;
  for (std::size_t i = 0; i < matched.size(); ++i) {
    if (estimator.inlier_mask()[i] == 0) continue;
    const auto& track = scene->points[matched[i].second].track;
    const bool seen = std::any_of(track.begin(), track.end(),
                                  [image](const TrackElement& e) { return e.image == image; });
    if (!seen) scene->Observe(matched[i].second, {image, matched[i].first});
  }
  UpdateTracksOf(image, graph, options.tracks, scene);
  return true;
}

void AdjustAround(int image, const PlacingOptions& options, Scene* scene) {
  // Images by the number of points shared with this one.
  std::map<int, int> shared;
  for (const std::int32_t p : scene->images[image].points)
    if (p != kNoPoint)
      for (const TrackElement& e : scene->points[p].track) ++shared[e.image];
  std::vector<std::pair<int, int>> by_count;
  for (const auto& [other, count] : shared)
    if (other != image) by_count.emplace_back(-count, other);
  std::sort(by_count.begin(), by_count.end());
  std::vector<int> free = {image};
  // Two of them at least stay where they are: they hold the window in the world.
  const int num_free = std::min(options.window, static_cast<int>(by_count.size()) - 1);
  for (int i = 0; i < num_free - 1; ++i) free.push_back(by_count[i].second);

  std::vector<int> window_points;
  std::vector<std::uint8_t> taken(scene->points.size(), 0);
  std::map<int, int> keyframe_of;
  std::size_t num_observations = 0;
  for (const int i : free) {
    for (const std::int32_t p : scene->images[i].points) {
      if (p == kNoPoint || taken[p] != 0) continue;
      taken[p] = 1;
      window_points.push_back(p);
      num_observations += scene->points[p].track.size();
      for (const TrackElement& e : scene->points[p].track) keyframe_of[e.image] = 0;
    }
  }
  if (window_points.empty()) return;
  auto ba = WindowBa::Create({.keyframes = static_cast<int>(keyframe_of.size()),
                              .landmarks = static_cast<int>(window_points.size()),
                              .observations = static_cast<int>(num_observations),
                              .priors = 1});
  if (!ba) return;
  bool held = false;
  for (auto& [i, keyframe] : keyframe_of) {
    const bool fixed = std::find(free.begin(), free.end(), i) == free.end();
    held = held || fixed;
    keyframe = *ba->AddKeyframe(scene->images[i].camera_from_world, 0, fixed);
  }
  if (!held) return;
  for (std::size_t l = 0; l < window_points.size(); ++l) {
    const ScenePoint& point = scene->points[window_points[l]];
    const int landmark = *ba->AddLandmark(point.xyz);
    for (const TrackElement& e : point.track)
      (void)ba->AddObservation(keyframe_of[e.image], landmark,
                               scene->images[e.image].features[e.feature]);
  }
  const AnyCamera camera = *AnyCamera::Create(scene->camera);
  WindowBaOptions solve;
  solve.loss = {LossType::kCauchy, 1.0};
  if (!ba->Solve(std::span(&camera, 1), solve)) return;
  for (const int i : free)
    scene->images[i].camera_from_world = ba->camera_from_world(keyframe_of[i]);
  for (std::size_t l = 0; l < window_points.size(); ++l)
    scene->points[window_points[l]].xyz = ba->point_in_world(static_cast<int>(l));
}

}  // namespace rsfm
