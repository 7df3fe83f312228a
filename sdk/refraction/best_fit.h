// The perspective camera that comes nearest to a refractive one.
//
// [She 2024, arXiv:2403.08640, "Relative Pose Estimation"]: image points are back-projected to 3D
// points at 5 m and the parameters of a pinhole camera at the same place are fitted to them by
// least squares of the reprojection error.
#pragma once

#include "rsfm/base/error.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

struct BestFitOptions {
  double min_range_m = 5.0;  // points are spread over this band, along each refracted ray
  double max_range_m = 5.0;
  int grid_columns =
      40;  // image points on a regular grid: deterministic; the paper draws 1000 at random
  int grid_rows = 25;
};

// An ideal pinhole fx, fy, cx, cy (px) in the refractive camera's frame and place.
struct BestFitPerspective {
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;  // px
  double rms_error_px = 0.0;                      // of the fit: what the approximation costs
  double max_error_px = 0.0;

  Vec2 Project(const Vec3& point_in_camera) const {
    return {fx * point_in_camera.x() / point_in_camera.z() + cx,
            fy * point_in_camera.y() / point_in_camera.z() + cy};
  }
  // Normalised coordinates (x/z, y/z) of a pixel.
  Vec2 Normalise(const Vec2& pixel) const { return {(pixel.x() - cx) / fx, (pixel.y() - cy) / fy}; }
};

// kDegenerate when fewer than 16 of the image points have a ray with a positive z. Allocates
// nothing.
Expected<BestFitPerspective> FitPerspective(const AnyCamera& camera,
                                            const BestFitOptions& options = {}) noexcept;

}  // namespace rsfm
