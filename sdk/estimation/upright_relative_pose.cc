#include "rsfm/estimation/upright_relative_pose.h"

#include <array>
#include <cmath>

#include "rsfm/estimation/five_point.h"
#include "rsfm/estimation/polynomial.h"

namespace rsfm {
namespace {

using Quadratic = std::array<double, 3>;  // in q, ascending
using QuadraticVector = std::array<Quadratic, 3>;

// (1 + q^2) (R a x b) for R a turn about z.
QuadraticVector Normal(const Vec3& a, const Vec3& b) {
  // (1 + q^2) R a = (x (1 - q^2) - 2 q y,  y (1 - q^2) + 2 q x,  z (1 + q^2)).
  const QuadraticVector turned = {
      {{a.x(), -2.0 * a.y(), -a.x()}, {a.y(), 2.0 * a.x(), -a.y()}, {a.z(), 0.0, a.z()}}};
  QuadraticVector normal;
  for (int r = 0; r < 3; ++r) {
    const int next = (r + 1) % 3, last = (r + 2) % 3;
    for (int k = 0; k < 3; ++k)
      normal[r][k] = turned[next][k] * b[last] - turned[last][k] * b[next];
  }
  return normal;
}

std::array<double, 7> Determinant(const std::array<QuadraticVector, 3>& n) {
  std::array<double, 7> determinant{};
  for (int r = 0; r < 3; ++r) {
    std::array<double, 5> minor{};
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        minor[i + j] += n[1][(r + 1) % 3][i] * n[2][(r + 2) % 3][j] -
                        n[1][(r + 2) % 3][i] * n[2][(r + 1) % 3][j];
      }
    }
    for (int i = 0; i < 5; ++i) {
      for (int k = 0; k < 3; ++k) determinant[i + k] += minor[i] * n[0][r][k];
    }
  }
  return determinant;
}

// The unit vector that is most nearly orthogonal to three vectors of rank two.
bool Orthogonal(const std::array<Vec3, 3>& n, Vec3* direction) {
  Vec3 best = Vec3::Zero();
  for (int i = 0; i < 3; ++i) {
    const Vec3 candidate = n[i].cross(n[(i + 1) % 3]);
    if (candidate.squaredNorm() > best.squaredNorm()) best = candidate;
  }
  const double largest = std::max({n[0].norm(), n[1].norm(), n[2].norm()});
  if (!(best.norm() > 1e-10 * largest * largest)) return false;
  *direction = best.normalized();
  return true;
}

}  // namespace

UprightRelativeSolutions SolveUprightRelativePose(
    std::span<const Vec3, kUprightRelativeSampleSize> bearings_in_a,
    std::span<const Vec3, kUprightRelativeSampleSize> bearings_in_b, const Vec3& down_in_a,
    const Vec3& down_in_b) noexcept {
  UprightRelativeSolutions solutions;
  const Mat3 upright_from_a = Quat::FromTwoVectors(down_in_a, Vec3::UnitZ()).toRotationMatrix();
  const Mat3 upright_from_b = Quat::FromTwoVectors(down_in_b, Vec3::UnitZ()).toRotationMatrix();
  std::array<Vec3, 3> a, b;
  std::array<QuadraticVector, 3> normals;
  for (int i = 0; i < 3; ++i) {
    a[i] = upright_from_a * bearings_in_a[i].normalized();
    b[i] = upright_from_b * bearings_in_b[i].normalized();
    if (!a[i].allFinite() || !b[i].allFinite()) return solutions;
    normals[i] = Normal(a[i], b[i]);
  }
  // At q = i all three normals are multiples of two vectors only: 1 + q^2 divides the determinant.
  const std::array<double, 7> d = Determinant(normals);
  const double c4 = d[6], c3 = d[5], c2 = d[4] - c4, c1 = d[3] - c3, c0 = d[2] - c2;
  for (const double q : RealRoots<4>({c0, c1, c2, c3, c4})) {
    const double cosine = (1.0 - q * q) / (1.0 + q * q), sine = 2.0 * q / (1.0 + q * q);
    Mat3 turn;
    turn << cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0;
    std::array<Vec3, 3> n;
    for (int i = 0; i < 3; ++i) n[i] = (turn * a[i]).cross(b[i]);
    Vec3 direction;
    if (!turn.allFinite() || !Orthogonal(n, &direction)) continue;
    const Quat quaternion =
        Quat(Mat3(upright_from_b.transpose() * turn * upright_from_a)).normalized();
    direction = upright_from_b.transpose() * direction;
    int balance = 0;
    for (int i = 0; i < 3; ++i) {
      balance += IsInFront({quaternion, direction}, bearings_in_a[i], bearings_in_b[i]);
      balance -= IsInFront({quaternion, -direction}, bearings_in_a[i], bearings_in_b[i]);
    }
    if (balance == 0) continue;
    solutions.TryPushBack({quaternion, balance > 0 ? direction : Vec3(-direction)});
  }
  return solutions;
}

}  // namespace rsfm
