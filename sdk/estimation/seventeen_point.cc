#include "rsfm/estimation/seventeen_point.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <array>

#include "rsfm/estimation/five_point.h"
#include "rsfm/estimation/generalised_epipolar.h"

namespace rsfm {
namespace {

using Coefficients = Eigen::Matrix<double, kSeventeenPointSampleSize, 9>;
using Mat9 = Eigen::Matrix<double, 9, 9>;
using internal::Line;
using Lines = std::array<Line, kSeventeenPointSampleSize>;

// E of unit norm with the entries of R eliminated; row-major. False where it is not determined.
bool SolveEssential(const Lines& a, const Lines& b, Mat3* essential) {
  Coefficients of_essential, of_rotation;
  double longest_moment = 0.0;
  for (int i = 0; i < kSeventeenPointSampleSize; ++i) {
    for (int r = 0; r < 3; ++r) {
      of_essential.block<1, 3>(i, 3 * r) = (b[i].direction[r] * a[i].direction).transpose();
      of_rotation.block<1, 3>(i, 3 * r) =
          (b[i].direction[r] * a[i].moment + b[i].moment[r] * a[i].direction).transpose();
    }
    longest_moment = std::max({longest_moment, a[i].moment.norm(), b[i].moment.norm()});
  }
  if (!of_essential.allFinite() || !of_rotation.allFinite()) return false;
  // Rays that pass a common centre within rounding.
  if (!(longest_moment > 1e-9)) return false;

  Eigen::ColPivHouseholderQR<Coefficients> qr;
  qr.setThreshold(1e-7);
  qr.compute(of_rotation);
  const Eigen::Index rank = qr.rank();
  of_essential.applyOnTheLeft(qr.householderQ().adjoint());
  const auto rest = of_essential.bottomRows(kSeventeenPointSampleSize - rank);
  const Mat9 moments = rest.transpose().lazyProduct(rest);
  const Eigen::SelfAdjointEigenSolver<Mat9> solver(moments);
  // A second null vector: the sample does not determine E. Each row of E's coefficients is unit.
  if (!(solver.eigenvalues()[1] > 1e-14 * kSeventeenPointSampleSize)) return false;
  const Eigen::Matrix<double, 9, 1> e = solver.eigenvectors().col(0);
  *essential << e[0], e[1], e[2], e[3], e[4], e[5], e[6], e[7], e[8];
  return true;
}

// How many of the points lie in front of both cameras less how many lie behind both.
int Balance(const Rigid3& pose, const Lines& a, const Lines& b) {
  const Rigid3 back(pose.rotation, -pose.translation);
  int balance = 0;
  for (int i = 0; i < kSeventeenPointSampleSize; ++i) {
    balance += IsInFront(pose, a[i].direction, b[i].direction);
    balance -= IsInFront(back, a[i].direction, b[i].direction);
  }
  return balance;
}

}  // namespace

SeventeenPointSolutions SolveSeventeenPoint(
    std::span<const Ray3, kSeventeenPointSampleSize> rays_in_a,
    std::span<const Ray3, kSeventeenPointSampleSize> rays_in_b) noexcept {
  SeventeenPointSolutions solutions;
  Lines a, b;
  for (int i = 0; i < kSeventeenPointSampleSize; ++i) {
    a[i] = internal::ToLine(rays_in_a[i]);
    b[i] = internal::ToLine(rays_in_b[i]);
  }
  Mat3 essential;
  if (!SolveEssential(a, b, &essential)) return solutions;
  // The nearest essential matrix: E = U diag(1, 1, 0) V'.   [Hartley & Zisserman 2004, sec. 9.6]
  const Eigen::JacobiSVD<Mat3> svd(essential, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Mat3 u = svd.matrixU(), v = svd.matrixV();
  if (u.determinant() < 0.0) u = -u;
  if (v.determinant() < 0.0) v = -v;
  for (const double sign : {1.0, -1.0}) {
    Mat3 turn;
    turn << 0.0, -sign, 0.0, sign, 0.0, 0.0, 0.0, 0.0, 1.0;
    const Mat3 rotation = u * turn * v.transpose();
    Vec3 direction = u.col(2);
    const double length = internal::FitBaseline(rotation, direction, a, b);
    if (!(std::abs(length) > 0.0) || !std::isfinite(length)) continue;
    const Quat quaternion = Quat(rotation).normalized();
    // The sign of the length is noise where refraction is weak; that of the depths is not.
    const int balance = Balance({quaternion, direction}, a, b);
    if (balance == 0) continue;
    if (balance < 0) direction = -direction;
    int in_front = 0;
    for (int i = 0; i < kSeventeenPointSampleSize; ++i)
      in_front += IsInFront({quaternion, direction}, a[i].direction, b[i].direction);
    if (2 * in_front > kSeventeenPointSampleSize)
      solutions.TryPushBack({quaternion, std::abs(length) * direction});
  }
  return solutions;
}

}  // namespace rsfm
