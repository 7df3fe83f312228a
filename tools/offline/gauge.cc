// What navigation leaves free of position, attitude and scale, and what holds it instead.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "tools/offline/bundle.h"

namespace rsfm {
namespace {

using Mat7 = Eigen::Matrix<double, 7, 7>;
using Mat67 = Eigen::Matrix<double, 6, 7>;

// A pose's perturbation when the world is turned by w about `center`, moved by v and scaled by
// 1 + s, in the order (w, v, s). For a rigid motion A of the world the pose becomes T A^-1 =
// Exp(-Adjoint(T) a) T; scaling moves the camera's place only.
Mat67 WorldModes(const Rigid3& pose, const Vec3& center) {
  Mat6 about_center = Mat6::Identity();
  about_center.bottomLeftCorner<3, 3>() = Hat(center);
  Mat67 modes = Mat67::Zero();
  modes.leftCols<6>() = -AdjointSe3(pose) * about_center;
  modes.col(6).tail<3>() = -(pose.rotation * (pose.OriginOfTarget() - center));
  return modes;
}

// The information of the priors about the seven modes.
Mat7 ModeInformation(const BundleProblem& problem, const Vec3& center) {
  Mat7 information = Mat7::Zero();
  for (const PosePrior& prior : problem.priors) {
    const Rigid3& a = problem.images[prior.a].camera_from_world;
    const Rigid3& b = problem.images[prior.IsRelative() ? prior.b : prior.a].camera_from_world;
    const PriorEvaluation e = EvaluatePrior(prior, a, b);
    Mat67 d = e.d_residual_d_a * WorldModes(a, center);
    if (prior.IsRelative()) d += e.d_residual_d_b * WorldModes(b, center);
    information += d.transpose() * d;
  }
  return information;
}

PosePrior HoldPrior(PriorKind kind, int image, const Rigid3& camera_from_world,
                    const Mat3& sqrt_information) {
  PosePrior prior;
  prior.kind = kind;
  prior.a = image;
  prior.measured = camera_from_world.Inverse();
  prior.sqrt_information.topLeftCorner<3, 3>() = sqrt_information;
  return prior;
}

int Farthest(const BundleProblem& problem, int from) {
  const Vec3 place = problem.images[from].camera_from_world.OriginOfTarget();
  int farthest = from;
  double distance = 0.0;
  for (std::size_t i = 0; i < problem.images.size(); ++i) {
    const double d = (problem.images[i].camera_from_world.OriginOfTarget() - place).norm();
    if (d <= distance) continue;
    distance = d;
    farthest = static_cast<int>(i);
  }
  return farthest;
}

}  // namespace

std::array<int, 2> FarPair(const BundleProblem& problem) {
  if (problem.images.empty()) return {-1, -1};
  const int a = Farthest(problem, 0);
  const int b = Farthest(problem, a);
  if (a == b) return {-1, -1};
  return {std::min(a, b), std::max(a, b)};
}

GaugeHold HoldGauge(const BundleProblem& problem, double scale_sigma) {
  GaugeHold hold;
  if (problem.images.empty()) return hold;
  Vec3 center = Vec3::Zero();
  for (const BundleImage& image : problem.images)
    center += image.camera_from_world.OriginOfTarget();
  center /= static_cast<double>(problem.images.size());
  // A mode counts as held by navigation when that knows it to 10 rad, 10 m or 1000 %: coarser than
  // any sensor, finer than rounding.
  const Eigen::SelfAdjointEigenSolver<Mat7> eigen(ModeInformation(problem, center));
  Mat7 free = Mat7::Zero();
  for (int i = 0; i < 7; ++i) {
    if (eigen.eigenvalues()[i] > 1e-2) continue;
    free += eigen.eigenvectors().col(i) * eigen.eigenvectors().col(i).transpose();
  }
  const std::array<int, 2> pair = FarPair(problem);
  const Rigid3& first = problem.images[0].camera_from_world;
  const double size = pair[0] < 0 ? 1.0
                                  : (problem.images[pair[0]].camera_from_world.OriginOfTarget() -
                                     problem.images[pair[1]].camera_from_world.OriginOfTarget())
                                        .norm();
  // Along directions that nothing else pulls any finite sigma holds exactly.
  const Mat3 attitude = free.topLeftCorner<3, 3>(), position = free.block<3, 3>(3, 3);
  if (attitude.trace() > 0.5) {
    hold.gauge.attitude = true;
    hold.priors.push_back(HoldPrior(PriorKind::kAttitude, 0, first, attitude / 1e-2));
  }
  if (position.trace() > 0.5) {
    hold.gauge.position = true;
    hold.priors.push_back(HoldPrior(PriorKind::kPosition, 0, first, position / (1e-2 * size)));
  }
  if (free(6, 6) > 0.5 && pair[0] >= 0) {
    hold.gauge.scale = scale_sigma <= kHeldScale;
    hold.gauge.scale_from_refraction = !hold.gauge.scale;
    hold.gauge.scale_image_a = pair[0];
    hold.gauge.scale_image_b = pair[1];
    hold.priors.push_back(*MakeBaselinePrior(pair[0], pair[1], Rigid3(), size, scale_sigma * size));
  }
  return hold;
}

}  // namespace rsfm
