// What refinement works on: images with features and descriptors, placed or not, and the points
// they share. One camera.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "rsfm/base/rigid3.h"
#include "rsfm/base/time.h"
#include "rsfm/estimation/pose_prior.h"
#include "rsfm/io/model.h"
#include "rsfm/mapping/feature.h"
#include "rsfm/refraction/any_camera.h"
#include "tools/offline/bundle.h"

namespace rsfm {

struct SceneImage {
  std::string name;
  Utime utime = 0;
  bool placed = false;
  Rigid3 camera_from_world;          // meaningful where placed
  std::vector<Vec2> features;        // px
  std::vector<float> sizes_px;       // of the features' regions; may be empty
  std::vector<std::int32_t> points;  // per feature: into Scene::points, or kNoPoint
  DescriptorType descriptor_type = DescriptorType::kNone;
  std::vector<std::uint8_t> descriptors;  // rows of DescriptorStride bytes, as many as features

  DescriptorView Descriptors() const;
};

struct ScenePoint {
  Vec3 xyz = Vec3::Zero();
  std::array<std::uint8_t, 3> rgb = {128, 128, 128};
  std::vector<TrackElement> track;  // empty: the point is gone
};

struct Scene {
  CameraConfig camera;
  std::optional<CameraConfig> expected_camera;  // where the priors of what is refined of it pull to
  std::vector<SceneImage> images;
  std::vector<ScenePoint> points;
  std::vector<PosePrior> priors;  // a, b are indices into images

  int NumPlaced() const;
  int NumPoints() const;  // that are not gone
  int NumObservations() const;

  int AddPoint(const Vec3& xyz);
  // Precondition: the feature has no point.
  void Observe(int point, TrackElement element);
  // A point that is left with fewer than two observations is gone with the rest of them.
  void Forget(TrackElement element);
  void RemovePoint(int point);
  void Unplace(int image);  // and forgets its observations
};

// The placed images, the points and their observations as a bundle problem, and back.
struct SceneBundle {
  BundleProblem problem;
  std::vector<int> image_of;  // of each bundle image in the scene
  std::vector<int> point_of;
};
SceneBundle ToBundle(const Scene& scene);
void FromBundle(const SceneBundle& bundle, Scene* scene);

struct FilterOptions {
  double max_error_px = 4.0;
  double min_angle_rad = 0.025;  // of a point's widest pair of viewing directions
  double max_range_m = 1000.0;
  int min_image_observations = 15;  // an image with fewer is no longer placed
};
struct FilterReport {
  int observations = 0;  // removed
  int points = 0;        // removed with all of theirs
  int images = 0;        // no longer placed
};
FilterReport FilterScene(const FilterOptions& options, Scene* scene);

// Mean error over all observations. Precondition: the camera is possible.
ErrorSummary SceneErrors(const Scene& scene);

// Unplaced images are left out. `rig` gives what a scene does not know; its camera is replaced.
Model ModelFromScene(const Scene& scene, const Rig& rig);

}  // namespace rsfm
