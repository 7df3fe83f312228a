#include "tools/evaluation/solver_scenes.h"

#include <algorithm>

namespace rsfm {
namespace {

CameraConfig SolverLens() {
  CameraConfig config;
  config.lens = LensModel::kPinhole;
  config.width = 1920;
  config.height = 1080;
  config.lens_params = {1297.37, 1297.37, 960.0, 540.0};
  return config;
}

Vec2 GaussianPixel(Rng* rng, double sigma) {
  const double x = rng->Gaussian(0.0, sigma);
  return {x, rng->Gaussian(0.0, sigma)};
}

Ray3 RandomRay(const AnyCamera& camera, Rng* rng, Vec2* pixel) {
  Ray3 ray;
  do {
    const double x = rng->Uniform(0.0, camera.width());
    *pixel = Vec2(x, rng->Uniform(0.0, camera.height()));
  } while (camera.Backproject(*pixel, &ray) != Projection::kOk);
  return ray;
}

Rigid3 RandomSecondCamera(Rng* rng) {
  const double x = rng->Uniform(8.0, 10.0), y = rng->Uniform(-2.5, 2.5);
  const Vec3 centre(x, y, rng->Uniform(-2.5, 2.5));
  const Vec3 forward = (Vec3(0.0, 0.0, rng->Uniform(6.0, 8.0)) - centre).normalized();
  Mat3 rotation;
  rotation.row(2) = forward.transpose();
  rotation.row(0) = Vec3::UnitY().cross(forward).normalized().transpose();
  rotation.row(1) = forward.cross(rotation.row(0).transpose()).transpose();
  return {Quat(rotation), -rotation * centre};
}

}  // namespace

std::string_view ToString(SolverPort port) {
  switch (port) {
    case SolverPort::kFlat:
      return "flat";
    case SolverPort::kDome:
      return "dome";
    case SolverPort::kCentredDome:
      break;
  }
  return "dome_centered";
}

AnyCamera RandomSolverCamera(SolverPort port, Rng* rng) {
  CameraConfig config = SolverLens();
  if (port == SolverPort::kFlat) {
    config.port.type = PortType::kFlat;
    const double x = rng->Uniform(-0.2, 0.2), y = rng->Uniform(-0.2, 0.2);
    config.port.normal = Vec3(x, y, rng->Uniform(0.8, 1.2)).normalized();
    config.port.distance_m = rng->Uniform(0.001, 0.05);
    config.port.thickness_m = rng->Uniform(0.002, 0.2);
  } else {
    config.port.type = PortType::kDome;
    const double x = rng->Uniform(-0.01, 0.01), y = rng->Uniform(-0.01, 0.01);
    config.port.center_m = Vec3(x, y, rng->Uniform(-0.03, 0.03));
    if (port == SolverPort::kCentredDome) config.port.center_m.setZero();
    config.port.radius_m = rng->Uniform(0.05, 0.07);
    config.port.thickness_m = rng->Uniform(0.005, 0.02);
  }
  return AnyCamera::Create(config).value();
}

AnyCamera SolverCameraInAir() { return AnyCamera::Create(SolverLens()).value(); }

AbsolutePoseScene RandomAbsolutePoseScene(const AnyCamera& camera, double noise_px, int count,
                                          double outlier_ratio, Rng* rng) {
  const AnyCamera in_air = SolverCameraInAir();
  AbsolutePoseScene scene;
  const double turn = rng->Uniform();
  scene.camera_from_world =
      Rigid3(Quat(1.0, turn, 0.0, 0.0).normalized(), Vec3(rng->Uniform(), 0.0, 0.0));
  const Rigid3 world_from_camera = scene.camera_from_world.Inverse();
  const int num_outliers = static_cast<int>(outlier_ratio * count);
  std::vector<double> ranges;
  while (static_cast<int>(scene.pixels.size()) < count) {
    Vec2 pixel, pixel_in_air;
    const Ray3 ray = RandomRay(camera, rng, &pixel);
    const double range = rng->Uniform(0.5, 10.0);
    if (in_air.Project(ray.At(range), &pixel_in_air) != Projection::kOk) continue;
    const bool is_outlier = static_cast<int>(scene.pixels.size()) < num_outliers;
    Vec2 error = GaussianPixel(rng, noise_px);
    if (is_outlier) error += GaussianPixel(rng, 200.0);
    scene.points_in_world.push_back(world_from_camera * ray.At(range));
    scene.pixels.push_back(pixel + error);
    scene.pixels_in_air.push_back(pixel_in_air + error);
    scene.is_outlier.push_back(is_outlier);
    ranges.push_back(range);
  }
  std::nth_element(ranges.begin(), ranges.begin() + count / 2, ranges.end());
  scene.median_range_m = ranges[static_cast<std::size_t>(count) / 2];
  return scene;
}

RelativePoseScene RandomRelativePoseScene(const AnyCamera& camera, double noise_px, int count,
                                          double outlier_ratio, Rng* rng) {
  const AnyCamera in_air = SolverCameraInAir();
  RelativePoseScene scene;
  scene.b_from_a = RandomSecondCamera(rng);
  const int num_outliers = static_cast<int>(outlier_ratio * count);
  for (int tries = 0; static_cast<int>(scene.pixels_a.size()) < count; ++tries) {
    if (tries > 200 * count) {  // a second camera that hardly sees the points of the first
      tries = 0;
      scene = RelativePoseScene();
      scene.b_from_a = RandomSecondCamera(rng);
    }
    Vec2 pixel_a, pixel_b, in_air_a, in_air_b;
    const Vec3 point = RandomRay(camera, rng, &pixel_a).At(rng->Uniform(6.0, 8.0));
    const Vec3 point_in_b = scene.b_from_a * point;
    if (camera.Project(point_in_b, &pixel_b) != Projection::kOk || !camera.IsInImage(pixel_b) ||
        in_air.Project(point, &in_air_a) != Projection::kOk ||
        in_air.Project(point_in_b, &in_air_b) != Projection::kOk) {
      continue;
    }
    const bool is_outlier = static_cast<int>(scene.pixels_a.size()) < num_outliers;
    const Vec2 error_a = GaussianPixel(rng, noise_px);
    Vec2 error_b = GaussianPixel(rng, noise_px);
    if (is_outlier) error_b += GaussianPixel(rng, 200.0);
    scene.exact_a.push_back(pixel_a);
    scene.exact_b.push_back(pixel_b);
    scene.pixels_a.push_back(pixel_a + error_a);
    scene.pixels_b.push_back(pixel_b + error_b);
    scene.in_air_a.push_back(in_air_a + error_a);
    scene.in_air_b.push_back(in_air_b + error_b);
    scene.is_outlier.push_back(is_outlier);
  }
  return scene;
}

}  // namespace rsfm
