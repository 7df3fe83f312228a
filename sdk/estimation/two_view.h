// Relative pose of two refractive cameras.
//
// The five-point solver of a central stand-in proposes, LO-RANSAC scores and locally optimises each
// proposal on the refracted rays in all six degrees of freedom, so that no correspondence is lost
// to the approximation; the virtual epipolar cost is then refined with a robust loss, pose and
// points are adjusted by the true image error, and what the data do not determine is named.
// [after She 2024, arXiv:2403.08640, "Relative Pose Estimation"]
//
// The central stand-in sees a point by its direction from the point nearest to all rays, for the
// point of each ray at `nominal_range_m`: exact at that range for any lens and port, where the
// paper's best-fit pinhole is bound to one pinhole.
#pragma once

#include <cstdint>
#include <limits>
#include <span>

#include "rsfm/base/error.h"
#include "rsfm/base/fixed_vector.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/estimation/ransac.h"
#include "rsfm/estimation/ray_pair.h"
#include "rsfm/estimation/two_view_bundle.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

struct TwoViewOptions {
  // max_error_px is the inlier threshold on the distance from the epipolar curve
  RansacOptions ransac = {
      .max_error_px = 4.0, .confidence = 0.9999, .min_iterations = 20, .max_iterations = 2000};
  EpipolarWeighting weighting = EpipolarWeighting::kSampson;  // of the closing refinement
  RobustLoss loss = {LossType::kCauchy, 2.4};  // of that refinement, in units of the noise it finds
  int max_refine_iterations = 20;              // in each of at most 3 rounds: the bound
  int max_bundle_iterations = 10;              // of the closing bundle adjustment; 0: none
  // Where the scene is expected: the central stand-in is exact there, and where nothing determines
  // the baseline's length the median point stays about that far away (a normal prior on the
  // logarithm of the range, of which one sigma is by default a factor of e; never part of the
  // reported sigma).
  double nominal_range_m = 5.0;
  double range_log_sigma = 1.0;

  // The baseline's length from navigation; sigma 0: not known.
  double baseline_m = 0.0;
  double sigma_baseline_m = 0.0;
  double min_range_m = 0.2;  // of the median point: the scene is outside the housing
  double min_baseline_m = 0.005;
  double max_baseline_m = 1000.0;
  double max_relative_baseline_sigma = 0.2;  // above it the length is reported as unknown

  int min_inliers = 12;
  double min_in_front_ratio = 0.95;  // of the inliers with a parallax above the noise
  double max_rotation_only_ratio =
      0.8;  // of the inliers that a rotation without translation explains
  double max_plane_ratio =
      0.9;  // of the inliers that lie on one plane, above which a second solution is looked for
  double max_direction_sigma_rad = 0.2;  // of the baseline's direction, and of the rotation

  Status Validate() const noexcept;
};

struct TwoViewReport {
  Rigid3 b_from_a;  // camera b from camera a
  // Of the left perturbation (rotation, translation) of b_from_a, 1 / (rad, m)^2: an inverse
  // covariance, because that stays finite where the baseline's length is unknown.
  Mat6 information = Mat6::Zero();
  double baseline_m = 0.0;
  double sigma_baseline_m = std::numeric_limits<double>::infinity();
  bool is_baseline_known =
      false;  // sigma_baseline_m is at most max_relative_baseline_sigma of baseline_m
  double sigma_rotation_rad = 0.0;  // about the least certain axis
  double sigma_direction_rad = 0.0;
  double median_parallax_rad = 0.0;  // of the inliers
  double sigma_px = 0.0;             // robust estimate of the noise of one image coordinate
  double rotation_only_ratio = 0.0;
  double plane_ratio = 0.0;
  int num_inliers = 0;
  int num_observations = 0;
  int num_unusable = 0;  // not finite or without a ray: never inliers
  int refine_iterations = 0;
  int bundle_iterations = 0;
  RansacReport ransac;  // zeros after Refine()
};

// Thread-compatible; the constructor alone allocates.
class TwoViewEstimator {
 public:
  explicit TwoViewEstimator(std::uint32_t capacity);

  // pixels_a[i] and pixels_b[i] see the same point.
  //   kInvalidArgument   an option, or the spans differ in length ("pixels_b")
  //   kOutOfCapacity     more correspondences than the capacity
  //   kNotEnoughData     fewer usable ones than min_inliers; `detail` is how many
  //   kNotEnoughInliers  too few agree, or no more than chance allows ("inliers"); too few lie in
  //   front of
  //                      both cameras ("cheirality"); `detail` is how many
  //   kDegenerate        "collinear": the inliers lie on a line in an image; "rotation": a rotation
  //   alone explains
  //                      them; "plane": they lie on a plane and a second pose explains them as
  //                      well; "information": direction or rotation are not determined
  Expected<TwoViewReport> Estimate(const AnyCamera& camera_a, const AnyCamera& camera_b,
                                   std::span<const Vec2> pixels_a, std::span<const Vec2> pixels_b,
                                   const TwoViewOptions& options) noexcept;

  // Refinement alone from a known start (navigation, a tracked pose). The same errors.
  Expected<TwoViewReport> Refine(const AnyCamera& camera_a, const AnyCamera& camera_b,
                                 std::span<const Vec2> pixels_a, std::span<const Vec2> pixels_b,
                                 const Rigid3& b_from_a_start,
                                 const TwoViewOptions& options) noexcept;

  // Of the last success, as long as its input. Points in camera a (midpoints of the rays without
  // bundle adjustment), NaN for outliers and for inliers too far to have a parallax above the
  // noise.
  std::span<const std::uint8_t> inlier_mask() const { return mask_.span(); }
  std::span<const Vec3> points_in_a() const { return points_.span(); }
  int capacity() const { return static_cast<int>(mask_.capacity()); }
  std::size_t bytes() const;

 private:
  Status Prepare(const AnyCamera& camera_a, const AnyCamera& camera_b,
                 std::span<const Vec2> pixels_a, std::span<const Vec2> pixels_b,
                 const TwoViewOptions& options);
  void SelectInliers(const RelativePose& pose, double max_error_px, double* sigma_px);
  // Drops what is farther off from the active pairs and the adjustment's memory.
  void KeepWithin(const RelativePose& pose, double max_error_px);
  // With a weak prior on the range of the given width.
  Expected<TwoViewReport> RefineAndJudge(const TwoViewImages& images, const TwoViewOptions& options,
                                         double range_log_sigma, RelativePose pose,
                                         TwoViewReport report);
  // The same with the options' prior; again with a narrow one when the length that fits best would
  // put points behind the port: cheirality is a bound that the refinement itself does not know.
  Expected<TwoViewReport> RefineWithinWater(const TwoViewImages& images,
                                            const TwoViewOptions& options, const RelativePose& pose,
                                            const TwoViewReport& report);
  // Moves the pose to the least true image error of the active pairs; fills bundle_ alike.
  void AdjustBundle(const TwoViewImages& images, const TwoViewOptions& options,
                    EpipolarRefineOptions refine, RelativePose* pose, TwoViewReport* report);
  Status CheckCheirality(const RelativePose& pose, const TwoViewOptions& options,
                         TwoViewReport* report);
  Status CheckDegeneracy(const RelativePose& pose, const TwoViewOptions& options,
                         TwoViewReport* report);
  Status Describe(const RelativePose& pose, const EpipolarRefineOptions& refine,
                  const TwoViewOptions& options, TwoViewReport* report);

  FixedVector<RayPair> pairs_;
  Vec3 centre_a_ = Vec3::Zero();  // of the central stand-ins, in each camera's frame
  Vec3 centre_b_ = Vec3::Zero();
  double port_depth_m_ =
      0.0;  // from centre a to the farthest point of the port that is looked through
  RansacWorkspace workspace_;
  FixedVector<int> active_;
  FixedVector<double> values_;  // for medians
  FixedVector<std::uint8_t> mask_;
  FixedVector<Vec3> points_;
  FixedVector<BundlePair> bundle_;
  std::size_t num_observations_ = 0;
};

}  // namespace rsfm
