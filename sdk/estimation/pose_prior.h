// What navigation says about poses, as residuals with analytic derivatives. Both solvers call
// these.
//
// The unknowns are camera_from_world; navigation speaks of the body, so every prior carries the
// lever arm body_from_camera. World: any
// frame; for kDepth one whose third axis points down (local NED). Residuals are whitened:
// sqrt_information times the difference.
#pragma once

#include <cstdint>

#include "rsfm/base/error.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/estimation/robust_loss.h"

namespace rsfm {

enum class PriorKind : std::uint8_t {
  kPosition,      // 3: the body's origin in the world, m
  kDepth,         // 1: the third coordinate of the body's origin in the world, m
  kAttitude,      // 3: world_from_body, rotation vector in world axes, rad
  kPose,          // 6: (attitude, position) together, with a full covariance
  kDisplacement,  // 3: the origin of body b in body a, m (an integrated DVL track)
  kRelativePose,  // 6: body_a_from_body_b, (rotation vector in body a's axes, displacement)
  kBaseline,      // 1: the distance between the origins of bodies a and b, m (the scale)
};

struct PosePrior {
  PriorKind kind = PriorKind::kPosition;
  int a = 0;   // keyframe
  int b = -1;  // the second keyframe of the last three kinds, otherwise -1
  Rigid3 body_from_camera;
  // world_from_body, or body_a_from_body_b; kDepth is translation.z, kBaseline translation.x.
  Rigid3 measured;
  Mat6 sqrt_information = Mat6::Zero();  // the top left Dimension() square
  RobustLoss loss;

  int Dimension() const noexcept;
  bool IsRelative() const noexcept { return kind >= PriorKind::kDisplacement; }
};

struct PriorEvaluation {
  int dimension = 0;  // rows in use; the rest is zero
  Vec6 residual = Vec6::Zero();
  Mat6 d_residual_d_a = Mat6::Zero();
  Mat6 d_residual_d_b = Mat6::Zero();  // zero where the prior has no second keyframe
};

// `b_from_world` is ignored where the prior has no second keyframe. Precondition: finite poses.
PriorEvaluation EvaluatePrior(const PosePrior& prior, const Rigid3& camera_a_from_world,
                              const Rigid3& camera_b_from_world) noexcept;

// Makers. kInvalidArgument for a sigma that is not positive and finite or a measurement that is not
// finite, with `where` naming it.
Expected<PosePrior> MakePositionPrior(int keyframe, const Rigid3& body_from_camera,
                                      const Vec3& position_in_world_m,
                                      const Vec3& sigma_m) noexcept;
Expected<PosePrior> MakeDepthPrior(int keyframe, const Rigid3& body_from_camera, double depth_m,
                                   double sigma_m) noexcept;
// Sigmas about the world's axes: north, east, down.
Expected<PosePrior> MakeAttitudePrior(int keyframe, const Rigid3& body_from_camera,
                                      const Quat& world_from_body, const Vec3& sigma_rad) noexcept;
// Covariance of (rotation vector in world axes, position in the world).
Expected<PosePrior> MakePosePrior(int keyframe, const Rigid3& body_from_camera,
                                  const Rigid3& world_from_body, const Mat6& covariance) noexcept;
Expected<PosePrior> MakeDisplacementPrior(int keyframe_a, int keyframe_b,
                                          const Rigid3& body_from_camera,
                                          const Vec3& displacement_in_a_m,
                                          const Vec3& sigma_m) noexcept;
// Covariance of (rotation vector in body a's axes, displacement in body a).
Expected<PosePrior> MakeRelativePosePrior(int keyframe_a, int keyframe_b,
                                          const Rigid3& body_from_camera,
                                          const Rigid3& body_a_from_body_b,
                                          const Mat6& covariance) noexcept;
Expected<PosePrior> MakeBaselinePrior(int keyframe_a, int keyframe_b,
                                      const Rigid3& body_from_camera, double distance_m,
                                      double sigma_m) noexcept;

}  // namespace rsfm
