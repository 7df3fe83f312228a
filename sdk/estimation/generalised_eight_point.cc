#include "rsfm/estimation/generalised_eight_point.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <array>
#include <cmath>

#include "rsfm/base/so3.h"
#include "rsfm/estimation/five_point.h"
#include "rsfm/estimation/generalised_epipolar.h"

namespace rsfm {
namespace {

constexpr int kSize = kGeneralisedEightPointSampleSize;
using internal::Line;
using Lines = std::array<Line, kSize>;

// The smallest eigenvalue at a rotation, its vector, and the normal equations of the rotation with
// the vector eliminated: the residuals are y . g_i with |y| = 1, and in the basis of the other
// eigenvectors the block to eliminate is diagonal.
struct State {
  double value = 0.0;
  Vec4 vector;
  Mat3 hessian;
  Vec3 gradient;

  State(const Mat3& rotation, const Lines& a, const Lines& b) {
    std::array<Vec4, kSize> g;
    std::array<Vec3, kSize> v, mu;
    Mat4 sum = Mat4::Zero();
    for (int i = 0; i < kSize; ++i) {
      v[i] = rotation * a[i].direction;
      mu[i] = rotation * a[i].moment;
      g[i].head<3>() = v[i].cross(b[i].direction);
      g[i][3] = b[i].direction.dot(mu[i]) + b[i].moment.dot(v[i]);
      sum += g[i] * g[i].transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Mat4> solver(sum);
    value = solver.eigenvalues()[0];
    vector = solver.eigenvectors().col(0);
    hessian.setZero();
    gradient.setZero();
    Mat3 coupling = Mat3::Zero();
    const Vec3 y = vector.head<3>();
    for (int i = 0; i < kSize; ++i) {
      // d (y . g) / d w for R <- Exp(w) R.
      const Vec3& d = b[i].direction;
      const Vec3 row = y.dot(v[i]) * d - v[i].dot(d) * y +
                       vector[3] * (mu[i].cross(d) + v[i].cross(b[i].moment));
      hessian += row * row.transpose();
      gradient += vector.dot(g[i]) * row;
      coupling += row * (solver.eigenvectors().rightCols<3>().transpose() * g[i]).transpose();
    }
    for (int k = 0; k < 3; ++k) {
      const double other = solver.eigenvalues()[k + 1];
      if (other > 0.0) hessian -= coupling.col(k) * coupling.col(k).transpose() / other;
    }
  }
};

}  // namespace

bool SolveGeneralisedEightPoint(std::span<const Ray3, kSize> rays_in_a,
                                std::span<const Ray3, kSize> rays_in_b, const Mat3& rotation_start,
                                Rigid3* b_from_a) noexcept {
  Lines a, b;
  double squared_moment = 0.0;
  for (int i = 0; i < kSize; ++i) {
    a[i] = internal::ToLine(rays_in_a[i]);
    b[i] = internal::ToLine(rays_in_b[i]);
    squared_moment += a[i].moment.squaredNorm() + b[i].moment.squaredNorm();
  }
  const double unit = std::sqrt(squared_moment / (2.0 * kSize));
  if (!(unit > 1e-9) || !std::isfinite(unit)) return false;
  for (int i = 0; i < kSize; ++i) {
    a[i].moment /= unit;
    b[i].moment /= unit;
  }

  Mat3 rotation = rotation_start;
  State state(rotation, a, b);
  if (!std::isfinite(state.value)) return false;
  double damping = 1e-3;
  bool converged = false;
  for (int step = 0; step < 30 && !converged; ++step) {
    Mat3 damped = state.hessian;
    damped.diagonal().array() += damping * state.hessian.diagonal().cwiseAbs().maxCoeff() + 1e-300;
    const Vec3 change = damped.ldlt().solve(-state.gradient);
    if (!change.allFinite()) return false;
    const Mat3 candidate = ExpSo3(change).toRotationMatrix() * rotation;
    const State next(candidate, a, b);
    if (next.value < state.value) {
      converged = change.squaredNorm() < 1e-20;
      rotation = candidate;
      state = next;
      damping = std::max(1e-12, 0.1 * damping);
    } else {
      // At the precision of the eigenvalue nothing falls any further.
      converged = change.squaredNorm() < 1e-16;
      damping *= 10.0;
    }
  }
  const Vec3 translation = unit * state.vector.head<3>() / state.vector[3];
  if (!converged || !translation.allFinite() || !(translation.norm() > 0.0)) return false;
  const Quat quaternion = Quat(rotation).normalized();
  // (t, 1) is known up to sign where the last component is noise: most points lie in front.
  int balance = 0;
  for (int i = 0; i < kSize; ++i) {
    balance += IsInFront({quaternion, translation}, a[i].direction, b[i].direction);
    balance -= IsInFront({quaternion, -translation}, a[i].direction, b[i].direction);
  }
  *b_from_a = Rigid3(quaternion, balance < 0 ? Vec3(-translation) : translation);
  return true;
}

}  // namespace rsfm
