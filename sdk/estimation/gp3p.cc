#include "rsfm/estimation/gp3p.h"

#include <array>
#include <cmath>

#include <Eigen/LU>

#include "rsfm/estimation/p3p.h"
#include "rsfm/estimation/polynomial.h"

namespace rsfm {
namespace {

// Rays re-based at their points nearest to a common reference: P_i = foot_i + range_i direction_i.
struct Rays {
  std::array<Vec3, 3> foot;
  std::array<Vec3, 3> direction;
  Vec3 origin_range;        // of the original ray origins: the point must lie beyond them
  Vec3 cosines;             // d1.d2, d1.d3, d2.d3
  double max_offset = 0.0;  // distance of the farthest ray from the reference
};

// The reference is the point nearest to the three rays, drawn weakly towards the mean origin for
// when they are parallel.
Rays Rebase(std::span<const Ray3, 3> rays) {
  Mat3 normal_matrix = Mat3::Zero();
  Vec3 right_side = Vec3::Zero();
  const Vec3 mean = (rays[0].origin + rays[1].origin + rays[2].origin) / 3.0;
  for (const Ray3& ray : rays) {
    const Mat3 projector = Mat3::Identity() - ray.direction * ray.direction.transpose();
    normal_matrix += projector;
    right_side += projector * (ray.origin - mean);
  }
  normal_matrix.diagonal().array() += 1e-3;
  const Vec3 reference = mean + normal_matrix.inverse() * right_side;
  Rays result;
  for (int i = 0; i < 3; ++i) {
    result.direction[i] = rays[i].direction;
    result.origin_range[i] = rays[i].direction.dot(rays[i].origin - reference);
    result.foot[i] = rays[i].origin - result.origin_range[i] * rays[i].direction;
    result.max_offset = std::max(result.max_offset, (result.foot[i] - reference).norm());
  }
  result.cosines = {result.direction[0].dot(result.direction[1]),
                    result.direction[0].dot(result.direction[2]),
                    result.direction[1].dot(result.direction[2])};
  return result;
}

// |P_i - P_j|^2 - |X_i - X_j|^2 for the pairs 12, 13, 23 and, halved, the six entries of the
// Jacobian to the ranges that are not zero:  [a b 0; c 0 d; 0 e f].
struct DistanceEquations {
  Vec3 residual;
  double a, b, c, d, e, f;

  DistanceEquations(const Rays& rays, const Vec3& squared_sides, const Vec3& ranges) {
    const Vec3 point_1 = rays.foot[0] + ranges[0] * rays.direction[0];
    const Vec3 point_2 = rays.foot[1] + ranges[1] * rays.direction[1];
    const Vec3 point_3 = rays.foot[2] + ranges[2] * rays.direction[2];
    const Vec3 side_12 = point_1 - point_2, side_13 = point_1 - point_3,
               side_23 = point_2 - point_3;
    residual =
        Vec3(side_12.squaredNorm(), side_13.squaredNorm(), side_23.squaredNorm()) - squared_sides;
    a = side_12.dot(rays.direction[0]);
    b = -side_12.dot(rays.direction[1]);
    c = side_13.dot(rays.direction[0]);
    d = -side_13.dot(rays.direction[2]);
    e = side_23.dot(rays.direction[1]);
    f = -side_23.dot(rays.direction[2]);
  }
  Mat3 Jacobian() const { return 2.0 * (Mat3() << a, b, 0.0, c, 0.0, d, 0.0, e, f).finished(); }
  // The Newton step; not finite where the Jacobian is singular.
  Vec3 Step() const {
    const double factor = 0.5 / (a * d * e + b * c * f);
    return factor * Vec3(-d * e * residual[0] - b * f * residual[1] + b * d * residual[2],
                         -c * f * residual[0] + a * f * residual[1] - a * d * residual[2],
                         c * e * residual[0] - a * e * residual[1] - b * c * residual[2]);
  }
};

// Of a matrix of rank two: the unit vector orthogonal to its columns.
Vec3 LargestCrossProduct(const Mat3& m) {
  const Vec3 candidates[3] = {m.col(0).cross(m.col(1)), m.col(0).cross(m.col(2)),
                              m.col(1).cross(m.col(2))};
  int best = 0;
  for (int i = 1; i < 3; ++i) {
    if (candidates[i].squaredNorm() > candidates[best].squaredNorm()) best = i;
  }
  return candidates[best].normalized();
}

// Newton on the distance equations, at most 12 steps; false when it does not converge.
bool Polish(const Rays& rays, const Vec3& squared_sides, Vec3* ranges) {
  const double tolerance = 1e-13 * squared_sides.maxCoeff();
  Vec3 x = *ranges;
  for (int step = 0; step <= 12; ++step) {
    const DistanceEquations equations(rays, squared_sides, x);
    const double size = equations.residual.cwiseAbs().maxCoeff();
    const Vec3 change = equations.Step();
    // At the precision of the ranges themselves the residual cannot fall further.
    if (size <= tolerance || (size <= 1e3 * tolerance &&
                              change.cwiseAbs().maxCoeff() <= 4e-16 * x.cwiseAbs().maxCoeff())) {
      *ranges = x;
      return true;
    }
    if (!change.allFinite()) return false;
    x += change;
  }
  return false;
}

using Candidates = StaticVector<Vec3, 16>;

// Polynomials in the first range, ascending coefficients.
template <std::size_t kA, std::size_t kB>
std::array<double, kA + kB - 1> Times(const std::array<double, kA>& a,
                                      const std::array<double, kB>& b) {
  std::array<double, kA + kB - 1> product{};
  for (std::size_t i = 0; i < kA; ++i) {
    for (std::size_t j = 0; j < kB; ++j) product[i + j] += a[i] * b[j];
  }
  return product;
}

template <std::size_t kA, std::size_t kB>
std::array<double, kA> Plus(std::array<double, kA> a, double factor,
                            const std::array<double, kB>& b) {
  static_assert(kB <= kA);
  for (std::size_t i = 0; i < kB; ++i) a[i] += factor * b[i];
  return a;
}

template <std::size_t kN>
double At(const std::array<double, kN>& c, double x) {
  return internal::EvaluatePolynomial<static_cast<int>(kN) - 1>(c.data(), x);
}

// With x, y, z the three ranges: the equations of pairs 12 and 13 are y^2 = 2 P y - Q and z^2 = 2 S
// z - T with P, S linear and Q, T quadratic in x. Put into that of pair 23 they leave  A y + B z +
// C y z + D = 0, so y = -(B z + D) / (A + C z); put into the first: E2 z^2 + E1 z + E0 = 0, and
// with z^2 replaced G z + H = 0. z = -H / G in the second gives the octic
//   H^2 + 2 S H G + T G^2 = 0.
void OcticCandidates(const Rays& rays, const Vec3& squared_sides, Candidates* candidates) {
  const Vec3 e12 = rays.foot[0] - rays.foot[1], e13 = rays.foot[0] - rays.foot[2],
             e23 = rays.foot[1] - rays.foot[2];
  const std::array<double, 2> p = {rays.direction[1].dot(e12), rays.cosines[0]};
  const std::array<double, 2> s = {rays.direction[2].dot(e13), rays.cosines[1]};
  const std::array<double, 3> q = {e12.squaredNorm() - squared_sides[0],
                                   2.0 * rays.direction[0].dot(e12), 1.0};
  const std::array<double, 3> t = {e13.squaredNorm() - squared_sides[1],
                                   2.0 * rays.direction[0].dot(e13), 1.0};
  const std::array<double, 2> a = {2.0 * (p[0] + rays.direction[1].dot(e23)), 2.0 * p[1]};
  const std::array<double, 2> b = {2.0 * (s[0] - rays.direction[2].dot(e23)), 2.0 * s[1]};
  const double c = -2.0 * rays.cosines[2];
  const std::array<double, 3> d = {e23.squaredNorm() - squared_sides[2] - q[0] - t[0], -q[1] - t[1],
                                   -2.0};
  const auto e2 = Plus(Plus(Times(b, b), 2.0 * c, Times(p, b)), c * c, q);
  const auto ba_plus_cd = Plus(Times(a, b), c, d);
  const auto e1 = Plus(Plus(Times(b, d), 1.0, Times(p, ba_plus_cd)), c, Times(q, a));  // half of E1
  const auto e0 = Plus(Plus(Times(d, d), 2.0, Times(p, Times(d, a))), 1.0, Times(q, Times(a, a)));
  const auto half_g = Plus(Times(s, e2), 1.0, e1);
  const auto h = Plus(e0, -1.0, Times(t, e2));
  auto octic = Plus(Times(h, h), 4.0, Times(s, Times(h, half_g)));
  octic = Plus(octic, 4.0, Times(t, Times(half_g, half_g)));
  for (const double x : RealRoots<8>(octic)) {
    const double z = -0.5 * At(h, x) / At(half_g, x);
    const double y = -(At(b, x) * z + At(d, x)) / (At(a, x) + c * z);
    const Vec3 ranges(x, y, z);
    if (ranges.allFinite()) candidates->TryPushBack(ranges);
  }
}

// Near a fold two solutions differ by a multiple of the null vector n of the equations' Jacobian J.
// The equations are quadratic, f(x + s n) = f + s J n + s^2 f2(n) exactly with f2(n)_ij = |n_i d_i
// - n_j d_j|^2, and the left null vector l leaves one quadratic equation in s. False when it has no
// real root.
bool OpenFold(const Rays& rays, const Vec3& squared_sides, const Vec3& x, Vec3 pair[2]) {
  const DistanceEquations equations(rays, squared_sides, x);
  const Mat3 jacobian = equations.Jacobian();
  const Vec3 n = LargestCrossProduct(jacobian.transpose());
  const Vec3 l = LargestCrossProduct(jacobian);
  const Vec3 curvature((n[0] * rays.direction[0] - n[1] * rays.direction[1]).squaredNorm(),
                       (n[0] * rays.direction[0] - n[2] * rays.direction[2]).squaredNorm(),
                       (n[1] * rays.direction[1] - n[2] * rays.direction[2]).squaredNorm());
  double s_1 = 0.0, s_2 = 0.0;
  if (!SolveQuadratic(l.dot(curvature), l.dot(jacobian * n), l.dot(equations.residual), &s_1, &s_2))
    return false;
  pair[0] = x + s_1 * n;
  pair[1] = x + s_2 * n;
  return true;
}

// False when the iteration does not converge or leads to ranges that are there already.
bool PolishAndAdd(const Rays& rays, const Vec3& squared_sides, Vec3 ranges,
                  StaticVector<Vec3, 8>* found) {
  if (!Polish(rays, squared_sides, &ranges)) return false;
  for (const Vec3& other : *found) {
    if ((other - ranges).cwiseAbs().maxCoeff() < 1e-8 * ranges.cwiseAbs().maxCoeff()) return false;
  }
  return found->TryPushBack(ranges);
}

// Above this ratio of the rays' distance from their common point to the shortest side of the
// triangle the central start is given up.
constexpr double kNearlyCentral = 0.1;
// The relative discriminant, per unit of that ratio, below which the number of solutions is left to
// the octic.
constexpr double kFoldPerOffset = 4.0;

}  // namespace

Gp3pSolutions SolveGp3p(std::span<const Ray3, kGp3pSampleSize> rays_in_camera,
                        std::span<const Vec3, kGp3pSampleSize> points_in_world) noexcept {
  Gp3pSolutions solutions;
  internal::Triangle triangle;
  if (!internal::MakeTriangle(points_in_world, &triangle)) return solutions;
  const Rays rays = Rebase(rays_in_camera);
  if (!rays.cosines.allFinite() || !rays.origin_range.allFinite()) return solutions;

  // Nearly central: the rays pass within a small part of the shortest side from one point.
  const double offset = rays.max_offset / std::sqrt(triangle.squared_sides.minCoeff());
  StaticVector<Vec3, 8> found;
  bool complete = offset < kNearlyCentral;
  if (complete) {
    for (const internal::CentralDepth& start :
         internal::CentralDepths(rays.cosines, triangle.squared_sides, kFoldPerOffset * offset)) {
      Vec3 pair[2] = {start.depths, start.depths};
      if (start.is_fold && !OpenFold(rays, triangle.squared_sides, start.depths, pair)) {
        complete = false;
        continue;
      }
      complete &= PolishAndAdd(rays, triangle.squared_sides, pair[0], &found);
      if (start.is_fold) complete &= PolishAndAdd(rays, triangle.squared_sides, pair[1], &found);
    }
  }
  if (!complete) {
    Candidates candidates;
    OcticCandidates(rays, triangle.squared_sides, &candidates);
    for (const Vec3& ranges : candidates)
      PolishAndAdd(rays, triangle.squared_sides, ranges, &found);
  }

  for (const Vec3& ranges : found) {
    if (!((ranges - rays.origin_range).minCoeff() > 0.0)) continue;
    const Vec3 point_1 = rays.foot[0] + ranges[0] * rays.direction[0];
    const Mat3 camera_from_frame =
        internal::TriangleFrame(point_1, rays.foot[1] + ranges[1] * rays.direction[1],
                                rays.foot[2] + ranges[2] * rays.direction[2]);
    const Mat3 rotation = camera_from_frame * triangle.world_from_frame.transpose();
    solutions.TryPushBack({Quat(rotation), point_1 - rotation * points_in_world[0]});
  }
  return solutions;
}

}  // namespace rsfm
