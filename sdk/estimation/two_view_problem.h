// The central stand-ins of two refractive cameras and the RANSAC problem over them. Part of
// two_view.
#pragma once

#include <algorithm>
#include <span>

#include "rsfm/estimation/five_point.h"
#include "rsfm/estimation/two_view.h"

namespace rsfm::internal {

// The point nearest to all rays, drawn weakly to the mean origin for when they are parallel.
Vec3 NearestPoint(std::span<const RayPair> pairs, bool of_a);

EpipolarRefineOptions MakeRefineOptions(const TwoViewOptions& options, double sigma_px);

// The central stand-ins of both cameras: X_b - c_b = R (X_a - c_a) + t_c.
struct StandIn {
  std::span<const RayPair> pairs;
  Vec3 centre_a, centre_b;
  double port_depth_m =
      0.0;  // from centre a, the farthest point of the port's outer surface that is looked through

  Vec3 Offset(const Mat3& rotation) const { return centre_b - rotation * centre_a; }
  RelativePose ToPose(const Mat3& rotation, const Vec3& translation,
                      const TwoViewOptions& options) const {
    const Vec3 full = translation + Offset(rotation);
    const double length = std::clamp(full.norm(), options.min_baseline_m, options.max_baseline_m);
    return {rotation, full.normalized(), 1.0 / length};
  }
};

// Makes the baseline's sign and length physical before a refinement: refraction that is weak
// against the noise tells neither, and the constraint alone would let the points move through the
// port or behind the camera. From at most 64 of the pairs by their median depth over the baseline;
// sets the bound and the weak prior of the length.
void AnchorScale(const StandIn& stand_in, std::span<const int> active,
                 const TwoViewOptions& options, EpipolarRefineOptions* refine, RelativePose* pose);

// The length often has two minima, one of them with the scene at the port, where noise looks like
// refraction. Where the refined length is far from the nominal one, refines from there as well and
// keeps the pose of lower cost. Returns the number of iterations.
int TryNominalLength(const StandIn& stand_in, std::span<const int> active,
                     const TwoViewOptions& options, const EpipolarRefineOptions& refine,
                     RelativePose* pose);

// The RANSAC problem: five-point proposals of the central stand-in, judged on the refracted rays.
class TwoViewProblem {
 public:
  static constexpr int kSampleSize = kFivePointSampleSize;
  static constexpr int kErrorDof = 1;
  using Model = RelativePose;
  using Models = StaticVector<RelativePose, 20>;

  TwoViewProblem(const StandIn& stand_in, const TwoViewOptions& options,
                 const EpipolarRefineOptions& refine)
      : stand_in_(stand_in), pairs_(stand_in.pairs), options_(options), refine_(refine) {}

  int Size() const { return static_cast<int>(pairs_.size()); }

  void Solve(std::span<const int, kSampleSize> sample, Models* models) const;
  double SquaredError(const Model& model, int i) const {
    return SquaredSampsonError(model, pairs_[i]);
  }

  // The virtual epipolar cost on at most about kMaxUsed inliers, evenly chosen.
  bool Refine(std::span<const int> inliers, Model* model) const;

 private:
  // The length of the baseline between the stand-ins that fits the rays best: e is linear in its
  // inverse, and a coarse logarithmic grid of ranges over at most 64 pairs suffices as a start.
  double Length(const Mat3& rotation, const Vec3& direction, double depth_ratio) const;

  StandIn stand_in_;
  std::span<const RayPair> pairs_;
  const TwoViewOptions& options_;
  EpipolarRefineOptions refine_;
};
static_assert(RansacProblem<TwoViewProblem>);

}  // namespace rsfm::internal
