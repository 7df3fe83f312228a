// Navigation as factors of window adjustment, together with what is not quite right about the
// sensors: a heading that is off by a slowly drifting angle, a Doppler log whose scale, mounting
// and place are known only roughly, a clock that runs apart from the camera's.
//
// World: local north-east-down; body: forward-right-down. The sensors' errors are states, shared by
// all keyframes of a window:
//   attitude        measured = Exp(heading_bias e_down) ned_from_body
//   Doppler log     measured = (1 + scale) Exp(misalignment) (v + w x lever) in the body, so that
//                   the displacement of the body's origin is, to first order in the states,
//                     (1 + scale)(Exp(heading_bias e_down) (p_b - p_a) + (R_b - R_a) l) = D + B m,
//                     D = sum R_i v_i dt,  B = sum R_i Hat(v_i) dt  with the measured R_i, v_i
//   clock           measured(t) is the truth at t + clock_offset
//
// Both are written in the axes of what was measured, so that turning the world about the vertical
// and the heading bias against it changes no residual and, at any one set of poses, the derivatives
// say so to the last digit: the yaw that nothing measures gains no certainty from noise.
#pragma once

#include "rsfm/base/error.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/estimation/robust_loss.h"

namespace rsfm {

// Places in NavStates. Two blocks of six; what is not named is not used.
enum NavState : int {
  kHeadingBias = 0,    // rad
  kVelocityScale = 1,  // -
  kMisalignment = 2,   // rad, three of them: a small rotation in the body
  kClockOffset = 5,    // s
  kVelocityLever = 6,  // m, three of them: what is left of the log's place in the body
  kNumUsedNavStates = 9,
};
inline constexpr int kNumNavStates = 12;
inline constexpr int kNavBlocks = 2;
using NavStates = Eigen::Matrix<double, kNumNavStates, 1>;
using NavStateHessian = Eigen::Matrix<double, kNumNavStates, kNumNavStates>;

enum class NavFactorKind : std::uint8_t {
  kAttitude,      // 3: rotation vector about the world's axes, rad
  kDisplacement,  // 3: of the body's origin from keyframe a to b, m
  kDepth,         // 1: of the body's origin, m
  kPosition,      // 3: of the body's origin, m
};

struct NavFactor {
  NavFactorKind kind = NavFactorKind::kAttitude;
  int a = 0;   // keyframe
  int b = -1;  // the second keyframe of a displacement, otherwise -1
  Rigid3 body_from_camera;
  Quat ned_from_body = Quat::Identity();  // kAttitude: as measured
  Vec3 measured_m = Vec3::Zero();         // displacement or position; kDepth: its third
  Vec3 rate_radps = Vec3::Zero();         // kAttitude: of the body about the world's axes
  Vec3 velocity_mps = Vec3::Zero();       // the others: of the body in the world; the clock's lever
  Mat3 by_misalignment = Mat3::Zero();    // kDisplacement: B
  Mat3 turned = Mat3::Zero();             // kDisplacement: R_b - R_a as measured
  Mat3 sqrt_information = Mat3::Zero();
  RobustLoss loss;

  int Dimension() const noexcept { return kind == NavFactorKind::kDepth ? 1 : 3; }
};

struct NavEvaluation {
  using Mat3N = Eigen::Matrix<double, 3, kNumNavStates>;
  Vec3 residual = Vec3::Zero();  // whitened; rows beyond the dimension are zero
  Mat36 d_residual_d_a = Mat36::Zero();
  Mat36 d_residual_d_b = Mat36::Zero();
  Mat3N d_residual_d_states = Mat3N::Zero();
};

// `camera_b_from_world` is ignored where there is no second keyframe. For kDisplacement
// velocity_mps is the difference of the velocities at b and a.
NavEvaluation EvaluateNavFactor(const NavFactor& factor, const Rigid3& camera_a_from_world,
                                const Rigid3& camera_b_from_world,
                                const NavStates& states) noexcept;

// kInvalidArgument naming what is not finite, or a keyframe that cannot be.
Status ValidateNavFactor(const NavFactor& factor) noexcept;

// The first two derivatives' worth of a body carried by a camera: where it is, and what a left
// perturbation (w, v) of camera_from_world does to it:
//   R_wb -> Exp(-R_wc w) R_wb,   p -> p + d_position (w, v).
struct CarriedBody {
  CarriedBody(const Rigid3& body_from_camera, const Rigid3& camera_from_world) noexcept;
  Mat3 world_from_camera;
  Mat3 world_from_body;
  Vec3 position;
  Mat36 d_position;
};

}  // namespace rsfm
