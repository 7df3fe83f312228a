#include "rsfm/estimation/pose_prior.h"

#include <Eigen/Cholesky>
#include <cmath>

namespace rsfm {
namespace {

// A body carried by a camera, with the derivatives to the camera's perturbation (w, v):
//   R_wb(w) = Exp(-R_cw^T w) R_wb,    p(w, v) = p + R_cw^T (Hat(o) w - v),
// where o is the body's origin in the camera.
struct Body {
  Mat3 world_from_body;
  Vec3 position;
  Mat3 world_from_camera;
  Mat36 d_position;
};

Body BodyOf(const Rigid3& body_from_camera, const Rigid3& camera_from_world) {
  Body body;
  const Vec3 origin_in_camera = body_from_camera.OriginOfTarget();
  body.world_from_camera = camera_from_world.rotation.toRotationMatrix().transpose();
  body.world_from_body =
      body.world_from_camera * body_from_camera.rotation.toRotationMatrix().transpose();
  body.position = body.world_from_camera * (origin_in_camera - camera_from_world.translation);
  body.d_position.leftCols<3>() = body.world_from_camera * Hat(origin_in_camera);
  body.d_position.rightCols<3>() = -body.world_from_camera;
  return body;
}

void Attitude(const PosePrior& prior, const Body& body, Eigen::Ref<Vec3> residual,
              Eigen::Ref<Mat36> d_a) {
  residual = LogSo3(Quat(body.world_from_body) * prior.measured.rotation.conjugate());
  d_a.leftCols<3>() = -LeftJacobianInverseSo3(residual) * body.world_from_camera;
}

// Displacement of b in a: R_wa^T (p_b - p_a).
void Displacement(const PosePrior& prior, const Body& a, const Body& b, Eigen::Ref<Vec3> residual,
                  Eigen::Ref<Mat36> d_a, Eigen::Ref<Mat36> d_b) {
  const Mat3 a_from_world = a.world_from_body.transpose();
  const Vec3 between = b.position - a.position;
  residual = a_from_world * between - prior.measured.translation;
  d_a = -a_from_world * a.d_position;
  d_a.leftCols<3>() -= a_from_world * Hat(between) * a.world_from_camera;
  d_b = a_from_world * b.d_position;
}

void RelativeAttitude(const PosePrior& prior, const Body& a, const Body& b,
                      Eigen::Ref<Vec3> residual, Eigen::Ref<Mat36> d_a, Eigen::Ref<Mat36> d_b) {
  const Mat3 a_from_world = a.world_from_body.transpose();
  residual = LogSo3(Quat(a_from_world * b.world_from_body) * prior.measured.rotation.conjugate());
  const Mat3 chain = LeftJacobianInverseSo3(residual) * a_from_world;
  d_a.leftCols<3>() = chain * a.world_from_camera;
  d_b.leftCols<3>() = -chain * b.world_from_camera;
}

void Baseline(const PosePrior& prior, const Body& a, const Body& b, PriorEvaluation* result) {
  const Vec3 between = b.position - a.position;
  const double length = between.norm();
  result->residual[0] = length - prior.measured.translation.x();
  if (!(length > 0.0)) return;  // no direction to push in: zero derivatives
  const Eigen::RowVector3d direction = between.transpose() / length;
  result->d_residual_d_a.row(0) = -direction * a.d_position;
  result->d_residual_d_b.row(0) = direction * b.d_position;
}

bool AllPositive(const Vec3& sigma) { return sigma.allFinite() && (sigma.array() > 0.0).all(); }

bool AllFinite(const Rigid3& transform) {
  return transform.rotation.coeffs().allFinite() && transform.translation.allFinite() &&
         std::abs(transform.rotation.norm() - 1.0) < 1e-6;
}

// The common part of every maker.
Expected<PosePrior> Make(PriorKind kind, int a, int b, const Rigid3& body_from_camera,
                         const Rigid3& measured) {
  PosePrior prior;
  prior.kind = kind;
  prior.a = a;
  prior.b = b;
  prior.body_from_camera = body_from_camera;
  prior.measured = measured;
  if (a < 0 || (prior.IsRelative() && (b < 0 || a == b)))
    return Fail(Errc::kInvalidArgument, "keyframe", a);
  if (!AllFinite(body_from_camera)) return Fail(Errc::kInvalidArgument, "body_from_camera");
  if (!AllFinite(measured)) return Fail(Errc::kInvalidArgument, "measured");
  return prior;
}

// W with W^T W = covariance^-1: the inverse of its lower Cholesky factor.
Expected<PosePrior> WithCovariance(Expected<PosePrior> prior, const Mat6& covariance) {
  if (!prior) return prior;
  if (!covariance.allFinite()) return Fail(Errc::kInvalidArgument, "covariance");
  const Eigen::LLT<Mat6> factor(covariance);
  if (factor.info() != Eigen::Success) return Fail(Errc::kInvalidArgument, "covariance");
  prior->sqrt_information = factor.matrixL().solve(Mat6::Identity());
  return prior;
}

}  // namespace

int PosePrior::Dimension() const noexcept {
  switch (kind) {
    case PriorKind::kDepth:
    case PriorKind::kBaseline:
      return 1;
    case PriorKind::kPosition:
    case PriorKind::kAttitude:
    case PriorKind::kDisplacement:
      return 3;
    case PriorKind::kPose:
    case PriorKind::kRelativePose:
      break;
  }
  return 6;
}

PriorEvaluation EvaluatePrior(const PosePrior& prior, const Rigid3& camera_a_from_world,
                              const Rigid3& camera_b_from_world) noexcept {
  PriorEvaluation result;
  result.dimension = prior.Dimension();
  const Body a = BodyOf(prior.body_from_camera, camera_a_from_world);
  const Body b = prior.IsRelative() ? BodyOf(prior.body_from_camera, camera_b_from_world) : Body{};
  Vec6& r = result.residual;
  Mat6& d_a = result.d_residual_d_a;
  Mat6& d_b = result.d_residual_d_b;
  switch (prior.kind) {
    case PriorKind::kPosition:
      r.head<3>() = a.position - prior.measured.translation;
      d_a.topRows<3>() = a.d_position;
      break;
    case PriorKind::kDepth:
      r[0] = a.position.z() - prior.measured.translation.z();
      d_a.row(0) = a.d_position.row(2);
      break;
    case PriorKind::kAttitude:
      Attitude(prior, a, r.head<3>(), d_a.topRows<3>());
      break;
    case PriorKind::kPose:
      Attitude(prior, a, r.head<3>(), d_a.topRows<3>());
      r.tail<3>() = a.position - prior.measured.translation;
      d_a.bottomRows<3>() = a.d_position;
      break;
    case PriorKind::kDisplacement:
      Displacement(prior, a, b, r.head<3>(), d_a.topRows<3>(), d_b.topRows<3>());
      break;
    case PriorKind::kRelativePose:
      RelativeAttitude(prior, a, b, r.head<3>(), d_a.topRows<3>(), d_b.topRows<3>());
      Displacement(prior, a, b, r.tail<3>(), d_a.bottomRows<3>(), d_b.bottomRows<3>());
      break;
    case PriorKind::kBaseline:
      Baseline(prior, a, b, &result);
      break;
  }
  // Rows beyond the dimension are zero already, and so is sqrt_information there.
  r = (prior.sqrt_information * r).eval();
  d_a = (prior.sqrt_information * d_a).eval();
  d_b = (prior.sqrt_information * d_b).eval();
  return result;
}

Expected<PosePrior> MakePositionPrior(int keyframe, const Rigid3& body_from_camera,
                                      const Vec3& position_in_world_m,
                                      const Vec3& sigma_m) noexcept {
  if (!AllPositive(sigma_m)) return Fail(Errc::kInvalidArgument, "sigma_position_m");
  Expected<PosePrior> prior = Make(PriorKind::kPosition, keyframe, -1, body_from_camera,
                                   Rigid3(Quat::Identity(), position_in_world_m));
  if (prior) prior->sqrt_information.diagonal().head<3>() = sigma_m.cwiseInverse();
  return prior;
}

Expected<PosePrior> MakeDepthPrior(int keyframe, const Rigid3& body_from_camera, double depth_m,
                                   double sigma_m) noexcept {
  if (!(sigma_m > 0.0) || !std::isfinite(sigma_m))
    return Fail(Errc::kInvalidArgument, "sigma_depth_m");
  Expected<PosePrior> prior = Make(PriorKind::kDepth, keyframe, -1, body_from_camera,
                                   Rigid3(Quat::Identity(), Vec3(0.0, 0.0, depth_m)));
  if (prior) prior->sqrt_information(0, 0) = 1.0 / sigma_m;
  return prior;
}

Expected<PosePrior> MakeAttitudePrior(int keyframe, const Rigid3& body_from_camera,
                                      const Quat& world_from_body, const Vec3& sigma_rad) noexcept {
  if (!AllPositive(sigma_rad)) return Fail(Errc::kInvalidArgument, "sigma_attitude_rad");
  Expected<PosePrior> prior = Make(PriorKind::kAttitude, keyframe, -1, body_from_camera,
                                   Rigid3(world_from_body, Vec3::Zero()));
  if (prior) prior->sqrt_information.diagonal().head<3>() = sigma_rad.cwiseInverse();
  return prior;
}

Expected<PosePrior> MakePosePrior(int keyframe, const Rigid3& body_from_camera,
                                  const Rigid3& world_from_body, const Mat6& covariance) noexcept {
  return WithCovariance(Make(PriorKind::kPose, keyframe, -1, body_from_camera, world_from_body),
                        covariance);
}

Expected<PosePrior> MakeDisplacementPrior(int keyframe_a, int keyframe_b,
                                          const Rigid3& body_from_camera,
                                          const Vec3& displacement_in_a_m,
                                          const Vec3& sigma_m) noexcept {
  if (!AllPositive(sigma_m)) return Fail(Errc::kInvalidArgument, "sigma_displacement_m");
  Expected<PosePrior> prior = Make(PriorKind::kDisplacement, keyframe_a, keyframe_b,
                                   body_from_camera, Rigid3(Quat::Identity(), displacement_in_a_m));
  if (prior) prior->sqrt_information.diagonal().head<3>() = sigma_m.cwiseInverse();
  return prior;
}

Expected<PosePrior> MakeRelativePosePrior(int keyframe_a, int keyframe_b,
                                          const Rigid3& body_from_camera,
                                          const Rigid3& body_a_from_body_b,
                                          const Mat6& covariance) noexcept {
  return WithCovariance(
      Make(PriorKind::kRelativePose, keyframe_a, keyframe_b, body_from_camera, body_a_from_body_b),
      covariance);
}

Expected<PosePrior> MakeBaselinePrior(int keyframe_a, int keyframe_b,
                                      const Rigid3& body_from_camera, double distance_m,
                                      double sigma_m) noexcept {
  if (!(sigma_m > 0.0) || !std::isfinite(sigma_m))
    return Fail(Errc::kInvalidArgument, "sigma_baseline_m");
  if (!(distance_m > 0.0)) return Fail(Errc::kInvalidArgument, "distance_m");
  Expected<PosePrior> prior = Make(PriorKind::kBaseline, keyframe_a, keyframe_b, body_from_camera,
                                   Rigid3(Quat::Identity(), Vec3(distance_m, 0.0, 0.0)));
  if (prior) prior->sqrt_information(0, 0) = 1.0 / sigma_m;
  return prior;
}

}  // namespace rsfm
