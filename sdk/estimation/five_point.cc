#include "rsfm/estimation/five_point.h"

#include <Eigen/QR>
#include <array>
#include <cmath>

#include "rsfm/estimation/polynomial.h"

namespace rsfm {
namespace {

// The essential matrix is E = x X + y Y + z Z + W. Monomials in x, y, z in the order of [Nister
// 2004, table 1]: those that elimination removes first, then for x, y and 1 the powers of z.
constexpr int kNumMonomials = 20;
constexpr std::array<std::array<int, 3>, kNumMonomials> kMonomials = {{
    {3, 0, 0}, {0, 3, 0}, {2, 1, 0}, {1, 2, 0}, {2, 0, 1}, {2, 0, 0}, {0, 2, 1},
    {0, 2, 0}, {1, 1, 1}, {1, 1, 0}, {1, 0, 2}, {1, 0, 1}, {1, 0, 0}, {0, 1, 2},
    {0, 1, 1}, {0, 1, 0}, {0, 0, 3}, {0, 0, 2}, {0, 0, 1}, {0, 0, 0},
}};
// Degree one in the order x, y, z, 1 and degree two.
constexpr int kNumQuadratic = 10;
constexpr std::array<std::array<int, 3>, 4> kLinear = {
    {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}}};
constexpr std::array<std::array<int, 3>, kNumQuadratic> kQuadratic = {{{2, 0, 0},
                                                                       {0, 2, 0},
                                                                       {0, 0, 2},
                                                                       {1, 1, 0},
                                                                       {1, 0, 1},
                                                                       {0, 1, 1},
                                                                       {1, 0, 0},
                                                                       {0, 1, 0},
                                                                       {0, 0, 1},
                                                                       {0, 0, 0}}};

template <std::size_t kN>
constexpr int Find(const std::array<std::array<int, 3>, kN>& list, const std::array<int, 3>& a,
                   const std::array<int, 3>& b) {
  for (std::size_t i = 0; i < kN; ++i) {
    if (list[i][0] == a[0] + b[0] && list[i][1] == a[1] + b[1] && list[i][2] == a[2] + b[2])
      return static_cast<int>(i);
  }
  return -1;
}

constexpr auto kLinearTimesLinear = [] {
  std::array<std::array<int, 4>, 4> table{};
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) table[i][j] = Find(kQuadratic, kLinear[i], kLinear[j]);
  }
  return table;
}();
constexpr auto kQuadraticTimesLinear = [] {
  std::array<std::array<int, 4>, kNumQuadratic> table{};
  for (int i = 0; i < kNumQuadratic; ++i) {
    for (int j = 0; j < 4; ++j) table[i][j] = Find(kMonomials, kQuadratic[i], kLinear[j]);
  }
  return table;
}();

using Linear = std::array<double, 4>;
using Quadratic = std::array<double, kNumQuadratic>;
using Cubic = std::array<double, kNumMonomials>;

inline void AddProduct(double factor, const Linear& a, const Linear& b, Quadratic* sum) {
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) (*sum)[kLinearTimesLinear[i][j]] += factor * a[i] * b[j];
  }
}

inline void AddProduct(const Quadratic& a, const Linear& b, Cubic* sum) {
  for (int i = 0; i < kNumQuadratic; ++i) {
    for (int j = 0; j < 4; ++j) (*sum)[kQuadraticTimesLinear[i][j]] += a[i] * b[j];
  }
}

using Constraints = Eigen::Matrix<double, 10, kNumMonomials, Eigen::RowMajor>;
using NullSpace = Eigen::Matrix<double, 9, 4>;  // of row-major E

// det(E) = 0 and (E E' - trace(E E')/2 I) E = 0.   [Nister 2004, eqs. (5), (6)]
Constraints EssentialConstraints(const NullSpace& basis) {
  std::array<std::array<Linear, 3>, 3> e;
  for (int i = 0; i < 9; ++i)
    e[i / 3][i % 3] = {basis(i, 0), basis(i, 1), basis(i, 2), basis(i, 3)};
  Constraints constraints;
  const auto store = [&constraints](int row, const Cubic& cubic) {
    for (int k = 0; k < kNumMonomials; ++k) constraints(row, k) = cubic[k];
  };

  Cubic determinant{};
  for (int c = 0; c < 3; ++c) {
    Quadratic minor{};
    AddProduct(1.0, e[0][(c + 1) % 3], e[1][(c + 2) % 3], &minor);
    AddProduct(-1.0, e[0][(c + 2) % 3], e[1][(c + 1) % 3], &minor);
    AddProduct(minor, e[2][c], &determinant);
  }
  store(0, determinant);

  std::array<std::array<Quadratic, 3>, 3> product{};  // E E' - trace / 2
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      for (int k = 0; k < 3; ++k) AddProduct(1.0, e[i][k], e[j][k], &product[i][j]);
    }
  }
  for (int k = 0; k < kNumQuadratic; ++k) {
    const double half_trace = 0.5 * (product[0][0][k] + product[1][1][k] + product[2][2][k]);
    for (int i = 0; i < 3; ++i) product[i][i][k] -= half_trace;
  }
  product[1][0] = product[0][1];
  product[2][0] = product[0][2];
  product[2][1] = product[1][2];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      Cubic sum{};
      for (int k = 0; k < 3; ++k) AddProduct(product[i][k], e[k][j], &sum);
      store(1 + 3 * i + j, sum);
    }
  }
  return constraints;
}

// Gauss-Jordan elimination of the first ten columns with row pivoting, of which only the rows from
// kFirstNeeded on are finished: no other is read. Rows are handled whole, with lengths the compiler
// knows. False when they are singular.
bool EliminateLastRows(Constraints* constraints) {
  constexpr int kFirstNeeded = 4;
  Constraints& m = *constraints;
  for (int k = 0; k < 10; ++k) {
    Eigen::Index pivot = 0;
    m.col(k).tail(10 - k).cwiseAbs().maxCoeff(&pivot);
    pivot += k;
    if (pivot != k) m.row(k).swap(m.row(pivot));
    const double inverse = 1.0 / m(k, k);
    if (!std::isfinite(inverse)) return false;
    m.row(k) *= inverse;
    for (int r = k + 1; r < 10; ++r) m.row(r) -= m(r, k) * m.row(k);
  }
  for (int k = 9; k > kFirstNeeded; --k) {
    for (int r = kFirstNeeded; r < k; ++r) m.row(r).tail<10>() -= m(r, k) * m.row(k).tail<10>();
  }
  return m.bottomRows<10 - kFirstNeeded>().allFinite();
}

// One row of B(z): polynomials in z, ascending, that multiply x, y and 1.   [Nister 2004, eqs.
// (8)-(11)]
struct HiddenRow {
  std::array<double, 4> x, y;
  std::array<double, 5> one;
};

// <with z> - z <without z>: `upper` is the eliminated row led by x^2 z (y^2 z, x y z), `lower` that
// led by x^2 (y^2, x y).
HiddenRow SubtractShifted(const Eigen::Matrix<double, 1, 10>& upper,
                          const Eigen::Matrix<double, 1, 10>& lower) {
  HiddenRow row;
  row.x = {upper[2], upper[1] - lower[2], upper[0] - lower[1], -lower[0]};
  row.y = {upper[5], upper[4] - lower[5], upper[3] - lower[4], -lower[3]};
  row.one = {upper[9], upper[8] - lower[9], upper[7] - lower[8], upper[6] - lower[7], -lower[6]};
  return row;
}

template <std::size_t kA, std::size_t kB>
void AddTimes(double factor, const std::array<double, kA>& a, const std::array<double, kB>& b,
              std::array<double, kA + kB - 1>* sum) {
  for (std::size_t i = 0; i < kA; ++i) {
    for (std::size_t j = 0; j < kB; ++j) (*sum)[i + j] += factor * a[i] * b[j];
  }
}

// det B(z), of degree ten.
std::array<double, 11> HiddenDeterminant(const std::array<HiddenRow, 3>& rows) {
  std::array<double, 11> determinant{};
  for (int r = 0; r < 3; ++r) {
    const HiddenRow& p = rows[(r + 1) % 3];
    const HiddenRow& q = rows[(r + 2) % 3];
    std::array<double, 7> minor{};
    AddTimes(1.0, p.x, q.y, &minor);
    AddTimes(-1.0, p.y, q.x, &minor);
    AddTimes(1.0, minor, rows[r].one, &determinant);
  }
  return determinant;
}

Vec3 Evaluate(const HiddenRow& row, double z) {
  return {internal::EvaluatePolynomial<3>(row.x.data(), z),
          internal::EvaluatePolynomial<3>(row.y.data(), z),
          internal::EvaluatePolynomial<4>(row.one.data(), z)};
}

}  // namespace

EssentialMatrices SolveFivePoint(
    std::span<const Vec3, kFivePointSampleSize> bearings_in_a,
    std::span<const Vec3, kFivePointSampleSize> bearings_in_b) noexcept {
  EssentialMatrices solutions;
  Eigen::Matrix<double, 9, 5> epipolar;
  for (int i = 0; i < 5; ++i) {
    for (int r = 0; r < 3; ++r)
      epipolar.block<3, 1>(3 * r, i) = bearings_in_b[i][r] * bearings_in_a[i];
  }
  if (!epipolar.allFinite()) return solutions;
  const Eigen::HouseholderQR<Eigen::Matrix<double, 9, 5>> qr(epipolar);
  NullSpace basis = NullSpace::Zero();
  basis.bottomRows<4>().setIdentity();
  basis.applyOnTheLeft(qr.householderQ());

  Constraints constraints = EssentialConstraints(basis);
  if (!EliminateLastRows(&constraints)) return solutions;
  const auto eliminated = constraints.rightCols<10>();
  const std::array<HiddenRow, 3> rows = {SubtractShifted(eliminated.row(4), eliminated.row(5)),
                                         SubtractShifted(eliminated.row(6), eliminated.row(7)),
                                         SubtractShifted(eliminated.row(8), eliminated.row(9))};
  for (const double z : RealRoots<10>(HiddenDeterminant(rows))) {
    // (x, y, 1) is the null vector of B(z).
    const std::array<Vec3, 3> b = {Evaluate(rows[0], z), Evaluate(rows[1], z),
                                   Evaluate(rows[2], z)};
    Vec3 null = b[0].cross(b[1]);
    for (const Vec3& other : {Vec3(b[0].cross(b[2])), Vec3(b[1].cross(b[2]))}) {
      if (std::abs(other.z()) > std::abs(null.z())) null = other;
    }
    if (null.z() == 0.0) continue;
    const Eigen::Matrix<double, 9, 1> entries =
        basis * Vec4(null.x() / null.z(), null.y() / null.z(), z, 1.0).normalized();
    if (!entries.allFinite()) continue;
    Mat3 essential;
    essential << entries[0], entries[1], entries[2], entries[3], entries[4], entries[5], entries[6],
        entries[7], entries[8];
    solutions.TryPushBack(essential);
  }
  return solutions;
}

StaticVector<Rigid3, 4> DecomposeEssential(const Mat3& essential) noexcept {
  StaticVector<Rigid3, 4> poses;
  // With E = [t]x R: the columns of E are orthogonal to t, and t t' = trace(E E')/2 I - E E'. [Horn
  // 1990, eq. (17)]
  const Mat3 product = essential * essential.transpose();
  const Mat3 outer = 0.5 * product.trace() * Mat3::Identity() - product;
  Eigen::Index largest = 0;
  const double squared = outer.diagonal().maxCoeff(&largest);
  if (!(squared > 0.0) || !std::isfinite(squared)) return poses;
  const Vec3 t = outer.col(largest) / std::sqrt(squared);
  const double length_squared = t.squaredNorm();
  if (!(length_squared > 0.0)) return poses;
  // (t.t) R = Cofactors(E) - [t]x E   [Horn 1990, eq. (24)]; the second solution has -t.
  Mat3 cofactors;
  cofactors.row(0) = essential.row(1).cross(essential.row(2));
  cofactors.row(1) = essential.row(2).cross(essential.row(0));
  cofactors.row(2) = essential.row(0).cross(essential.row(1));
  const Vec3 unit = t / std::sqrt(length_squared);
  for (const double sign : {1.0, -1.0}) {
    const Mat3 rotation = (cofactors - sign * Hat(t) * essential) / length_squared;
    if (!rotation.allFinite()) continue;
    const Quat quaternion = Quat(rotation).normalized();
    poses.TryPushBack({quaternion, unit});
    poses.TryPushBack({quaternion, -unit});
  }
  return poses;
}

bool IsInFront(const Rigid3& b_from_a, const Vec3& bearing_in_a,
               const Vec3& bearing_in_b) noexcept {
  // The depths d_a, d_b that bring d_b b nearest to d_a R a + t have the signs of these, by
  // Cramer's rule.
  const Vec3 a = b_from_a.rotation * bearing_in_a;
  const double aa = a.squaredNorm(), bb = bearing_in_b.squaredNorm(), ab = a.dot(bearing_in_b);
  const double ta = b_from_a.translation.dot(a), tb = b_from_a.translation.dot(bearing_in_b);
  return ab * tb - bb * ta > 0.0 && aa * tb - ab * ta > 0.0;
}

}  // namespace rsfm
