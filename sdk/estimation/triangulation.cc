#include "rsfm/estimation/triangulation.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "rsfm/base/static_vector.h"
#include "rsfm/estimation/reprojection_residual.h"

namespace rsfm {
namespace {

using Rays = StaticVector<Ray3, kMaxTriangulationViews>;

Ray3 ToWorld(const Rigid3& camera_from_world, const Ray3& ray) {
  const Quat world_from_camera = camera_from_world.rotation.conjugate();
  return {world_from_camera * (ray.origin - camera_from_world.translation),
          world_from_camera * ray.direction};
}

Status RaysOfViews(std::span<const TriangulationView> views, Rays* rays) {
  if (views.size() < 2) return Fail(Errc::kNotEnoughData, "views", static_cast<int>(views.size()));
  if (views.size() > kMaxTriangulationViews)
    return Fail(Errc::kOutOfCapacity, "views", kMaxTriangulationViews);
  for (std::size_t i = 0; i < views.size(); ++i) {
    const TriangulationView& view = views[i];
    if (view.camera == nullptr || !view.pixel.allFinite() ||
        !view.camera_from_world.translation.allFinite() ||
        !view.camera_from_world.rotation.coeffs().allFinite()) {
      return Fail(Errc::kInvalidArgument, "views", static_cast<int>(i));
    }
    Ray3 ray;
    if (view.camera->Backproject(view.pixel, &ray) != Projection::kOk) {
      return Fail(Errc::kDegenerate, "projection", static_cast<int>(i));
    }
    rays->TryPushBack(ToWorld(view.camera_from_world, ray));
  }
  return {};
}

// Sum of squared errors, its normal equations; the index of a view that cannot see the point or -1.
struct Normal {
  double cost = 0.0;
  double max_squared_error = 0.0;
  int worst_view = 0;
  Mat3 information = Mat3::Zero();
  Vec3 gradient = Vec3::Zero();
};

int Linearise(std::span<const TriangulationView> views, const Vec3& point, Normal* normal) {
  *normal = Normal();
  for (std::size_t i = 0; i < views.size(); ++i) {
    const TriangulationView& view = views[i];
    const Mat3 rotation = view.camera_from_world.rotation.toRotationMatrix();
    Vec2 pixel;
    Mat23 d_pixel_d_point;
    if (view.camera->Project(rotation * point + view.camera_from_world.translation, &pixel,
                             &d_pixel_d_point) != Projection::kOk) {
      return static_cast<int>(i);
    }
    const Vec2 error = pixel - view.pixel;
    const Mat23 jacobian = d_pixel_d_point * rotation;
    const double squared_error = error.squaredNorm();
    normal->cost += squared_error;
    if (squared_error > normal->max_squared_error) {
      normal->max_squared_error = squared_error;
      normal->worst_view = static_cast<int>(i);
    }
    normal->information.noalias() += jacobian.transpose() * jacobian;
    normal->gradient.noalias() += jacobian.transpose() * error;
  }
  return -1;
}

// Gauss-Newton with halved steps where the cost would rise.
Expected<Normal> Refine(std::span<const TriangulationView> views, int max_iterations, Vec3* point,
                        int* iterations) {
  Normal normal;
  if (const int view = Linearise(views, *point, &normal); view >= 0) {
    return Fail(Errc::kDegenerate, "projection", view);
  }
  for (*iterations = 0; *iterations < max_iterations; ++*iterations) {
    Vec3 step = normal.information.ldlt().solve(-normal.gradient);
    if (!step.allFinite()) return Fail(Errc::kDegenerate, "angle");
    const double distance = (*point).norm() + 1.0;
    // Predicted decrease far below any pixel's worth: converged.
    if (-step.dot(normal.gradient) < 1e-16 * (1.0 + normal.cost) || step.norm() < 1e-14 * distance)
      return normal;
    Normal next;
    bool accepted = false;
    for (int halving = 0; halving < 6 && !accepted; ++halving, step *= 0.5) {
      accepted = Linearise(views, *point + step, &next) < 0 && next.cost < normal.cost;
      if (accepted) *point += step;
    }
    if (!accepted) return normal;  // at the precision of the cost
    const bool is_small = normal.cost - next.cost < 1e-12 * (1e-3 + normal.cost);
    normal = next;
    if (is_small) return normal;
  }
  return Fail(Errc::kNotConverged, "triangulation", max_iterations);
}

Expected<TriangulationReport> RefineAndCheck(std::span<const TriangulationView> views,
                                             std::span<const Ray3> rays,
                                             const TriangulationOptions& options) {
  TriangulationReport report;
  report.max_angle_rad = MaxAngle(rays);
  if (!(report.max_angle_rad >= options.min_angle_rad)) return Fail(Errc::kDegenerate, "angle");
  const Expected<Vec3> start = TriangulateMidpoint(rays);
  if (!start) return tl::unexpected(start.error());
  report.point_in_world = *start;
  const Expected<Normal> normal =
      Refine(views, options.max_iterations, &report.point_in_world, &report.iterations);
  if (!normal) return tl::unexpected(normal.error());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const double range = rays[i].RangeTo(report.point_in_world);
    if (!(range > options.min_range_m && range > 0.0 && range < options.max_range_m)) {
      return Fail(Errc::kDegenerate, "range", static_cast<int>(i));
    }
  }
  report.max_error_px = std::sqrt(normal->max_squared_error);
  report.rms_error_px = std::sqrt(normal->cost / (2.0 * static_cast<double>(views.size())));
  if (!(report.max_error_px <= options.max_error_px)) {
    return Fail(Errc::kNotEnoughInliers, "error", normal->worst_view);
  }
  report.covariance = options.sigma_px * options.sigma_px * normal->information.inverse();
  if (!report.point_in_world.allFinite() || !report.covariance.allFinite())
    return Fail(Errc::kDegenerate, "angle");
  return report;
}

}  // namespace

Status TriangulationOptions::Validate() const noexcept {
  if (!(sigma_px > 0.0)) return Fail(Errc::kInvalidArgument, "sigma_px");
  if (!(max_error_px > 0.0)) return Fail(Errc::kInvalidArgument, "max_error_px");
  if (!(min_angle_rad >= 0.0)) return Fail(Errc::kInvalidArgument, "min_angle_rad");
  if (!(min_range_m >= 0.0)) return Fail(Errc::kInvalidArgument, "min_range_m");
  if (!(max_range_m > min_range_m)) return Fail(Errc::kInvalidArgument, "max_range_m");
  if (max_iterations < 1) return Fail(Errc::kInvalidArgument, "max_iterations", max_iterations);
  return {};
}

Expected<Vec3> TriangulateMidpoint(std::span<const Ray3> rays_in_world) noexcept {
  if (rays_in_world.size() < 2)
    return Fail(Errc::kNotEnoughData, "rays", static_cast<int>(rays_in_world.size()));
  // sum (I - d d') (X - o) = 0, about the first origin for precision far from the world's.
  const Vec3 reference = rays_in_world[0].origin;
  Mat3 matrix = Mat3::Zero();
  Vec3 right_side = Vec3::Zero();
  for (std::size_t i = 0; i < rays_in_world.size(); ++i) {
    const Ray3& ray = rays_in_world[i];
    if (!ray.origin.allFinite() || !ray.direction.allFinite()) {
      return Fail(Errc::kInvalidArgument, "rays", static_cast<int>(i));
    }
    const Mat3 projector = Mat3::Identity() - ray.direction * ray.direction.transpose();
    matrix += projector;
    right_side += projector * (ray.origin - reference);
  }
  const double trace = matrix.trace();
  // The determinant falls with the square of the angle between the rays: 1e-14 is 1e-7 rad.
  if (!(matrix.determinant() > 1e-14 * trace * trace * trace))
    return Fail(Errc::kDegenerate, "angle");
  return reference + matrix.ldlt().solve(right_side);
}

double MaxAngle(std::span<const Ray3> rays) noexcept {
  double widest = 0.0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    for (std::size_t j = i + 1; j < rays.size(); ++j) {
      const double sine = rays[i].direction.cross(rays[j].direction).norm();
      widest = std::max(widest, std::atan2(sine, rays[i].direction.dot(rays[j].direction)));
    }
  }
  return widest;
}

Expected<TriangulationReport> Triangulate(std::span<const TriangulationView> views,
                                          const TriangulationOptions& options) noexcept {
  if (const Status status = options.Validate(); !status) return tl::unexpected(status.error());
  Rays rays;
  if (const Status status = RaysOfViews(views, &rays); !status)
    return tl::unexpected(status.error());
  return RefineAndCheck(views, {rays.data(), rays.size()}, options);
}

Expected<TriangulationReport> TriangulateRobust(std::span<const TriangulationView> views,
                                                const TriangulationOptions& options, int min_views,
                                                std::span<std::uint8_t> inliers) noexcept {
  if (const Status status = options.Validate(); !status) return tl::unexpected(status.error());
  if (inliers.size() != views.size()) return Fail(Errc::kInvalidArgument, "inliers");
  Rays rays;
  if (const Status status = RaysOfViews(views, &rays); !status)
    return tl::unexpected(status.error());

  const double max_squared_error = options.max_error_px * options.max_error_px;
  double best_cost = std::numeric_limits<double>::infinity();
  Vec3 best_point = Vec3::Zero();
  const auto squared_error = [&](std::size_t view, const Vec3& point) {
    Vec2 error;
    const bool is_seen = rays[view].RangeTo(point) > 0.0 &&
                         ReprojectionError(*views[view].camera, views[view].camera_from_world,
                                           point, views[view].pixel, &error) == Projection::kOk;
    return is_seen ? std::min(error.squaredNorm(), max_squared_error) : max_squared_error;
  };
  int pairs = 0;
  // Widely separated views first: track order is usually time order.
  for (std::size_t gap = views.size() - 1; gap >= 1 && pairs < kMaxTriangulationPairs; --gap) {
    for (std::size_t i = 0; i + gap < views.size() && pairs < kMaxTriangulationPairs;
         ++i, ++pairs) {
      const std::array<Ray3, 2> pair = {rays[i], rays[i + gap]};
      if (!(MaxAngle(pair) >= options.min_angle_rad)) continue;
      const Expected<Vec3> point = TriangulateMidpoint(pair);
      if (!point) continue;
      double cost = 0.0;
      for (std::size_t view = 0; view < views.size() && cost < best_cost; ++view)
        cost += squared_error(view, *point);
      if (cost < best_cost) {
        best_cost = cost;
        best_point = *point;
      }
    }
  }
  if (!std::isfinite(best_cost)) return Fail(Errc::kDegenerate, "angle");

  std::array<std::uint8_t, kMaxTriangulationViews> fits{};
  StaticVector<TriangulationView, kMaxTriangulationViews> fitting_views;
  Rays fitting_rays;
  for (std::size_t view = 0; view < views.size(); ++view) {
    fits[view] = squared_error(view, best_point) < max_squared_error;
    if (!fits[view]) continue;
    fitting_views.TryPushBack(views[view]);
    fitting_rays.TryPushBack(rays[view]);
  }
  if (static_cast<int>(fitting_views.size()) < std::max(2, min_views)) {
    return Fail(Errc::kNotEnoughInliers, "views", static_cast<int>(fitting_views.size()));
  }
  const Expected<TriangulationReport> report =
      RefineAndCheck({fitting_views.data(), fitting_views.size()},
                     {fitting_rays.data(), fitting_rays.size()}, options);
  if (report) std::copy_n(fits.begin(), views.size(), inliers.begin());
  return report;
}

}  // namespace rsfm
