// Scenes of the paper's evaluation: 200 points, 30 % outliers, bounds of its programs.
#pragma once

#include <algorithm>
#include <limits>
#include <numbers>
#include <vector>

#include "rsfm/base/rigid3.h"
#include "rsfm/base/rng.h"
#include "rsfm/base/so3.h"
#include "tests/support/rigs.h"

namespace rsfm {

inline Vec2 GaussianPixel(Rng* rng, double sigma) {
  const double x = rng->Gaussian(0.0, sigma);
  return {x, rng->Gaussian(0.0, sigma)};
}

inline Ray3 RandomRay(const AnyCamera& camera, Rng* rng, Vec2* pixel) {
  Ray3 ray;
  do {
    const double x = rng->Uniform(0.0, camera.width());
    *pixel = Vec2(x, rng->Uniform(0.0, camera.height()));
  } while (camera.Backproject(*pixel, &ray) != Projection::kOk);
  return ray;
}

struct AbsoluteScene {
  Rigid3 camera_from_world;
  std::vector<Vec2> pixels;  // the first num_outliers are outliers
  std::vector<Vec3> points_in_world;
  int num_outliers = 0;
};

inline AbsoluteScene MakeAbsoluteScene(const AnyCamera& camera, double noise_px,
                                       double outlier_ratio, int count, Rng* rng) {
  AbsoluteScene scene;
  const double turn = rng->Uniform();
  scene.camera_from_world =
      Rigid3(Quat(1.0, turn, 0.0, 0.0).normalized(), Vec3(rng->Uniform(), 0.0, 0.0));
  const Rigid3 world_from_camera = scene.camera_from_world.Inverse();
  scene.num_outliers = static_cast<int>(outlier_ratio * count);
  for (int i = 0; i < count; ++i) {
    Vec2 pixel;
    const Ray3 ray = RandomRay(camera, rng, &pixel);
    scene.points_in_world.push_back(world_from_camera * ray.At(rng->Uniform(0.5, 10.0)));
    scene.pixels.push_back(pixel + GaussianPixel(rng, noise_px));
    if (i < scene.num_outliers) scene.pixels.back() += GaussianPixel(rng, 200.0);
  }
  return scene;
}

struct RelativeScene {
  Rigid3 b_from_a;
  std::vector<Vec2> pixels_a, pixels_b;  // the first num_outliers are outliers
  int num_outliers = 0;
};

// The paper's second camera: at (8..10, +-2.5, +-2.5) m, looking at a point 6 to 8 m ahead of the
// first.
inline Rigid3 PaperSecondCamera(Rng* rng) {
  const double x = rng->Uniform(8.0, 10.0), y = rng->Uniform(-2.5, 2.5);
  const Vec3 centre(x, y, rng->Uniform(-2.5, 2.5));
  const Vec3 forward = (Vec3(0.0, 0.0, rng->Uniform(6.0, 8.0)) - centre).normalized();
  Mat3 b_from_a;
  b_from_a.row(2) = forward.transpose();
  b_from_a.row(0) = Vec3::UnitY().cross(forward).normalized().transpose();
  b_from_a.row(1) = forward.cross(b_from_a.row(0).transpose()).transpose();
  return {Quat(b_from_a), -b_from_a * centre};
}

// Points at `range(rng, ray)` along rays of the first camera that the second one sees too.
template <class RangeOnRay>
RelativeScene MakeRelativeScene(const AnyCamera& camera, const Rigid3& b_from_a, RangeOnRay range,
                                double noise_px, double outlier_ratio, int count, Rng* rng) {
  RelativeScene scene;
  scene.b_from_a = b_from_a;
  scene.num_outliers = static_cast<int>(outlier_ratio * count);
  for (int tries = 0; static_cast<int>(scene.pixels_a.size()) < count && tries < 1000 * count;
       ++tries) {
    Vec2 pixel_a, pixel_b;
    const Ray3 ray = RandomRay(camera, rng, &pixel_a);
    if (camera.Project(b_from_a * ray.At(range(rng, ray)), &pixel_b) != Projection::kOk) continue;
    if (!camera.IsInImage(pixel_b)) continue;
    const bool is_outlier = static_cast<int>(scene.pixels_a.size()) < scene.num_outliers;
    scene.pixels_a.push_back(pixel_a + GaussianPixel(rng, noise_px));
    scene.pixels_b.push_back(pixel_b + GaussianPixel(rng, noise_px));
    if (is_outlier) scene.pixels_b.back() += GaussianPixel(rng, 200.0);
  }
  return scene;
}

inline RelativeScene MakePaperRelativeScene(const AnyCamera& camera, double noise_px, Rng* rng) {
  const Rigid3 b_from_a = PaperSecondCamera(rng);
  return MakeRelativeScene(
      camera, b_from_a, [](Rng* r, const Ray3&) { return r->Uniform(6.0, 8.0); }, noise_px, 0.3,
      200, rng);
}

inline double Degrees(double radians) { return radians * 180.0 / std::numbers::pi; }

inline double DirectionError(const Rigid3& estimate, const Rigid3& truth) {
  return std::atan2(estimate.translation.cross(truth.translation).norm(),
                    estimate.translation.dot(truth.translation));
}

// The angle in radians plus the distance in metres.
inline double Difference(const Rigid3& a, const Rigid3& b) {
  return AngleBetween(a.rotation, b.rotation) + (a.translation - b.translation).norm();
}

// Infinite where there is no solution.
template <class Solutions>
double Nearest(const Solutions& solutions, const Rigid3& truth) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const Rigid3& pose : solutions) nearest = std::min(nearest, Difference(pose, truth));
  return nearest;
}

}  // namespace rsfm
