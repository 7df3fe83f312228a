// A point from N refracted rays.
//
// Start: the point nearest to all rays (linear midpoint). Then Gauss-Newton on the true image error
// through the exact projection of each camera.   [Hartley & Sturm 1997, CVIU 68(2), for the image
// error as the criterion]
#pragma once

#include <span>

#include "rsfm/base/error.h"
#include "rsfm/base/ray3.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

struct TriangulationOptions {
  double sigma_px = 1.0;      // standard deviation of an observed coordinate: scales the covariance
  double max_error_px = 4.0;  // each observation's error at the result
  double min_angle_rad = 0.017;  // the widest angle between two rays must reach this
  double min_range_m = 0.0;      // along each ray, from the port's outer surface
  double max_range_m = 1000.0;
  int max_iterations = 10;  // of Gauss-Newton; the bound

  Status Validate() const noexcept;
};

struct TriangulationView {
  const AnyCamera* camera = nullptr;
  Rigid3 camera_from_world;
  Vec2 pixel;  // px
};

struct TriangulationReport {
  Vec3 point_in_world = Vec3::Zero();
  Mat3 covariance = Mat3::Zero();  // m^2, for observations of sigma_px
  double max_angle_rad = 0.0;      // the widest angle between two rays
  double rms_error_px = 0.0;       // of the 2 N coordinates
  double max_error_px = 0.0;       // of the observations
  int iterations = 0;
};

// The point nearest to all rays in the sense of least squares. kNotEnoughData below two rays,
// kDegenerate for rays that are parallel to working precision, kInvalidArgument ("rays") when one
// is not finite.
Expected<Vec3> TriangulateMidpoint(std::span<const Ray3> rays_in_world) noexcept;

// The widest angle between any two rays, rad.
double MaxAngle(std::span<const Ray3> rays) noexcept;

// The most views of one triangulation: memory on the stack.
inline constexpr int kMaxTriangulationViews = 64;

// The point that all views see.
//   kInvalidArgument   a view is not finite or has no camera; `where` "views", `detail` its index
//   kNotEnoughData     fewer than two views          kOutOfCapacity  more than
//   kMaxTriangulationViews kDegenerate        "angle": the rays are too nearly parallel; "range":
//   the point lies behind a port or out of range
//                      ("cheirality"); "projection": a view has no ray or cannot see the point;
//                      `detail` is the view
//   kNotConverged      Gauss-Newton reached its bound while the point still moved
//   kNotEnoughInliers  "error": an observation's error exceeds max_error_px; `detail` is the view
Expected<TriangulationReport> Triangulate(std::span<const TriangulationView> views,
                                          const TriangulationOptions& options = {}) noexcept;

// The same for a track that may hold wrong observations: every pair of views (the first kMaxPairs
// of them in a fixed order) proposes a point, the one with the lowest truncated error is refined on
// the views it fits. `inliers` (same length as views) gets 1 for those. kNotEnoughInliers when
// fewer than `min_views` fit.
inline constexpr int kMaxTriangulationPairs = 128;
Expected<TriangulationReport> TriangulateRobust(std::span<const TriangulationView> views,
                                                const TriangulationOptions& options, int min_views,
                                                std::span<std::uint8_t> inliers) noexcept;

}  // namespace rsfm
