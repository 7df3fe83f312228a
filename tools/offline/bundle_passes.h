// The two walks over all observations that an iteration of bundle adjustment takes: one that
// linearises and eliminates each point on the fly, and one that moves the points after the poses
// and judges the step. Of the derivatives only those of the pixel by the point in the camera
// are kept, for the next linearisation and for letting the points follow.
//
// Points belong to a fixed number of parts, each summed by itself and added in order: the result is
// the same to the bit for any number of threads.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <utility>
#include <vector>

#include "tools/offline/bundle.h"
#include "tools/offline/camera_unknowns.h"
#include "tools/offline/reduced_system.h"

namespace rsfm {

struct BundleState {
  std::vector<CameraConfig> configs;
  std::vector<AnyCamera> cameras;  // of `configs`
  std::vector<Rigid3> poses;       // camera_from_world
  std::vector<Vec3> points;
};

class BundlePasses {
 public:
  // `hold` are priors beside those of the problem. All arguments outlive this.
  BundlePasses(const BundleOptions& options, const BundleProblem& problem,
               const std::vector<PosePrior>& hold, const CameraUnknowns& unknowns);

  const BlockPattern& pattern() const { return pattern_; }
  // The row of blocks of an image, -1 when it is fixed.
  int PoseBlock(int image) const { return pose_block_[image]; }

  // How much of the bending of the robust loss the next linearisation takes into account, 0 ... 1:
  // 0 far from the optimum, where it misleads, more near it, where it makes the difference between
  // linear and nearly quadratic convergence.
  void TakeCurvature(double part) { curvature_taken_ = part; }

  // The cost at `state`, which is the one to be linearised next.
  double Evaluate(const BundleState& state);
  // The reduced normal equations at `state`, the one last evaluated or accepted. Lasts until the
  // next call.
  const ReducedSums& Linearise(const BundleState& state);

  // `moved` has the poses and cameras after a step from the state of the last Linearise. Its points
  // follow the step to first order and are then, if the options say so, adjusted to the new poses.
  // Returns the cost of it all.
  double MovePoints(const BundleState& before, const Eigen::VectorXd& pose_step,
                    const Eigen::VectorXd& shared_step, BundleState* moved);
  // `moved` of the last MovePoints is the one to be linearised next.
  void Accept() { std::swap(current_, trial_); }

 private:
  // What a point leaves behind for MovePoints.
  struct Eliminated {
    Mat3 inverse = Mat3::Zero();  // of its information
    Vec3 own_step = Vec3::Zero();
    double cost = 0.0;
  };
  // One observation at some state. Its derivatives are single precision: 24 bytes, and what that
  // loses is far below what linearising does.
  struct Evaluated {
    std::array<float, 6> d_pixel_d_point;  // in the camera, column by column
    Vec2 residual;                         // in sigmas, not weighted
    bool possible = false;
  };
  struct Workspace;
  static constexpr int kParts = 4;

  void Sort();
  void Split();
  void LinkAll();
  void LinearisePart(const BundleState& state, int part);
  void EliminatePoint(const BundleState& state, int point, Workspace* work, ReducedSums* sums);
  void LinearisePriors(const BundleState& state, ReducedSums* sums) const;
  double PriorCost(const BundleState& state) const;
  // Into `trial_`.
  double EvaluatePoint(const BundleState& state, int point, const Vec3& xyz, Mat3* information,
                       Vec3* gradient);
  Vec3 FollowStep(const BundleState& before, int point, const Eigen::VectorXd& pose_step,
                  const Eigen::VectorXd& shared_step) const;
  double AdjustPoint(const BundleState& state, int point, double cost_before, Vec3* xyz);

  const BundleOptions& options_;
  const BundleProblem& problem_;
  const CameraUnknowns& unknowns_;
  std::vector<const PosePrior*> priors_;
  double curvature_taken_ = 0.0;
  std::vector<int> pose_block_;
  BlockPattern pattern_;
  std::vector<int> first_;  // of each point, in order_
  std::vector<int> order_;  // observations by point, then image
  std::array<int, kParts + 1> part_start_{};
  std::array<ReducedSums, kParts> sums_;
  std::vector<Eigen::Matrix<double, kNumPortParams, Eigen::Dynamic>> port_columns_;
  std::vector<Eliminated> eliminated_;
  std::vector<Evaluated> current_, trial_;  // by place in order_
  Eigen::MatrixXd point_by_shared_;         // 3 points x shared: inverse * cross information
};

}  // namespace rsfm
