// Scenes from missions and models.
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "tools/offline/refine_mission.h"

namespace rsfm {
namespace {

DescriptorType TypeOf(const keyframe_t& keyframe) {
  switch (keyframe.descriptor_type) {
    case keyframe_t::DESCRIPTOR_ORB:
      return DescriptorType::kOrb;
    case keyframe_t::DESCRIPTOR_SIFT:
      return DescriptorType::kSift;
    case keyframe_t::DESCRIPTOR_AKAZE:
      return DescriptorType::kAkaze;
    default:
      return DescriptorType::kNone;
  }
}

Rigid3 PoseOf(const keyframe_t& k) {
  const Quat q(k.camera_from_world_q[0], k.camera_from_world_q[1], k.camera_from_world_q[2],
               k.camera_from_world_q[3]);
  return {q.normalized(),
          Vec3(k.camera_from_world_t[0], k.camera_from_world_t[1], k.camera_from_world_t[2])};
}

bool HasPose(const keyframe_t& k) {
  const Rigid3 pose = PoseOf(k);
  return k.state == pose_t::STATE_TRACKING && pose.rotation.coeffs().allFinite() &&
         pose.translation.allFinite();
}

void CopyFeatures(const keyframe_t& k, SceneImage* image) {
  image->descriptor_type = TypeOf(k);
  const int bytes = DescriptorBytes(image->descriptor_type);
  if (k.descriptor_bytes != bytes) image->descriptor_type = DescriptorType::kNone;
  const int stride = DescriptorStride(image->descriptor_type);
  image->descriptors.assign(static_cast<std::size_t>(k.num_features) * stride, 0);
  for (int f = 0; f < k.num_features; ++f) {
    image->features.emplace_back(k.x_px[f], k.y_px[f]);
    image->sizes_px.push_back(k.size_px[f]);
    if (stride == 0) continue;
    std::copy_n(k.descriptors.begin() + static_cast<std::ptrdiff_t>(f) * bytes, bytes,
                image->descriptors.begin() + static_cast<std::ptrdiff_t>(f) * stride);
  }
  image->points.assign(image->features.size(), kNoPoint);
}

// Every restart of the mapper begins a world of its own: the one with the most keyframes counts.
int LargestMap(const std::vector<keyframe_t>& keyframes) {
  std::map<int, int> sizes;
  for (const keyframe_t& k : keyframes) sizes[k.reset_counter] += HasPose(k) ? 1 : 0;
  int best = 0, best_size = -1;
  for (const auto& [counter, size] : sizes) {
    if (size <= best_size) continue;
    best = counter;
    best_size = size;
  }
  return best;
}

}  // namespace

Scene SceneFromMission(const Mission& mission) {
  Scene scene;
  scene.camera = mission.rig.camera;
  const int map = LargestMap(mission.keyframes);
  std::map<int, std::vector<TrackElement>> tracks;  // by landmark id
  for (const keyframe_t& k : mission.keyframes) {
    SceneImage image;
    image.name = k.image.empty() ? "keyframe" + std::to_string(k.id) : k.image;
    image.utime = k.utime;
    image.placed = HasPose(k) && k.reset_counter == map;
    if (image.placed) image.camera_from_world = PoseOf(k);
    CopyFeatures(k, &image);
    const int index = static_cast<int>(scene.images.size());
    std::set<int> seen;
    for (int f = 0; f < k.num_features && image.placed; ++f) {
      const int id = k.landmark_id[f];
      const bool finite = image.features[f].allFinite();
      if (id >= 0 && finite && mission.landmarks.contains(id) && seen.insert(id).second)
        tracks[id].push_back({index, f});
    }
    scene.images.push_back(std::move(image));
  }
  for (const auto& [id, track] : tracks) {
    const MissionLandmark& landmark = mission.landmarks.at(id);
    if (track.size() < 2 || !landmark.xyz.allFinite()) continue;
    const int point = scene.AddPoint(landmark.xyz);
    scene.points[point].rgb = landmark.rgb;
    for (const TrackElement& e : track) scene.Observe(point, e);
  }
  return scene;
}

Scene SceneFromModel(const Model& model) {
  Scene scene;
  scene.camera = model.cameras.empty() ? model.rig.camera : model.cameras[0].config;
  for (const ModelImage& from : model.images) {
    SceneImage image;
    image.name = from.name;
    image.utime = from.utime;
    image.placed = true;
    image.camera_from_world = from.camera_from_world;
    image.features = from.features;
    image.points.assign(from.features.size(), kNoPoint);
    scene.images.push_back(std::move(image));
  }
  for (const ModelPoint& from : model.points) {
    if (from.track.size() < 2) continue;
    const int point = scene.AddPoint(from.xyz);
    scene.points[point].rgb = from.rgb;
    for (const TrackElement& e : from.track) scene.Observe(point, e);
  }
  return scene;
}

}  // namespace rsfm
