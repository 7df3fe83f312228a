// The pose of a refractive camera from pixels of known world points.
//
// Pixels become refracted rays once; hypotheses in LO-RANSAC (GP3P; P3P without a port; two upright
// points with known gravity) are scored and locally optimised on the first-order image error of
// those rays; the best is refined by Levenberg-Marquardt on the true image error with a robust
// loss.
#pragma once

#include <cstdint>
#include <span>

#include "rsfm/base/error.h"
#include "rsfm/base/fixed_vector.h"
#include "rsfm/base/ray3.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/estimation/ransac.h"
#include "rsfm/estimation/robust_loss.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

struct AbsolutePoseOptions {
  RansacOptions ransac;  // max_error_px is the inlier threshold on the image error
  RobustLoss loss = {LossType::kCauchy,
                     2.4};         // of the refinement, in units of the noise it finds; scale > 0
  int max_refine_iterations = 10;  // of Levenberg-Marquardt, in each of at most 4 rounds: the bound
  int min_inliers = 8;
  double max_rotation_sigma_rad =
      0.2;  // a pose less certain than this about any axis is degenerate
  // Which way is down, unit vectors, from an attitude sensor: samples of two points then, for the
  // hypotheses only. Its error must be small against the threshold. Both zero: not known.
  Vec3 down_in_camera = Vec3::Zero();
  Vec3 down_in_world = Vec3::Zero();
  double linearisation_range_m =
      3.0;  // > 0: where on its ray each pixel's error is linearised for scoring

  Status Validate() const noexcept;
};

struct AbsolutePoseReport {
  Rigid3 camera_from_world;
  // Of the left perturbation (rotation, translation) of camera_from_world, (rad, m), from the
  // information of the inliers at the optimum and their own noise (sigma_px).
  Mat6 covariance = Mat6::Zero();
  double sigma_px =
      0.0;  // robust estimate of the standard deviation of one observed coordinate, at least 1e-3
  double rms_error_px = 0.0;  // of the inliers' coordinates
  int num_inliers = 0;
  int num_observations = 0;
  int num_unusable = 0;  // observations that are not finite or have no ray: never inliers
  int refine_iterations = 0;
  RansacReport ransac;  // zeros after Refine()
};

// Thread-compatible; the constructor alone allocates.
class AbsolutePoseEstimator {
 public:
  explicit AbsolutePoseEstimator(std::uint32_t capacity);

  // pixels[i] sees points_in_world[i]. On error nothing is changed but the workspace.
  //   kInvalidArgument   an option, or the spans differ in length ("points_in_world")
  //   kOutOfCapacity     more observations than the capacity
  //   kNotEnoughData     fewer usable observations than min_inliers; `detail` is how many
  //   kNotEnoughInliers  too few agree, or no more than chance allows; `detail` is how many
  //   kDegenerate        the inliers do not determine the pose (collinear or coincident points)
  Expected<AbsolutePoseReport> Estimate(const AnyCamera& camera, std::span<const Vec2> pixels,
                                        std::span<const Vec3> points_in_world,
                                        const AbsolutePoseOptions& options) noexcept;

  // Refinement alone, from a known start (a prediction): robust, then with the inliers at the
  // result. The same errors.
  Expected<AbsolutePoseReport> Refine(const AnyCamera& camera, std::span<const Vec2> pixels,
                                      std::span<const Vec3> points_in_world,
                                      const Rigid3& camera_from_world_start,
                                      const AbsolutePoseOptions& options) noexcept;

  // Of the last success: 1 for an inlier, as long as its input.
  std::span<const std::uint8_t> inlier_mask() const { return mask_.span(); }
  int capacity() const { return static_cast<int>(mask_.capacity()); }
  std::size_t bytes() const;

  // An observation as the hypotheses see it: the refracted ray, and W = r d(pixel)/d(point) at a
  // point of range r on it, so that for a point q from the ray's origin the image error is, to
  // first order,  W q / (d . q)   [px].
  struct Observation {
    Ray3 ray;
    Mat23 pixel_from_offset;
    Vec3 point_in_world;
    int index = 0;  // in the caller's arrays
  };

 private:
  Status Prepare(const AnyCamera& camera, std::span<const Vec2> pixels,
                 std::span<const Vec3> points_in_world, const AbsolutePoseOptions& options,
                 bool with_rays);
  // Which observations fit the pose, and their noise. The number that fit.
  int SelectInliers(const AnyCamera& camera, std::span<const Vec2> pixels,
                    const Rigid3& camera_from_world, double max_error_px, double* sigma_px,
                    bool* changed);
  Expected<AbsolutePoseReport> RefineAndJudge(const AnyCamera& camera, std::span<const Vec2> pixels,
                                              const AbsolutePoseOptions& options,
                                              AbsolutePoseReport report);

  FixedVector<Observation> observations_;
  RansacWorkspace workspace_;
  FixedVector<std::uint8_t> mask_;
  FixedVector<int> active_;     // observations of the refinement
  FixedVector<double> errors_;  // squared, px^2, for their median
};

}  // namespace rsfm
