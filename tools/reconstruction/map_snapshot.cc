#include "tools/reconstruction/map_snapshot.h"

#include <algorithm>

namespace rsfm {
namespace {

void AppendVector(const Eigen::Ref<const Eigen::VectorXd>& values, std::string* bytes) {
  for (const double value : values) AppendBinary(bytes, value);
}

template <int N>
bool ReadVector(BinaryReader* reader, Eigen::Matrix<double, N, 1>* values) {
  for (int i = 0; i < N; ++i) reader->Read(&(*values)[i]);
  return reader->is_good() && values->allFinite();
}

bool ReadPoint(BinaryReader* reader, const Scene& scene, ScenePoint* point) {
  std::uint32_t length = 0;
  if (!ReadVector<3>(reader, &point->xyz) || !reader->Read(&length) || !reader->CanHold(length, 8))
    return false;
  point->track.resize(length);
  for (TrackElement& e : point->track) {
    reader->Read(&e.image);
    reader->Read(&e.feature);
    if (e.image < 0 || e.image >= static_cast<int>(scene.images.size()) || e.feature < 0 ||
        e.feature >= static_cast<int>(scene.images[e.image].features.size()))
      return false;
  }
  return true;
}

}  // namespace

MapSnapshot TakeSnapshot(const Scene& scene) {
  MapSnapshot snapshot;
  snapshot.camera = scene.camera;
  for (int i = 0; i < static_cast<int>(scene.images.size()); ++i)
    if (scene.images[i].placed) snapshot.poses.emplace_back(i, scene.images[i].camera_from_world);
  for (const ScenePoint& point : scene.points)
    if (!point.track.empty()) snapshot.points.push_back(point);
  return snapshot;
}

void PutBack(const MapSnapshot& snapshot, Scene* scene) {
  scene->camera = snapshot.camera;
  for (SceneImage& image : scene->images) {
    image.placed = false;
    std::fill(image.points.begin(), image.points.end(), kNoPoint);
  }
  scene->points.clear();
  scene->priors.clear();
  for (const auto& [index, pose] : snapshot.poses) {
    scene->images[index].placed = true;
    scene->images[index].camera_from_world = pose;
  }
  for (const ScenePoint& point : snapshot.points) {
    const int index = scene->AddPoint(point.xyz);
    scene->points[index].rgb = point.rgb;
    for (const TrackElement& e : point.track) scene->Observe(index, e);
  }
}

void AppendSnapshot(const MapSnapshot& snapshot, std::string* bytes) {
  for (const double value : snapshot.camera.lens_params) AppendBinary(bytes, value);
  for (const double value : snapshot.camera.port.Params()) AppendBinary(bytes, value);
  AppendBinary(bytes, static_cast<std::uint32_t>(snapshot.poses.size()));
  for (const auto& [index, pose] : snapshot.poses) {
    AppendBinary(bytes, static_cast<std::int32_t>(index));
    AppendVector(pose.rotation.coeffs(), bytes);
    AppendVector(pose.translation, bytes);
  }
  AppendBinary(bytes, static_cast<std::uint32_t>(snapshot.points.size()));
  for (const ScenePoint& point : snapshot.points) {
    AppendVector(point.xyz, bytes);
    AppendBinary(bytes, static_cast<std::uint32_t>(point.track.size()));
    for (const TrackElement& e : point.track) {
      AppendBinary(bytes, e.image);
      AppendBinary(bytes, e.feature);
    }
  }
}

bool ReadSnapshot(BinaryReader* reader, const Scene& scene, MapSnapshot* snapshot) {
  *snapshot = {};
  snapshot->camera = scene.camera;
  for (double& value : snapshot->camera.lens_params) reader->Read(&value);
  PortParams port = {};
  for (double& value : port) reader->Read(&value);
  if (!reader->is_good()) return false;
  snapshot->camera.port.SetParams(port);
  if (!AnyCamera::Create(snapshot->camera)) return false;
  std::uint32_t count = 0;
  if (!reader->Read(&count) || !reader->CanHold(count, 60)) return false;
  for (std::uint32_t i = 0; i < count; ++i) {
    std::int32_t index = -1;
    Vec4 rotation = Vec4::Zero();
    Rigid3 pose;
    if (!reader->Read(&index) || !ReadVector<4>(reader, &rotation) ||
        !ReadVector<3>(reader, &pose.translation) || index < 0 ||
        index >= static_cast<int>(scene.images.size()) || std::abs(rotation.norm() - 1.0) > 1e-6)
      return false;
    pose.rotation.coeffs() = rotation;
    snapshot->poses.emplace_back(index, pose);
  }
  if (!reader->Read(&count) || !reader->CanHold(count, 28)) return false;
  snapshot->points.resize(count);
  return std::all_of(snapshot->points.begin(), snapshot->points.end(),
                     [&](ScenePoint& point) { return ReadPoint(reader, scene, &point); });
}

}  // namespace rsfm
