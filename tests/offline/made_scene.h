// A survey as a scene to be refined: features with descriptors that match, keyframes placed or not.
#pragma once

#include <string>

#include "tests/support/rigs.h"
#include "tests/support/survey.h"
#include "tools/offline/scene.h"

namespace rsfm {

// The paper's lens behind a tilted window.
inline CameraConfig FlatRig(double distance_m = 0.02) {
  CameraConfig config = PaperLens();
  config.port.type = PortType::kFlat;
  config.port.normal = Vec3(0.05, -0.03, 1.0).normalized();
  config.port.distance_m = distance_m;
  config.port.thickness_m = 0.01;
  return config;
}

struct MadeSceneOptions {
  bool placed = true;          // poses and tracks as the survey has them
  double feature_noise = 3.0;  // of each byte of a descriptor
  int clutter = 40;            // features of no point, in each image
  int look_alikes = 1;         // that many points share one descriptor
  double wrong_tracks = 0.0;   // part of the observations given a wrong pixel
};

inline Scene MakeScene(const CameraConfig& camera, const Survey& survey,
                       const MadeSceneOptions& options = {}) {
  Rng rng(99);
  Scene scene;
  scene.camera = camera;
  constexpr int kBytes = 128;
  const auto random_row = [&rng] {
    std::vector<std::uint8_t> row(kBytes);
    for (std::uint8_t& value : row) value = static_cast<std::uint8_t>(rng.Index(90));
    return row;
  };
  std::vector<std::vector<std::uint8_t>> of_point;
  for (std::size_t p = 0; p < survey.points.size(); ++p)
    of_point.push_back(p % options.look_alikes == 0 ? random_row() : of_point.back());
  for (std::size_t k = 0; k < survey.camera_from_world.size(); ++k) {
    SceneImage image;
    image.name = "image" + std::to_string(100 + k) + ".jpg";
    image.utime = 1'000'000 * static_cast<Utime>(k + 1);
    image.placed = options.placed;
    image.camera_from_world = options.placed ? survey.camera_from_world[k] : Rigid3();
    image.descriptor_type = DescriptorType::kSift;
    scene.images.push_back(std::move(image));
  }
  const auto add_feature = [&](int k, const Vec2& pixel, const std::vector<std::uint8_t>& row) {
    SceneImage& image = scene.images[k];
    image.features.push_back(pixel);
    image.sizes_px.push_back(static_cast<float>(rng.Uniform(3.0, 20.0)));
    image.points.push_back(kNoPoint);
    for (const std::uint8_t value : row) {
      const double noisy = value + rng.Gaussian(0.0, options.feature_noise);
      image.descriptors.push_back(static_cast<std::uint8_t>(std::clamp(noisy, 0.0, 255.0)));
    }
    return static_cast<std::int32_t>(image.features.size()) - 1;
  };
  std::vector<int> point_of(survey.points.size(), kNoPoint);
  for (const SurveyObservation& o : survey.observations) {
    Vec2 pixel = o.pixel;
    if (rng.Uniform() < options.wrong_tracks)
      pixel = Vec2(rng.Uniform(0.0, camera.width), rng.Uniform(0.0, camera.height));
    const std::int32_t feature = add_feature(o.image, pixel, of_point[o.point]);
    if (!options.placed) continue;
    if (point_of[o.point] == kNoPoint) point_of[o.point] = scene.AddPoint(survey.points[o.point]);
    scene.Observe(point_of[o.point], {o.image, feature});
  }
  for (std::size_t k = 0; k < scene.images.size(); ++k)
    for (int i = 0; i < options.clutter; ++i)
      add_feature(static_cast<int>(k),
                  Vec2(rng.Uniform(0.0, camera.width), rng.Uniform(0.0, camera.height)),
                  random_row());
  return scene;
}

}  // namespace rsfm
