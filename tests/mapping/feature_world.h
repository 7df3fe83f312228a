// A seabed of random points, each with a descriptor of its own, seen through any camera: feature
// tracks without images, for the mapper's tests and benchmarks.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "rsfm/base/rigid3.h"
#include "rsfm/base/rng.h"
#include "rsfm/base/so3.h"
#include "rsfm/mapping/feature.h"
#include "rsfm/navigation/nav_sample.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

enum class TestPort { kNone, kFlat, kDome };

inline AnyCamera TestCamera(TestPort type) {
  CameraConfig config;
  config.lens = LensModel::kPinhole;
  config.width = 800;
  config.height = 600;
  for (const double p : {600.0, 600.0, 400.0, 300.0}) config.lens_params.TryPushBack(p);
  if (type == TestPort::kFlat) {
    config.port.type = PortType::kFlat;
    config.port.normal = Vec3(0.06, -0.04, 1.0).normalized();
    config.port.distance_m = 0.03;
    config.port.thickness_m = 0.02;
  } else if (type == TestPort::kDome) {
    config.port.type = PortType::kDome;
    config.port.center_m = Vec3(0.004, -0.003, 0.006);
    config.port.radius_m = 0.06;
    config.port.thickness_m = 0.008;
  }
  return AnyCamera::Create(config).value();
}

struct FeatureWorldOptions {
  std::uint64_t seed = 1;
  double length_m = 20.0, width_m = 6.0;  // north, east
  double depth_m = 10.0;                  // of the bottom
  double relief_m = 0.6;                  // of the points, about it
  int num_points = 6000;
  double noise_px = 0.5;
  double clutter = 0.2;  // of the features: nothing that is seen again
  int max_features = 600;
  double repeat_m = 0.0;  // > 0: the bottom looks the same again after so far north
  double missed = 0.0;    // of the points, in turn: not found for ten frames although in sight
};

// One frame's memory.
struct FeatureFrame {
  std::vector<Feature> features;
  std::vector<std::uint8_t> descriptors;

  FrameObservations View(Utime utime, bool with_descriptors = true) const {
    const DescriptorView none{nullptr, 0, DescriptorType::kSift};
    const DescriptorView all{descriptors.data(), static_cast<int>(features.size()),
                             DescriptorType::kSift};
    return {utime, features, with_descriptors ? all : none};
  }
};

class FeatureWorld {
 public:
  explicit FeatureWorld(const FeatureWorldOptions& options) : options_(options) {
    Rng rng(options.seed);
    for (int i = 0; i < options.num_points; ++i) {
      points_.push_back({rng.Uniform(-2.0, options.length_m + 2.0),
                         rng.Uniform(-0.5, 0.5) * options.width_m,
                         options.depth_m + rng.Uniform(-0.5, 0.5) * options.relief_m});
      for (int k = 0; k < 128; ++k) descriptors_.push_back(RandomByte(&rng));
    }
    if (options.repeat_m > 0.0) Repeat(options.repeat_m);
  }

  const std::vector<Vec3>& points() const { return points_; }

  // What the camera sees there: features in ascending order of track (the point's number), each
  // displaced by noise; then clutter. `seed` makes the noise; it goes up by one from frame to
  // frame.
  FeatureFrame See(const AnyCamera& camera, const Rigid3& camera_from_world,
                   std::uint64_t seed) const {
    Rng rng(seed * 7919 + options_.seed);
    FeatureFrame frame;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      Vec2 pixel;
      const Vec3 point_in_camera = camera_from_world * points_[i];
      if (point_in_camera.norm() > 6.0 || IsMissed(i, seed)) continue;
      if (camera.Project(point_in_camera, &pixel) != Projection::kOk) continue;
      pixel += options_.noise_px * Vec2(rng.Gaussian(), rng.Gaussian());
      if (!camera.IsInImage(pixel)) continue;
      if (frame.features.size() >=
          static_cast<std::size_t>(options_.max_features * (1.0 - options_.clutter)))
        break;
      Add(pixel, static_cast<std::uint32_t>(i), &frame);
      for (std::size_t k = 0; k < 128; ++k) {
        const int noisy =
            descriptors_[i * 128 + k] + static_cast<int>(std::lround(rng.Gaussian(0.0, 6.0)));
        frame.descriptors.push_back(static_cast<std::uint8_t>(std::clamp(noisy, 0, 255)));
      }
    }
    AddClutter(camera, static_cast<int>(options_.clutter * options_.max_features), &rng, &frame);
    return frame;
  }

  // An image that shows nothing known.
  FeatureFrame SeeNothing(const AnyCamera& camera, std::uint64_t seed) const {
    Rng rng(seed * 104729 + 17);
    FeatureFrame frame;
    AddClutter(camera, options_.max_features / 2, &rng, &frame);
    return frame;
  }

 private:
  bool IsMissed(std::size_t point, std::uint64_t seed) const {
    constexpr std::uint64_t kFrames = 10;
    if (options_.missed <= 0.0) return false;
    Rng rng(point * 15485863 + (seed + point) / kFrames);
    return rng.Uniform() < options_.missed;
  }
  static std::uint8_t RandomByte(Rng* rng) { return static_cast<std::uint8_t>(rng->Index(92)); }
  // Keeps the points of the first period, and lays them out again to the end, descriptors and all.
  void Repeat(double period_m) {
    std::vector<Vec3> points;
    std::vector<std::uint8_t> descriptors;
    for (double shift = 0.0; shift < options_.length_m + 4.0; shift += period_m) {
      for (std::size_t i = 0; i < points_.size(); ++i) {
        if (points_[i].x() >= period_m - 2.0) continue;
        points.push_back(points_[i] + Vec3(shift, 0.0, 0.0));
        const auto row = descriptors_.begin() + static_cast<std::ptrdiff_t>(i) * 128;
        descriptors.insert(descriptors.end(), row, row + 128);
      }
    }
    points_ = std::move(points);
    descriptors_ = std::move(descriptors);
  }
  static void Add(const Vec2& pixel, std::uint32_t track, FeatureFrame* frame) {
    Feature feature{static_cast<float>(pixel.x()), static_cast<float>(pixel.y()), 8.0f};
    feature.track = track;
    frame->features.push_back(feature);
  }
  static void AddClutter(const AnyCamera& camera, int count, Rng* rng, FeatureFrame* frame) {
    for (int i = 0; i < count; ++i) {
      Add({rng->Uniform(0.0, camera.width()), rng->Uniform(0.0, camera.height())}, kNoTrack, frame);
      for (int k = 0; k < 128; ++k) frame->descriptors.push_back(RandomByte(rng));
    }
  }

  FeatureWorldOptions options_;
  std::vector<Vec3> points_;
  std::vector<std::uint8_t> descriptors_;
};

// body_from_camera of a camera that looks down, its image's top ahead.
inline Rigid3 DownwardCamera() {
  Mat3 rotation;  // columns: camera x (right), y (down in the image: back), z (down) in FRD
  rotation << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  return {Quat(rotation), Vec3(0.3, 0.05, 0.1)};
}

// A vehicle that goes north over the seabed, weaving and rolling a little.
inline Rigid3 SurveyBody(double seconds, double speed_mps = 0.3, double height_depth_m = 8.0) {
  const double yaw = 0.1 * std::sin(0.3 * seconds);
  const Quat rotation = ExpSo3(Vec3(0, 0, yaw)) *
                        ExpSo3(Vec3(0, 0.04 * std::sin(0.7 * seconds), 0)) *
                        ExpSo3(Vec3(0.03 * std::cos(0.9 * seconds), 0, 0));
  return {rotation.normalized(), Vec3(speed_mps * seconds, 0.4 * std::sin(0.2 * seconds),
                                      height_depth_m + 0.1 * std::sin(0.5 * seconds))};
}

}  // namespace rsfm
