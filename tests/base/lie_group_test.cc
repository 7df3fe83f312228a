// Laws of SO(3) and SE(3), each over a seeded set of elements that includes the hard ones (no, tiny
// and half turns).
#include <gtest/gtest.h>

#include <numbers>
#include <vector>

#include "rsfm/base/rigid3.h"
#include "rsfm/base/rng.h"

namespace rsfm {
namespace {

using std::numbers::pi;

std::vector<Vec3> RotationVectors() {
  std::vector<Vec3> vectors = {Vec3::Zero()};
  Rng rng(7);
  for (const double angle : {1e-300, 1e-12, 1e-9, 1e-6, 9e-5, 1.1e-4, 1e-3, 9.9e-3, 1.01e-2, 0.1,
                             1.0, 2.0, 3.0, pi - 1e-3, pi - 1e-6, pi - 1e-9}) {
    for (int i = 0; i < 4; ++i)
      vectors.push_back(angle * Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian()).normalized());
  }
  return vectors;
}

std::vector<Vec6> Tangents() {
  std::vector<Vec6> tangents;
  Rng rng(8);
  for (const Vec3& rotation : RotationVectors()) {
    Vec6 tangent;
    tangent << rotation, Vec3(rng.Gaussian(), rng.Gaussian(), rng.Gaussian());
    tangents.push_back(tangent);
  }
  return tangents;
}

double Difference(const Rigid3& a, const Rigid3& b) {
  return AngleBetween(a.rotation, b.rotation) + (a.translation - b.translation).norm();
}

TEST(So3, LogInvertsExp) {
  for (const Vec3& v : RotationVectors()) {
    EXPECT_LT((LogSo3(ExpSo3(v)) - v).norm(), 1e-14 * (1.0 + v.norm())) << v.transpose();
  }
}

TEST(So3, ExpIsUnitAndTurnsByItsAngle) {
  for (const Vec3& v : RotationVectors()) {
    const Quat q = ExpSo3(v);
    EXPECT_NEAR(q.norm(), 1.0, 1e-15);
    EXPECT_NEAR(AngleBetween(Quat::Identity(), q), v.norm(), 1e-14);
    EXPECT_LT((q * v - v).norm(), 1e-14);  // the axis stays
  }
}

TEST(So3, BothSignsOfAQuaternionAreOneRotation) {
  for (const Vec3& v : RotationVectors()) {
    Quat q = ExpSo3(v);
    q.coeffs() *= -1.0;
    EXPECT_LT((LogSo3(q) - v).norm(), 1e-14 * (1.0 + v.norm()));
  }
}

TEST(So3, HatIsTheCrossProduct) {
  const Vec3 a(1, -2, 3), b(0.5, 4, -1);
  EXPECT_LT((Hat(a) * b - a.cross(b)).norm(), 1e-15);
}

TEST(So3, LeftJacobianIsTheDerivativeOfExp) {
  for (const Vec3& v : RotationVectors()) {
    const Mat3 jacobian = LeftJacobianSo3(v);
    for (int axis = 0; axis < 3; ++axis) {
      const double h = 1e-6;
      const Vec3 step = h * Vec3::Unit(axis);
      const Vec3 numeric = (LogSo3(ExpSo3(v + step) * ExpSo3(v).conjugate()) -
                            LogSo3(ExpSo3(v - step) * ExpSo3(v).conjugate())) /
                           (2 * h);
      EXPECT_LT((jacobian.col(axis) - numeric).norm(), 1e-8) << v.transpose();
    }
  }
}

TEST(So3, LeftJacobianInverseIsItsInverse) {
  for (const Vec3& v : RotationVectors()) {
    EXPECT_LT((LeftJacobianSo3(v) * LeftJacobianInverseSo3(v) - Mat3::Identity()).norm(), 1e-11)
        << v.transpose();
  }
}

TEST(Se3, LogInvertsExp) {
  for (const Vec6& x : Tangents())
    EXPECT_LT((LogSe3(ExpSe3(x)) - x).norm(), 1e-11 * (1.0 + x.norm())) << x.transpose();
}

TEST(Se3, GroupLaws) {
  const std::vector<Vec6> tangents = Tangents();
  for (std::size_t i = 0; i + 2 < tangents.size(); ++i) {
    const Rigid3 a = ExpSe3(tangents[i]), b = ExpSe3(tangents[i + 1]), c = ExpSe3(tangents[i + 2]);
    EXPECT_LT(Difference((a * b) * c, a * (b * c)), 1e-14);
    EXPECT_LT(Difference(a * a.Inverse(), Rigid3()), 1e-14);
    const Vec3 point(1, 2, 3);
    EXPECT_LT(((a * b) * point - a * (b * point)).norm(), 1e-14);
    EXPECT_LT((a * a.OriginOfTarget()).norm(), 1e-14);
  }
}

TEST(Se3, AdjointMovesAPerturbationAcross) {
  const std::vector<Vec6> tangents = Tangents();
  for (std::size_t i = 0; i + 1 < tangents.size(); ++i) {
    const Rigid3 transform = ExpSe3(tangents[i]);
    const Vec6 x = 0.3 * tangents[i + 1];
    EXPECT_LT(Difference(transform * ExpSe3(x), ExpSe3(AdjointSe3(transform) * x) * transform),
              1e-13);
  }
}

TEST(Se3, PerturbIsOnTheLeft) {
  Vec6 turn;
  turn << 0, 0, pi / 2, 0, 0, 0;
  const Rigid3 shift(Quat::Identity(), Vec3(1, 0, 0));
  EXPECT_LT((Perturb(shift, turn).translation - Vec3(0, 1, 0)).norm(), 1e-15);
}

TEST(Se3, InterpolateMeetsItsEndsAndIsHalfway) {
  const Rigid3 start = ExpSe3(Tangents()[20]), end = ExpSe3(Tangents()[44]);
  EXPECT_LT(Difference(Interpolate(start, end, 0.0), start), 1e-14);
  EXPECT_LT(Difference(Interpolate(start, end, 1.0), end), 1e-13);
  const Rigid3 middle = Interpolate(start, end, 0.5);
  EXPECT_NEAR(AngleBetween(start.rotation, middle.rotation),
              AngleBetween(middle.rotation, end.rotation), 1e-13);
  EXPECT_LT((middle.translation - 0.5 * (start.translation + end.translation)).norm(), 1e-15);
}

TEST(Se3, LongProductsStayRotations) {
  Rigid3 product;
  const Rigid3 step = ExpSe3(Tangents()[50]);
  for (int i = 0; i < 1'000'000; ++i) product = step * product;
  EXPECT_NEAR(product.rotation.norm(), 1.0, 1e-15);
}

}  // namespace
}  // namespace rsfm
