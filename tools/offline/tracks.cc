#include "tools/offline/tracks.h"

#include <algorithm>

#include "rsfm/estimation/reprojection_residual.h"
#include "rsfm/estimation/triangulation.h"

namespace rsfm {

CorrespondenceGraph::CorrespondenceGraph(const Scene& scene,
                                         const std::vector<VerifiedPair>& pairs) {
  std::size_t total = 0;
  for (const SceneImage& image : scene.images) {
    offset_.push_back(total);
    total += image.features.size();
  }
  first_.assign(total + 2, 0);
  for (const VerifiedPair& pair : pairs) {
    for (const auto& [a, b] : pair.matches) {
      ++first_[Node({pair.images.a, a}) + 2];
      ++first_[Node({pair.images.b, b}) + 2];
    }
  }
  for (std::size_t i = 2; i < first_.size(); ++i) first_[i] += first_[i - 1];
  neighbours_.resize(first_.back());
  // first_[node + 1] runs along the node's list and ends where the next begins.
  for (const VerifiedPair& pair : pairs) {
    for (const auto& [a, b] : pair.matches) {
      const TrackElement in_a{pair.images.a, a}, in_b{pair.images.b, b};
      neighbours_[first_[Node(in_a) + 1]++] = in_b;
      neighbours_[first_[Node(in_b) + 1]++] = in_a;
    }
  }
}

namespace {

class TrackUpdate {
 public:
  TrackUpdate(const CorrespondenceGraph& graph, const TrackOptions& options, Scene* scene)
      : graph_(graph),
        options_(options),
        scene_(*scene),
        camera_(*AnyCamera::Create(scene->camera)) {
    triangulation_.max_error_px = options.max_error_px;
    triangulation_.min_angle_rad = options.min_angle_rad;
    triangulation_.max_range_m = options.max_range_m;
  }

  // Adds matched features of a point's observations that see it too, and theirs.
  void Complete(int point) {
    std::vector<TrackElement> queue = scene_.points[point].track;
    for (std::size_t i = 0; i < queue.size(); ++i) {
      for (const TrackElement& e : graph_.Neighbours(queue[i])) {
        if (!IsFree(e) || IsSeenBy(point, e.image) || !Fits(scene_.points[point].xyz, e)) continue;
        scene_.Observe(point, e);
        queue.push_back(e);
        ++report_.completed;
      }
    }
  }

  // Merges the point with points of matched features, where one place fits all observations.
  void Merge(int point) {
    const std::vector<TrackElement> track = scene_.points[point].track;
    for (const TrackElement& e : track) {
      for (const TrackElement& n : graph_.Neighbours(e)) {
        const int other = scene_.images[n.image].points[n.feature];
        if (other == kNoPoint || other == point) continue;
        if (TryMerge(point, other)) ++report_.merged;
      }
    }
  }

  // A new point of a free feature and the free features it was matched with.
  void Create(TrackElement seed) {
    if (!IsFree(seed)) return;
    std::vector<TrackElement> group = {seed};
    const auto add = [&](TrackElement e) {
      const bool new_image = std::none_of(
          group.begin(), group.end(), [&e](const TrackElement& g) { return g.image == e.image; });
      if (new_image && IsFree(e)) group.push_back(e);
    };
    for (const TrackElement& e : graph_.Neighbours(seed)) add(e);
    const std::size_t direct = group.size();
    for (std::size_t i = 1; i < direct; ++i)
      for (const TrackElement& e : graph_.Neighbours(group[i])) add(e);
    if (group.size() > kMaxTriangulationViews) group.resize(kMaxTriangulationViews);
    if (group.size() < 2) return;
    std::vector<TriangulationView> views;
    for (const TrackElement& e : group)
      views.push_back({&camera_, scene_.images[e.image].camera_from_world,
                       scene_.images[e.image].features[e.feature]});
    std::vector<std::uint8_t> inliers(views.size());
    const auto found = TriangulateRobust(views, triangulation_, 2, inliers);
    // The seed's own view must be among them: the others have their turn as seeds.
    if (!found || inliers[0] == 0) return;
    const int point = scene_.AddPoint(found->point_in_world);
    for (std::size_t i = 0; i < group.size(); ++i)
      if (inliers[i] != 0) scene_.Observe(point, group[i]);
    ++report_.created;
    report_.created_observations += static_cast<int>(scene_.points[point].track.size());
  }

  const TrackReport& report() const { return report_; }

 private:
  bool IsFree(const TrackElement& e) const {
    const SceneImage& image = scene_.images[e.image];
    return image.placed && image.points[e.feature] == kNoPoint;
  }
  bool IsSeenBy(int point, int image) const {
    const auto& track = scene_.points[point].track;
    return std::any_of(track.begin(), track.end(),
                       [image](const TrackElement& e) { return e.image == image; });
  }
  bool Fits(const Vec3& xyz, const TrackElement& e) const {
    const SceneImage& image = scene_.images[e.image];
    Vec2 error;
    return ReprojectionError(camera_, image.camera_from_world, xyz, image.features[e.feature],
                             &error) == Projection::kOk &&
           error.squaredNorm() <= options_.max_error_px * options_.max_error_px;
  }
  bool TryMerge(int point, int other) {
    const ScenePoint& a = scene_.points[point];
    const ScenePoint& b = scene_.points[other];
    const double weight_a = static_cast<double>(a.track.size());
    const double weight_b = static_cast<double>(b.track.size());
    const Vec3 xyz = (weight_a * a.xyz + weight_b * b.xyz) / (weight_a + weight_b);
    for (const TrackElement& e : b.track)
      if (IsSeenBy(point, e.image)) return false;
    for (const ScenePoint* p : {&a, &b})
      for (const TrackElement& e : p->track)
        if (!Fits(xyz, e)) return false;
    const std::vector<TrackElement> moved = b.track;
    scene_.RemovePoint(other);
    scene_.points[point].xyz = xyz;
    for (const TrackElement& e : moved) scene_.Observe(point, e);
    return true;
  }

  const CorrespondenceGraph& graph_;
  const TrackOptions& options_;
  Scene& scene_;
  AnyCamera camera_;
  TriangulationOptions triangulation_;
  TrackReport report_;
};

}  // namespace

TrackReport UpdateTracks(const CorrespondenceGraph& graph, const TrackOptions& options,
                         Scene* scene) {
  TrackUpdate update(graph, options, scene);
  const int num_points = static_cast<int>(scene->points.size());
  for (int p = 0; p < num_points; ++p) update.Complete(p);
  for (int p = 0; p < num_points; ++p) update.Merge(p);
  for (int i = 0; i < static_cast<int>(scene->images.size()); ++i)
    for (int f = 0; f < static_cast<int>(scene->images[i].features.size()); ++f)
      update.Create({i, f});
  return update.report();
}

TrackReport UpdateTracksOf(int image, const CorrespondenceGraph& graph, const TrackOptions& options,
                           Scene* scene) {
  TrackUpdate update(graph, options, scene);
  for (int f = 0; f < static_cast<int>(scene->images[image].features.size()); ++f) {
    const int point = scene->images[image].points[f];
    if (point == kNoPoint) {
      // A matched feature's point may be the one; else a new one.
      for (const TrackElement& n : graph.Neighbours({image, f})) {
        const int other = scene->images[n.image].points[n.feature];
        if (other != kNoPoint) update.Complete(other);
        if (scene->images[image].points[f] != kNoPoint) break;
      }
      update.Create({image, f});
    } else {
      update.Complete(point);
    }
  }
  return update.report();
}

}  // namespace rsfm
