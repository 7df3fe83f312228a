#include "tools/check/transect.h"

#include <algorithm>
#include <cmath>

#include "tools/offline/bundle.h"

namespace rsfm {
namespace {

constexpr int kMinObservations = 12;

// World: x along the track, y to the right, z down, the seabed at z = 0. The camera's image y axis
// points backwards along the track.
Rigid3 CameraFromWorld(double along_m, double altitude_m) {
  Mat3 rotation;  // rows: the camera's axes in the world
  rotation << 0, 1, 0, -1, 0, 0, 0, 0, 1;
  const Rigid3 world_from_camera(Quat(Mat3(rotation.transpose())), Vec3(along_m, 0, -altitude_m));
  return world_from_camera.Inverse();
}

// The seabed point's pixel in the undistorted image, by the exact rays.
bool Observe(const PinholeInWater& pinhole, const Vec3& point_in_camera, Vec2* undistorted) {
  const AnyCamera& camera = pinhole.camera();
  Vec2 pixel;
  return camera.Project(point_in_camera, &pixel) == Projection::kOk && camera.IsInImage(pixel) &&
         pinhole.Undistort(pixel, undistorted);
}

// What one image sees of the seabed: half its extent along the track (the shorter way) and across,
// found by stepping outwards from the middle.
Vec2 HalfFootprint(const PinholeInWater& pinhole, double altitude_m) {
  constexpr int kSteps = 400;
  const double step = 2.0 * altitude_m / kSteps;
  const Rigid3 camera_from_world = CameraFromWorld(0.0, altitude_m);
  Vec2 half = Vec2::Zero(), ignored;
  for (int axis = 0; axis < 2; ++axis) {
    for (int i = 1; i <= kSteps; ++i) {
      Vec3 ahead = Vec3::Zero(), behind = Vec3::Zero();
      ahead[axis] = i * step;
      behind[axis] = -i * step;
      if (!Observe(pinhole, camera_from_world * ahead, &ignored) ||
          !Observe(pinhole, camera_from_world * behind, &ignored)) {
        break;
      }
      half[axis] = i * step;
    }
  }
  return half;
}

BundleProblem MakeStrip(const PinholeInWater& pinhole, const TransectOptions& options,
                        const Vec2& half, double spacing_m, int num_images) {
  BundleProblem problem;
  const CameraConfig& config = pinhole.camera().config();
  CameraConfig ideal;
  ideal.lens = LensModel::kPinhole;
  ideal.width = config.width;
  ideal.height = config.height;
  const BestFitPerspective& fit = pinhole.fit();
  ideal.lens_params = {fit.fx, fit.fy, fit.cx, fit.cy};
  problem.cameras = {ideal};
  for (int i = 0; i < num_images; ++i)
    problem.images.push_back({CameraFromWorld(i * spacing_m, options.altitude_m), 0, false});
  const double step_along = 2.0 * half.x() / options.rows;
  const double end = (num_images - 1) * spacing_m + half.x();
  for (double along = -half.x() + 0.5 * step_along; along < end; along += step_along) {
    for (int column = 0; column < options.columns; ++column) {
      const Vec3 point(along, half.y() * (2.0 * (column + 0.5) / options.columns - 1.0), 0.0);
      std::vector<BundleObservation> seen;
      for (int i = 0; i < num_images; ++i) {
        if (std::abs(i * spacing_m - along) > 1.5 * half.x()) continue;
        Vec2 pixel;
        if (Observe(pinhole, problem.images[i].camera_from_world * point, &pixel))
          seen.push_back({i, static_cast<int>(problem.points.size()), pixel});
      }
      if (seen.size() < 2) continue;
      problem.points.push_back(point);
      problem.observations.insert(problem.observations.end(), seen.begin(), seen.end());
    }
  }
  return problem;
}

// Of a track, in its own length: the middle's distance from the line between the ends, along the
// middle's own view.
double Sagitta(const std::vector<BundleImage>& images) {
  const auto place = [&](std::size_t i) { return images[i].camera_from_world.OriginOfTarget(); };
  const std::size_t last = images.size() - 1;
  // An even number of images has no middle one: the mean of the two.
  const Vec3 middle = 0.5 * (place(last / 2) + place(last - last / 2));
  const Vec3 down = images[last / 2].camera_from_world.rotation.conjugate() * Vec3::UnitZ();
  return (middle - 0.5 * (place(0) + place(last))).dot(down);
}

}  // namespace

Expected<TransectReport> SimulateTransect(const PinholeInWater& pinhole,
                                          const TransectOptions& options) {
  if (!(options.length_m > 0.0)) return Fail(Errc::kInvalidArgument, "length_m");
  if (!(options.altitude_m > 0.0)) return Fail(Errc::kInvalidArgument, "altitude_m");
  if (!(options.forward_overlap > 0.5 && options.forward_overlap < 1.0))
    return Fail(Errc::kInvalidArgument, "forward_overlap");
  if (options.rows < 4 || options.columns < 2 || options.max_images < 3)
    return Fail(Errc::kInvalidArgument, "rows, columns or max_images");
  const Vec2 half = HalfFootprint(pinhole, options.altitude_m);
  if (!(half.minCoeff() > 0.0)) return Fail(Errc::kNotEnoughData, "footprint");
  const double widest_m = 2.0 * half.x() * (1.0 - options.forward_overlap);
  const double asked = std::max(2.0, std::ceil(options.length_m / widest_m));
  const double spacing_m = std::min(widest_m, options.length_m / asked);
  const int num_images =
      static_cast<int>(std::min(asked + 1.0, static_cast<double>(options.max_images)));
  BundleProblem problem = MakeStrip(pinhole, options, half, spacing_m, num_images);
  if (static_cast<int>(problem.observations.size()) < kMinObservations * num_images)
    return Fail(Errc::kNotEnoughData, "observations");

  BundleOptions bundle;
  bundle.loss.type = LossType::kNone;
  bundle.max_iterations = options.max_iterations;
  bundle.function_tolerance = 1e-10;
  bundle.num_threads = 1;
  const auto adjusted = AdjustBundle(bundle, &problem);
  if (!adjusted) return tl::unexpected(adjusted.error());
  TransectReport report;
  report.num_images = num_images;
  report.num_points = static_cast<int>(problem.points.size());
  report.num_observations = static_cast<int>(problem.observations.size());
  report.flown_m = (num_images - 1) * spacing_m;
  const double ratio = options.length_m / report.flown_m;
  report.sagitta_m = Sagitta(problem.images) * ratio * ratio;
  report.mean_error_px = adjusted->final_mean_error_px;
  report.converged = adjusted->converged;
  return report;
}

}  // namespace rsfm
