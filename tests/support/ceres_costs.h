// The SDK's residuals as Ceres cost functions.
//
// Poses are blocks of seven doubles (quaternion x y z w, translation), perturbed on the left. The
// cost functions write their derivatives to the six-dimensional perturbation into the first six
// columns and zero into the seventh, and PoseManifold::PlusJacobian is [I6; 0]: the product that
// Ceres forms is exact, and nothing is converted to quaternion coordinates and back.
#pragma once

#include <ceres/ceres.h>

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "rsfm/estimation/pose_prior.h"
#include "rsfm/estimation/robust_loss.h"
#include "rsfm/refraction/any_camera.h"
#include "tools/offline/bundle.h"
#include "tools/offline/camera_unknowns.h"

namespace rsfm {

inline constexpr int kPoseBlock = 7;
using PoseBlock = std::array<double, kPoseBlock>;

PoseBlock ToBlock(const Rigid3& pose);
Rigid3 FromBlock(const double* block);

class PoseManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return kPoseBlock; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

// The port's eight parameters: a flat port's normal moves on the sphere, parameters that are not
// refined stay.
class PortManifold : public ceres::Manifold {
 public:
  // Precondition: something of what `type` has is refined.
  PortManifold(PortType type, const RefinePort& refine);

  int AmbientSize() const override { return kNumPortParams; }
  int TangentSize() const override { return tangent_size_; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;

 private:
  bool normal_ = false;
  std::vector<int> free_;  // parameters with a tangent direction of their own
  int tangent_size_ = 0;
};

// One camera's parameters as Ceres moves them.
struct CameraState {
  CameraConfig config;
  std::array<double, kMaxLensParams> lens{};
  PortParams port{};
  std::optional<AnyCamera> camera;  // of `config`; nothing if its parameters are impossible
  std::uint64_t id;                 // of no other camera of this program

  explicit CameraState(const CameraConfig& start);
  // Brings `config` and `camera` up to `lens` and `port`.
  void Update();
  // The camera of these parameters, which Ceres may be trying; nullptr where they are impossible.
  // Made once for each thread and change: lasts until the thread's next call.
  const AnyCamera* At(const double* lens_params, const double* port_params) const;
};

// Blocks: pose (7), point (3) and, where `refine_camera`, lens (its number of parameters) and port
// (8). Residual: the image error over sigma; kImpossibleErrorPx with zero derivatives where there
// is no projection.
class ReprojectionCost : public ceres::CostFunction {
 public:
  ReprojectionCost(const CameraState* camera, const Vec2& pixel, double sigma_px,
                   bool refine_camera);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  bool EvaluateCalibrated(const AnyCamera& camera, double const* const* parameters,
                          double* residuals, double** jacobians) const;
  const CameraState* camera_;
  Vec2 pixel_;
  double inverse_sigma_;
  bool refine_camera_;
};

// Blocks: one pose, or two for a prior between poses.
class PriorCost : public ceres::CostFunction {
 public:
  explicit PriorCost(const PosePrior& prior);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  PosePrior prior_;
};

// (x - start) / sigma for each parameter with a sigma above zero; that at `ratio`, a port's
// distance, by its logarithm, with the same slope at the start.
class ParameterPriorCost : public ceres::CostFunction {
 public:
  ParameterPriorCost(std::vector<double> start, std::vector<double> sigma, int ratio = -1);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  std::vector<double> start_, sigma_;
  int ratio_;
};

// nullptr for none.
ceres::LossFunction* MakeLoss(const RobustLoss& loss);

}  // namespace rsfm
