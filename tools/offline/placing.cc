#include "tools/offline/placing.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>

#include "rsfm/estimation/absolute_pose.h"
#include "rsfm/estimation/triangulation.h"
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

}  // namespace

bool AdjustAndFilter(const PlacingOptions& options, Scene* scene) {
  SceneBundle bundle = ToBundle(*scene);
  BundleOptions adjust;
  adjust.max_iterations = 30;
  if (!AdjustBundle(adjust, &bundle.problem)) return false;
  FromBundle(bundle, scene);
  FilterScene(options.filter, scene);
  return true;
}

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
    if (!AdjustAndFilter(options, &trial)) continue;
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

namespace {

// The matches of a pair as points in a's frame, for a baseline of length one, with the pose of b
// that fits them best.
struct UnitPair {
  Rigid3 b_from_a;
  std::vector<int> matches;  // indices of those that made a point
  std::vector<Vec3> points_in_a;
};

std::optional<UnitPair> RefinePair(const VerifiedPair& pair, const PlacingOptions& options,
                                   const Scene& scene) {
  const AnyCamera camera = *AnyCamera::Create(scene.camera);
  TriangulationOptions triangulation;
  triangulation.max_error_px = 3.0 * options.max_error_px;
  triangulation.min_angle_rad = options.tracks.min_angle_rad;
  UnitPair unit;
  const int count = static_cast<int>(pair.matches.size());
  auto ba = WindowBa::Create(
      {.keyframes = 2, .landmarks = count, .observations = 2 * count, .priors = 1});
  if (!ba || !ba->AddKeyframe(Rigid3(), 0, true) || !ba->AddKeyframe(pair.b_from_a)) return {};
  for (int i = 0; i < count; ++i) {
    const Vec2& in_a = scene.images[pair.images.a].features[pair.matches[i].first];
    const Vec2& in_b = scene.images[pair.images.b].features[pair.matches[i].second];
    const TriangulationView views[] = {{&camera, Rigid3(), in_a}, {&camera, pair.b_from_a, in_b}};
    const auto point = Triangulate(views, triangulation);
    if (!point) continue;
    const auto landmark = ba->AddLandmark(point->point_in_world);
    if (!landmark || !ba->AddObservation(0, *landmark, in_a) ||
        !ba->AddObservation(1, *landmark, in_b))
      return {};
    unit.matches.push_back(i);
  }
  if (static_cast<int>(unit.matches.size()) < options.min_pair_matches) return {};
  const auto length = MakeBaselinePrior(0, 1, Rigid3(), 1.0, 1e-3);
  WindowBaOptions solve;
  solve.loss = {LossType::kCauchy, 1.0};
  solve.max_iterations = 50;
  if (!length || !ba->AddPrior(*length) || !ba->Solve(std::span(&camera, 1), solve)) return {};
  unit.b_from_a = ba->camera_from_world(1);
  for (int l = 0; l < ba->num_landmarks(); ++l) unit.points_in_a.push_back(ba->point_in_world(l));
  return unit;
}

// The factor from the unit baseline to the scene, from the points that the placed image observes.
std::optional<double> BaselineLength(const VerifiedPair& pair, const UnitPair& unit, bool a_placed,
                                     const PlacingOptions& options, const Scene& scene) {
  const SceneImage& placed = scene.images[a_placed ? pair.images.a : pair.images.b];
  std::vector<double> factors;
  for (std::size_t i = 0; i < unit.matches.size(); ++i) {
    const auto& match = pair.matches[unit.matches[i]];
    const int point = placed.points[a_placed ? match.first : match.second];
    if (point == kNoPoint) continue;
    const Vec3 in_unit = a_placed ? unit.points_in_a[i] : unit.b_from_a * unit.points_in_a[i];
    const Vec3 in_scene = placed.camera_from_world * scene.points[point].xyz;
    factors.push_back(in_scene.norm() / in_unit.norm());
  }
  if (static_cast<int>(factors.size()) < options.min_scale_points) return {};
  std::sort(factors.begin(), factors.end());
  const double median = factors[factors.size() / 2];
  const auto agree = std::count_if(factors.begin(), factors.end(), [median](double f) {
    return std::abs(f - median) < 0.1 * median;
  });
  const bool enough =
      agree >= options.min_scale_points && 2 * agree >= static_cast<std::ptrdiff_t>(factors.size());
  return enough ? std::optional(median) : std::nullopt;
}

}  // namespace

bool PlaceByPair(const std::vector<VerifiedPair>& pairs, const CorrespondenceGraph& graph,
                 const PlacingOptions& options, std::vector<std::uint8_t>* tried, Scene* scene,
                 int* placed) {
  std::vector<std::size_t> order(pairs.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&pairs](std::size_t x, std::size_t y) {
    return pairs[x].matches.size() > pairs[y].matches.size();
  });
  tried->resize(pairs.size(), 0);
  for (const std::size_t index : order) {
    const VerifiedPair& pair = pairs[index];
    const bool a_placed = scene->images[pair.images.a].placed;
    if (a_placed == scene->images[pair.images.b].placed || (*tried)[index] != 0) continue;
    if (static_cast<int>(pair.matches.size()) < options.min_pair_matches) break;
    (*tried)[index] = 1;
    const auto unit = RefinePair(pair, options, *scene);
    if (!unit) continue;
    const auto length = BaselineLength(pair, *unit, a_placed, options, *scene);
    if (!length) continue;
    Rigid3 b_from_a = unit->b_from_a;
    b_from_a.translation *= *length;
    *placed = a_placed ? pair.images.b : pair.images.a;
    SceneImage& image = scene->images[*placed];
    const SceneImage& from = scene->images[a_placed ? pair.images.a : pair.images.b];
    image.placed = true;
    image.camera_from_world = (a_placed ? b_from_a : b_from_a.Inverse()) * from.camera_from_world;
    TrackOptions generous = options.tracks;
    generous.max_error_px = std::max(options.max_error_px, options.tracks.max_error_px);
    UpdateTracksOf(*placed, graph, generous, scene);
    return true;
  }
  return false;
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
