#include "tools/offline/scene.h"

#include <algorithm>
#include <cmath>

#include "rsfm/estimation/reprojection_residual.h"

namespace rsfm {

DescriptorView SceneImage::Descriptors() const {
  DescriptorView view;
  view.type = descriptor_type;
  if (descriptor_type == DescriptorType::kNone) return view;
  view.data = descriptors.data();
  view.count = static_cast<int>(descriptors.size()) / DescriptorStride(descriptor_type);
  return view;
}

int Scene::NumPlaced() const {
  return static_cast<int>(
      std::count_if(images.begin(), images.end(), [](const SceneImage& i) { return i.placed; }));
}
int Scene::NumPoints() const {
  return static_cast<int>(std::count_if(points.begin(), points.end(),
                                        [](const ScenePoint& p) { return !p.track.empty(); }));
}
int Scene::NumObservations() const {
  std::size_t count = 0;
  for (const ScenePoint& point : points) count += point.track.size();
  return static_cast<int>(count);
}

int Scene::AddPoint(const Vec3& xyz) {
  points.emplace_back();
  points.back().xyz = xyz;
  return static_cast<int>(points.size()) - 1;
}

void Scene::Observe(int point, TrackElement element) {
  points[point].track.push_back(element);
  images[element.image].points[element.feature] = point;
}

void Scene::Forget(TrackElement element) {
  std::int32_t& place = images[element.image].points[element.feature];
  const int point = place;
  if (point == kNoPoint) return;
  place = kNoPoint;
  std::vector<TrackElement>& track = points[point].track;
  std::erase_if(track, [&element](const TrackElement& e) {
    return e.image == element.image && e.feature == element.feature;
  });
  if (track.size() < 2) RemovePoint(point);
}

void Scene::RemovePoint(int point) {
  for (const TrackElement& e : points[point].track) images[e.image].points[e.feature] = kNoPoint;
  points[point].track.clear();
}

void Scene::Unplace(int image) {
  for (std::size_t f = 0; f < images[image].features.size(); ++f)
    Forget({image, static_cast<std::int32_t>(f)});
  images[image].placed = false;
}

SceneBundle ToBundle(const Scene& scene) {
  SceneBundle bundle;
  bundle.problem.cameras = {scene.camera};
  bundle.problem.expected_cameras = {scene.expected_camera.value_or(scene.camera)};
  std::vector<int> index_of(scene.images.size(), -1);
  for (std::size_t i = 0; i < scene.images.size(); ++i) {
    if (!scene.images[i].placed) continue;
    index_of[i] = static_cast<int>(bundle.image_of.size());
    bundle.image_of.push_back(static_cast<int>(i));
    bundle.problem.images.push_back({scene.images[i].camera_from_world, 0, false});
  }
  for (std::size_t p = 0; p < scene.points.size(); ++p) {
    const ScenePoint& point = scene.points[p];
    if (point.track.empty()) continue;
    const int index = static_cast<int>(bundle.point_of.size());
    bundle.point_of.push_back(static_cast<int>(p));
    bundle.problem.points.push_back(point.xyz);
    for (const TrackElement& e : point.track)
      bundle.problem.observations.push_back(
          {index_of[e.image], index, scene.images[e.image].features[e.feature]});
  }
  for (PosePrior prior : scene.priors) {
    if (!scene.images[prior.a].placed || (prior.IsRelative() && !scene.images[prior.b].placed))
      continue;
    prior.a = index_of[prior.a];
    if (prior.IsRelative()) prior.b = index_of[prior.b];
    bundle.problem.priors.push_back(prior);
  }
  return bundle;
}

void FromBundle(const SceneBundle& bundle, Scene* scene) {
  scene->camera = bundle.problem.cameras[0];
  for (std::size_t i = 0; i < bundle.image_of.size(); ++i)
    scene->images[bundle.image_of[i]].camera_from_world =
        bundle.problem.images[i].camera_from_world;
  for (std::size_t p = 0; p < bundle.point_of.size(); ++p)
    scene->points[bundle.point_of[p]].xyz = bundle.problem.points[p];
}

namespace {

// The cosine of the widest angle under which the track's cameras see the point.
double MinCosine(const Scene& scene, const ScenePoint& point) {
  double cosine = 1.0;
  std::vector<Vec3> directions;
  for (const TrackElement& e : point.track)
    directions.push_back(
        (point.xyz - scene.images[e.image].camera_from_world.OriginOfTarget()).normalized());
  for (std::size_t i = 0; i < directions.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) cosine = std::min(cosine, directions[i].dot(directions[j]));
  return cosine;
}

}  // namespace

FilterReport FilterScene(const FilterOptions& options, Scene* scene) {
  const AnyCamera camera = *AnyCamera::Create(scene->camera);
  FilterReport report;
  const auto remove_point = [&](int point) {
    report.observations += static_cast<int>(scene->points[point].track.size());
    ++report.points;
    scene->RemovePoint(point);
  };
  for (int p = 0; p < static_cast<int>(scene->points.size()); ++p) {
    const ScenePoint& point = scene->points[p];
    if (point.track.empty()) continue;
    const std::vector<TrackElement> track = point.track;
    std::vector<TrackElement> wrong;
    for (const TrackElement& e : track) {
      const SceneImage& image = scene->images[e.image];
      Vec2 error;
      if (ReprojectionError(camera, image.camera_from_world, point.xyz, image.features[e.feature],
                            &error) != Projection::kOk ||
          !(error.norm() <= options.max_error_px) ||
          (image.camera_from_world * point.xyz).norm() > options.max_range_m)
        wrong.push_back(e);
    }
    if (track.size() < wrong.size() + 2) {
      remove_point(p);
      continue;
    }
    for (const TrackElement& e : wrong) scene->Forget(e);
    report.observations += static_cast<int>(wrong.size());
    if (MinCosine(*scene, point) > std::cos(options.min_angle_rad)) remove_point(p);
  }
  for (int i = 0; i < static_cast<int>(scene->images.size()); ++i) {
    const SceneImage& image = scene->images[i];
    if (!image.placed) continue;
    const auto observed = std::count_if(image.points.begin(), image.points.end(),
                                        [](std::int32_t p) { return p != kNoPoint; });
    if (observed >= options.min_image_observations) continue;
    scene->Unplace(i);
    ++report.images;
  }
  return report;
}

ErrorSummary SceneErrors(const Scene& scene) { return *SummariseErrors(ToBundle(scene).problem); }

Model ModelFromScene(const Scene& scene, const Rig& rig) {
  const AnyCamera camera = *AnyCamera::Create(scene.camera);
  Model model;
  model.rig = rig;
  model.rig.camera = scene.camera;
  model.cameras.push_back({1, scene.camera});
  std::vector<int> image_of(scene.images.size(), -1), point_of(scene.points.size(), kNoPoint);
  for (std::size_t i = 0; i < scene.images.size(); ++i) {
    const SceneImage& image = scene.images[i];
    if (!image.placed) continue;
    image_of[i] = static_cast<int>(model.images.size());
    model.images.push_back({0, image.name, image.utime, 0, image.camera_from_world, image.features,
                            std::vector<std::int32_t>(image.features.size(), kNoPoint)});
  }
  for (std::size_t p = 0; p < scene.points.size(); ++p) {
    const ScenePoint& point = scene.points[p];
    if (point.track.empty()) continue;
    point_of[p] = static_cast<int>(model.points.size());
    ModelPoint out;
    out.xyz = point.xyz;
    out.rgb = point.rgb;
    double sum = 0.0;
    for (const TrackElement& e : point.track) {
      const SceneImage& image = scene.images[e.image];
      Vec2 error(0.0, 0.0);
      ReprojectionError(camera, image.camera_from_world, point.xyz, image.features[e.feature],
                        &error);
      sum += error.norm();
      out.track.push_back({image_of[e.image], e.feature});
      model.images[image_of[e.image]].points[e.feature] = point_of[p];
    }
    out.error_px = sum / static_cast<double>(point.track.size());
    model.points.push_back(std::move(out));
  }
  return model;
}

}  // namespace rsfm
