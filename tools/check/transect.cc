#include "tools/check/transect.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "rsfm/base/rigid3.h"

namespace rsfm {
namespace {

constexpr int kMinPoints = 12;
// The corners of an image see farther than the middles of its sides, by less than this.
constexpr double kBeyondMiddle = 1.5;

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

// A seabed point of the first step and the undistorted pixels in which the images about it see it:
// image k is k steps ahead.
struct Sighting {
  int step;
  Vec2 pixel;
};
struct StripPoint {
  Vec3 in_camera;  // of image 0; what is adjusted
  std::vector<Sighting> sightings;
};

std::vector<StripPoint> MakeStep(const PinholeInWater& pinhole, const TransectOptions& options,
                                 const Vec2& half, double spacing_m) {
  std::vector<StripPoint> points;
  const int rows = std::max(2, static_cast<int>(std::lround(options.rows * spacing_m / half.x() / 2)));
  const int reach = static_cast<int>(std::ceil(kBeyondMiddle * half.x() / spacing_m));
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < options.columns; ++column) {
      const Vec3 on_seabed(
          spacing_m * ((row + 0.5) / rows - 0.5),
          kBeyondMiddle * half.y() * (2.0 * (column + 0.5) / options.columns - 1.0), 0.0);
      StripPoint point{CameraFromWorld(0.0, options.altitude_m) * on_seabed, {}};
      for (int step = -reach; step <= reach; ++step) {
        Vec2 pixel;
        if (Observe(pinhole, CameraFromWorld(step * spacing_m, options.altitude_m) * on_seabed,
                    &pixel)) {
          point.sightings.push_back({step, pixel});
        }
      }
      if (point.sightings.size() >= 2) points.push_back(std::move(point));
    }
  }
  return points;
}

// A step is the motion exp(xi) of the seabed in the camera's frame, xi = (omega, v); the component
// of v along the track is what holds the scale. Motion by k steps: exp(k xi), [Murray, Li & Sastry
// 1994, A Mathematical Introduction to Robotic Manipulation, eq. 2.36].
constexpr int kTwistSize = 5;  // omega, v across the track, v down

template <class T>
Vec3T<T> MoveBySteps(const T* twist, double spacing_m, double steps, const Vec3T<T>& point) {
  const Vec3T<T> omega = T(steps) * Vec3T<T>(twist[0], twist[1], twist[2]);
  const Vec3T<T> v = T(steps) * Vec3T<T>(twist[3], T(spacing_m), twist[4]);
  const T square = omega.squaredNorm();
  T a(1.0), b(0.5), c(1.0 / 6.0);  // sin(t)/t, (1 - cos t)/t^2, (t - sin t)/t^3
  if (square > T(1e-6)) {
    using std::cos;
    using std::sin;
    using std::sqrt;
    const T angle = sqrt(square);
    a = sin(angle) / angle;
    b = (T(1.0) - cos(angle)) / square;
    c = (T(1.0) - a) / square;
  } else {
    a -= square / T(6.0);
    b -= square / T(24.0);
    c -= square / T(120.0);
  }
  const Vec3T<T> of_point = omega.cross(point), of_v = omega.cross(v);
  return point + a * of_point + b * omega.cross(of_point) + v + b * of_v + c * omega.cross(of_v);
}

struct SightingResidual {
  double spacing_m;
  const BestFitPerspective* pinhole;
  Sighting sighting;

  template <class T>
  bool operator()(const T* twist, const T* point, T* residual) const {
    const Vec3T<T> p = MoveBySteps<T>(twist, spacing_m, sighting.step,
                                      Vec3T<T>(point[0], point[1], point[2]));
    if (!(p.z() > T(0.0))) return false;
    residual[0] = pinhole->fx * p.x() / p.z() + pinhole->cx - sighting.pixel.x();
    residual[1] = pinhole->fy * p.y() / p.z() + pinhole->cy - sighting.pixel.y();
    return true;
  }
};

// Mean error in pixels; the twist and the points are adjusted.
Expected<double> AdjustStep(const BestFitPerspective& pinhole, double spacing_m,
                            std::vector<StripPoint>* points,
                            std::array<double, kTwistSize>* twist) {
  ceres::Problem problem;
  auto* order = new ceres::ParameterBlockOrdering;
  std::vector<SightingResidual> residuals;
  for (StripPoint& point : *points) {
    for (const Sighting& sighting : point.sightings) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<SightingResidual, 2, kTwistSize, 3>(
              new SightingResidual{spacing_m, &pinhole, sighting}),
          nullptr, twist->data(), point.in_camera.data());
    }
    order->AddElementToGroup(point.in_camera.data(), 0);
  }
  order->AddElementToGroup(twist->data(), 1);
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_SCHUR;
  solver.linear_solver_ordering.reset(order);
  // The points follow the motion within every step: together they would creep along the valley that
  // bending and depths share.
  solver.use_inner_iterations = true;
  solver.inner_iteration_tolerance = 0.0;
  solver.inner_iteration_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (StripPoint& point : *points)
    solver.inner_iteration_ordering->AddElementToGroup(point.in_camera.data(), 0);
  solver.max_num_iterations = 1000;
  solver.function_tolerance = 1e-8;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  if (summary.termination_type != ceres::CONVERGENCE)
    return Fail(Errc::kNotConverged, "strip");
  double sum = 0.0;
  int count = 0;
  for (const StripPoint& point : *points) {
    for (const Sighting& sighting : point.sightings) {
      double error[2];
      if (!SightingResidual{spacing_m, &pinhole, sighting}(twist->data(), point.in_camera.data(),
                                                           error)) {
        return Fail(Errc::kNotConverged, "strip");
      }
      sum += std::hypot(error[0], error[1]);
      ++count;
    }
  }
  return sum / count;
}

// Of the track, at one of its images and in its frame: two neighbours at a tenth of a step.
double Curvature(const std::array<double, kTwistSize>& twist, double spacing_m) {
  constexpr double kStep = 0.1;
  const Vec3 ahead = MoveBySteps<double>(twist.data(), spacing_m, -kStep, Vec3::Zero());
  const Vec3 behind = MoveBySteps<double>(twist.data(), spacing_m, kStep, Vec3::Zero());
  const double chord = (ahead - behind).norm();
  return -4.0 * (ahead + behind).z() / (chord * chord);
}

}  // namespace

Expected<TransectReport> SimulateTransect(const PinholeInWater& pinhole,
                                          const TransectOptions& options) {
  if (!(options.length_m > 0.0)) return Fail(Errc::kInvalidArgument, "length_m");
  if (!(options.altitude_m > 0.0)) return Fail(Errc::kInvalidArgument, "altitude_m");
  if (!(options.forward_overlap > 0.5 && options.forward_overlap < 1.0))
    return Fail(Errc::kInvalidArgument, "forward_overlap");
  if (options.rows < 4 || options.columns < 2)
    return Fail(Errc::kInvalidArgument, "rows or columns");
  const Vec2 half = HalfFootprint(pinhole, options.altitude_m);
  if (!(half.minCoeff() > 0.0)) return Fail(Errc::kNotEnoughData, "footprint");
  const double spacing_m = 2.0 * half.x() * (1.0 - options.forward_overlap);
  std::vector<StripPoint> points = MakeStep(pinhole, options, half, spacing_m);
  TransectReport report;
  report.spacing_m = spacing_m;
  report.num_points = static_cast<int>(points.size());
  for (const StripPoint& point : points)
    report.num_observations += static_cast<int>(point.sightings.size());
  if (report.num_points < kMinPoints) return Fail(Errc::kNotEnoughData, "observations");
  std::array<double, kTwistSize> twist{};
  const auto error_px = AdjustStep(pinhole.fit(), spacing_m, &points, &twist);
  if (!error_px) return tl::unexpected(error_px.error());
  report.mean_error_px = *error_px;
  report.curvature_per_m = Curvature(twist, spacing_m);
  const double half_angle =
      std::min(0.5 * options.length_m * std::abs(report.curvature_per_m), std::numbers::pi);
  // 1 - cos a = 2 sin^2(a / 2), which small angles survive.
  if (half_angle > 0.0) {
    const double sine = std::sin(0.5 * half_angle);
    report.sagitta_m = 2.0 * sine * sine / report.curvature_per_m;
  }
  return report;
}

}  // namespace rsfm
