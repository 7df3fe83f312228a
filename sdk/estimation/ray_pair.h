// Two-view geometry of refracted rays: the generalised epipolar constraint with its image noise.
#pragma once

#include <optional>
#include <span>

#include "rsfm/base/ray3.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/base/static_vector.h"
#include "rsfm/estimation/robust_loss.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

// A pixel's ray in water with its first derivatives to the pixel.
struct DifferentiatedRay {
  Ray3 ray;
  Eigen::Matrix<double, 3, 2> d_origin_d_pixel;     // m / px
  Eigen::Matrix<double, 3, 2> d_direction_d_pixel;  // 1 / px
};

// By differences over 0.01 px. False when the pixel has no ray.
bool BackprojectDifferentiated(const AnyCamera& camera, const Vec2& pixel,
                               DifferentiatedRay* result) noexcept;

struct RayPair {
  DifferentiatedRay a, b;  // each in its own camera's frame
  Vec3 bearing_a = Vec3::UnitZ(),
       bearing_b = Vec3::UnitZ();  // unit, of a central camera that stands in for the real one
  int index = 0;                   // in the caller's arrays
};

// point_in_b = rotation point_in_a + direction / inverse_baseline. In these parameters the
// constraint stays regular where the rays do not tell the baseline's length, and inverse_baseline =
// 0 ignores that the cameras have no single centre.
struct RelativePose {
  Mat3 rotation = Mat3::Identity();
  Vec3 direction = Vec3::UnitX();  // unit
  double inverse_baseline = 1.0;   // 1 / m, > 0

  Rigid3 ToRigid() const { return {Quat(rotation).normalized(), direction / inverse_baseline}; }
  static RelativePose FromRigid(const Rigid3& b_from_a) {
    const double length = b_from_a.translation.norm();
    return {b_from_a.rotation.toRotationMatrix(), b_from_a.translation / length, 1.0 / length};
  }
};

// The generalised epipolar constraint over the baseline's length,
//   e = (u + s (R o_a - o_b)) . (R d_a x d_b) = 0,   s = 1 / |t|, u = t / |t|.
// [Pless 2003, CVPR; She 2024, arXiv:2403.08640, eq. (5), whose virtual cameras lie on the rays'
// lines: e does not change when an origin moves along its ray] Its first-order distance in the
// image is e / |d e / d(pixel_a, pixel_b)|. [Sampson 1982; Hartley & Zisserman 2004, sec. 11.4.3]
double SquaredSampsonError(const RelativePose& pose, const RayPair& pair) noexcept;  // px^2

enum class EpipolarWeighting : std::uint8_t {
  kSampson,    // image distance
  kAlgebraic,  // the paper's virtual epipolar cost: e of normalised image coordinates, in mean
               // pixels
};

// A normal prior on the baseline's length, from navigation, and a weak one on its logarithm that
// keeps it finite where nothing determines it.
struct BaselinePriors {
  double length_m = 0.0;
  double sigma_m = 0.0;  // 0: no prior
  double weak_length_m = 1.0;
  double weak_log_sigma = 1.0;
};

struct EpipolarRefineOptions {
  EpipolarWeighting weighting = EpipolarWeighting::kSampson;
  RobustLoss loss;        // in pixels
  double sigma_px = 1.0;  // the observations' noise, which the priors are weighed against
  int max_iterations = 10;
  double min_baseline_m = 0.01;
  double max_baseline_m = 1000.0;
  BaselinePriors priors;
};

// Parameters of the refinement: rotation (left perturbation), direction (tangent basis), inverse
// baseline.
struct EpipolarNormal {
  double cost = 0.0;                // robust, px^2, priors included
  Mat6 information = Mat6::Zero();  // of the observations and the navigation prior, 1 / px^2
  Mat6 weak_information = Mat6::Zero();
  Vec6 gradient = Vec6::Zero();
};
// The columns span the plane orthogonal to a unit direction.
Eigen::Matrix<double, 3, 2> TangentBasis(const Vec3& direction) noexcept;

// The Levenberg-Marquardt step of the refinements; none where the damped system is singular.
std::optional<Vec6> DampedStep(const EpipolarNormal& normal, double damping) noexcept;

// The update of the refinements: the direction stays unit, the baseline within its bounds.
RelativePose Perturb(const RelativePose& pose, const Vec6& step,
                     const EpipolarRefineOptions& options) noexcept;

// One pair's share of everything but the priors; nothing when both rays pass both centres.
void AddEpipolar(const RelativePose& pose, const Eigen::Matrix<double, 3, 2>& tangent_basis,
                 const RayPair& pair, const EpipolarRefineOptions& options,
                 EpipolarNormal* normal) noexcept;

// The priors on the baseline: their cost is returned, the rest added.
double AddBaselinePriors(const RelativePose& pose, const EpipolarRefineOptions& options,
                         EpipolarNormal* normal) noexcept;

// Four standard deviations of the angle between the two rays: a parallax below it tells no depth.
double ParallaxNoise(const RayPair& pair, double sigma_px) noexcept;  // rad

EpipolarNormal LineariseEpipolar(std::span<const RayPair> pairs, std::span<const int> active,
                                 const RelativePose& pose,
                                 const EpipolarRefineOptions& options) noexcept;

// Levenberg-Marquardt over all six degrees of freedom on the chosen pairs; the weights are those of
// the last accepted step (iteratively reweighted). Returns the number of iterations; the pose is
// left at the lowest cost found.
int RefineEpipolar(std::span<const RayPair> pairs, std::span<const int> active,
                   const EpipolarRefineOptions& options, RelativePose* pose) noexcept;

// Ranges along the two rays to the ends of their common perpendicular, and the angle between them;
// false where they are parallel to working precision.
bool MeetingRanges(const RelativePose& pose, const RayPair& pair, double* range_a, double* range_b,
                   double* angle_rad) noexcept;

}  // namespace rsfm
