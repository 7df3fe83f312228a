#include "rsfm/estimation/p3p.h"

#include <array>
#include <cmath>
#include <utility>

#include "rsfm/estimation/polynomial.h"

namespace rsfm {
namespace internal {
namespace {

// Symmetric 3x3: a00 a01 a02 a11 a12 a22.
struct Conic {
  double a00, a01, a02, a11, a12, a22;
};

// Cofactors of a symmetric matrix (symmetric again).
inline Conic Adjugate(const Conic& m) {
  return {m.a11 * m.a22 - m.a12 * m.a12, m.a02 * m.a12 - m.a01 * m.a22,
          m.a01 * m.a12 - m.a02 * m.a11, m.a00 * m.a22 - m.a02 * m.a02,
          m.a01 * m.a02 - m.a00 * m.a12, m.a00 * m.a11 - m.a01 * m.a01};
}

// trace(a b)
inline double TraceOfProduct(const Conic& a, const Conic& b) {
  return a.a00 * b.a00 + a.a11 * b.a11 + a.a22 * b.a22 +
         2.0 * (a.a01 * b.a01 + a.a02 * b.a02 + a.a12 * b.a12);
}

inline double Determinant(const Conic& m, const Conic& adjugate) {
  return m.a00 * adjugate.a00 + m.a01 * adjugate.a01 + m.a02 * adjugate.a02;
}

inline Conic AddScaled(const Conic& a, double factor, const Conic& b) {
  return {a.a00 + factor * b.a00, a.a01 + factor * b.a01, a.a02 + factor * b.a02,
          a.a11 + factor * b.a11, a.a12 + factor * b.a12, a.a22 + factor * b.a22};
}

inline double Bilinear(const Conic& m, const Vec3& u, const Vec3& v) {
  return u.x() * (m.a00 * v.x() + m.a01 * v.y() + m.a02 * v.z()) +
         u.y() * (m.a01 * v.x() + m.a11 * v.y() + m.a12 * v.z()) +
         u.z() * (m.a02 * v.x() + m.a12 * v.y() + m.a22 * v.z());
}

// A degenerate conic A = m n^T + n m^T: adj(A) = -(m x n)(m x n)^T, and A + [m x n]x = 2 m n^T or 2
// n m^T has rank one, its largest row and column are the lines.   [Ding 2023, CVPR; Richter-Gebert
// 2011, Perspectives on Projective Geometry, sec. 11.1] How real the pair is: the largest of
// -diag(adj A); negative for complex lines.
struct LinePair {
  Vec3 line_1, line_2;
};

inline double Realness(const Conic& adjugate) {
  return -std::min({adjugate.a00, adjugate.a11, adjugate.a22});
}

bool SplitLines(const Conic& a, const Conic& adjugate, LinePair* lines) {
  Vec3 p;
  if (adjugate.a00 <= adjugate.a11 && adjugate.a00 <= adjugate.a22) {
    p = Vec3(adjugate.a00, adjugate.a01, adjugate.a02) / std::sqrt(-adjugate.a00);
  } else if (adjugate.a11 <= adjugate.a22) {
    p = Vec3(adjugate.a01, adjugate.a11, adjugate.a12) / std::sqrt(-adjugate.a11);
  } else {
    p = Vec3(adjugate.a02, adjugate.a12, adjugate.a22) / std::sqrt(-adjugate.a22);
  }
  if (!p.allFinite()) return false;
  Mat3 c;
  c << a.a00, a.a01 - p.z(), a.a02 + p.y(),  //
      a.a01 + p.z(), a.a11, a.a12 - p.x(),   //
      a.a02 - p.y(), a.a12 + p.x(), a.a22;
  Eigen::Index row = 0, column = 0;
  const double largest = c.cwiseAbs().maxCoeff(&row, &column);
  if (!(largest > 0.0)) return false;
  lines->line_1 = c.row(row).transpose() / largest;
  lines->line_2 = c.col(column) / largest;
  return true;
}

// Points of `conic` on the line: lambda = alpha u + beta v with u, v spanning the line.
void IntersectLine(const Vec3& line, const Conic& conic, const Conic& length, double squared_length,
                   double fold_tolerance, StaticVector<CentralDepth, 4>* depths) {
  Vec3 u, v;
  const Vec3 size = line.cwiseAbs();
  if (size.x() >= size.y() && size.x() >= size.z()) {
    u = Vec3(-line.y() / line.x(), 1.0, 0.0);
    v = Vec3(-line.z() / line.x(), 0.0, 1.0);
  } else if (size.y() >= size.z()) {
    u = Vec3(1.0, -line.x() / line.y(), 0.0);
    v = Vec3(0.0, -line.z() / line.y(), 1.0);
  } else {
    u = Vec3(1.0, 0.0, -line.x() / line.z());
    v = Vec3(0.0, 1.0, -line.y() / line.z());
  }
  const double a = Bilinear(conic, u, u), b = Bilinear(conic, u, v), c = Bilinear(conic, v, v);
  const double discriminant = b * b - a * c;
  const double terms = b * b + std::abs(a * c);
  const bool is_fold = std::abs(discriminant) < fold_tolerance * terms;
  if (!is_fold && !(discriminant >= -1e-13 * terms))
    return;  // a double root may be complex by rounding
  const double root = is_fold ? 0.0 : std::sqrt(std::max(0.0, discriminant));
  const double q = -(b + std::copysign(root, b));
  // alpha : beta is q / a or c / q.
  const std::array<Vec3, 2> candidates = {Vec3(q * u + a * v), Vec3(c * u + q * v)};
  for (int i = is_fold && std::abs(a) < std::abs(c) ? 1 : 0; i < 2; ++i) {
    Vec3 lambda = candidates[i];
    const double value = Bilinear(length, lambda, lambda);
    if (value > 0.0) {
      lambda *= std::sqrt(squared_length / value);
      if (lambda.sum() < 0.0) lambda = -lambda;
      if (lambda.allFinite()) depths->TryPushBack({lambda, is_fold});
    }
    if (is_fold) break;
  }
}

}  // namespace

Mat3 TriangleFrame(const Vec3& point_1, const Vec3& point_2, const Vec3& point_3) noexcept {
  const Vec3 side = point_2 - point_1;
  Mat3 frame;
  frame.col(0) = side / side.norm();
  const Vec3 normal = side.cross(point_3 - point_1);
  frame.col(2) = normal / normal.norm();
  frame.col(1) = frame.col(2).cross(frame.col(0));
  return frame;
}

bool MakeTriangle(std::span<const Vec3, 3> points, Triangle* triangle) noexcept {
  const Vec3 side_12 = points[1] - points[0];
  const Vec3 side_13 = points[2] - points[0];
  const Vec3 side_23 = points[2] - points[1];
  triangle->squared_sides = {side_12.squaredNorm(), side_13.squaredNorm(), side_23.squaredNorm()};
  const double largest = triangle->squared_sides.maxCoeff();
  // The sine of the angle at X1 and the shortest side, both relative: below 1e-6 the frame has no
  // digits left.
  const double area = side_12.cross(side_13).norm();
  if (!(area > 1e-6 * largest) || !std::isfinite(largest)) return false;
  triangle->world_from_frame = TriangleFrame(points[0], points[1], points[2]);
  return true;
}

StaticVector<CentralDepth, 4> CentralDepths(const Vec3& cosines, const Vec3& squared_sides,
                                            double fold_tolerance) noexcept {
  StaticVector<CentralDepth, 4> depths;
  const double scale = 1.0 / squared_sides.maxCoeff();
  const double a12 = squared_sides[0] * scale, a13 = squared_sides[1] * scale,
               a23 = squared_sides[2] * scale;
  const double b12 = cosines[0], b13 = cosines[1], b23 = cosines[2];
  // lambda' D lambda = 0: the three distance equations with the constants eliminated.   [Persson &
  // Nordberg 2018, eqs. (5)-(7)]
  const Conic d1 = {a23, -a23 * b12, 0.0, a23 - a12, a12 * b23, -a12};
  const Conic d2 = {a23, 0.0, -a23 * b13, -a13, a13 * b23, a23 - a13};
  // det(base + gamma other) = 0, with the larger determinant leading. Both vanish for symmetric
  // triangles, where their sum or difference leads.
  Conic base = d1, other = d2;
  Conic adjugate_base = Adjugate(d1), adjugate_other = Adjugate(d2);
  double det_base = Determinant(base, adjugate_base);
  double det_other = Determinant(other, adjugate_other);
  if (std::abs(det_base) > std::abs(det_other)) {
    std::swap(base, other);
    std::swap(adjugate_base, adjugate_other);
    std::swap(det_base, det_other);
  }
  double mixed_base = TraceOfProduct(adjugate_base, other);
  double mixed_other = TraceOfProduct(adjugate_other, base);
  if (std::abs(det_other) < 1e-2 * std::max(std::abs(mixed_base), std::abs(mixed_other))) {
    other = AddScaled(other, std::copysign(1.0, mixed_base * mixed_other), base);
    adjugate_other = Adjugate(other);
    det_other = Determinant(other, adjugate_other);
    mixed_base = TraceOfProduct(adjugate_base, other);
    mixed_other = TraceOfProduct(adjugate_other, base);
  }
  if (det_other == 0.0) return depths;
  std::array<double, 3> gammas;
  const int num_gammas = SolveMonicCubic(mixed_other / det_other, mixed_base / det_other,
                                         det_base / det_other, &gammas);
  Conic degenerate{}, degenerate_adjugate{};
  double best = 0.0;
  for (int i = 0; i < num_gammas; ++i) {
    const Conic candidate = AddScaled(base, gammas[i], other);
    const Conic adjugate = Adjugate(candidate);
    const double size = std::abs(candidate.a00) + std::abs(candidate.a11) + std::abs(candidate.a22);
    const double realness = Realness(adjugate) / (size * size);
    if (realness > best) {
      best = realness;
      degenerate = candidate;
      degenerate_adjugate = adjugate;
    }
  }
  LinePair lines;
  if (!(best > 0.0) || !SplitLines(degenerate, degenerate_adjugate, &lines)) return depths;
  // All three distance equations added fix the scale.
  const Conic length = {2.0, -b12, -b13, 2.0, -b23, 2.0};
  const double squared_length = squared_sides.sum();
  IntersectLine(lines.line_1, other, length, squared_length, fold_tolerance, &depths);
  IntersectLine(lines.line_2, other, length, squared_length, fold_tolerance, &depths);
  return depths;
}

}  // namespace internal

namespace {

// Newton on the three distance equations, at most 3 steps.
bool PolishDepths(const Vec3& cosines, const Vec3& squared_sides, Vec3* depths) {
  Vec3 x = *depths;
  const double tolerance = 1e-14 * squared_sides.maxCoeff();
  for (int step = 0; step < 3; ++step) {
    const Vec3 residual(
        x[0] * x[0] + x[1] * x[1] - 2.0 * cosines[0] * x[0] * x[1] - squared_sides[0],
        x[0] * x[0] + x[2] * x[2] - 2.0 * cosines[1] * x[0] * x[2] - squared_sides[1],
        x[1] * x[1] + x[2] * x[2] - 2.0 * cosines[2] * x[1] * x[2] - squared_sides[2]);
    if (residual.cwiseAbs().maxCoeff() < tolerance) break;
    // [a b 0; c 0 d; 0 e f] is half the Jacobian.
    const double a = x[0] - cosines[0] * x[1], b = x[1] - cosines[0] * x[0];
    const double c = x[0] - cosines[1] * x[2], d = x[2] - cosines[1] * x[0];
    const double e = x[1] - cosines[2] * x[2], f = x[2] - cosines[2] * x[1];
    const double determinant = -(a * d * e + b * c * f);
    if (determinant == 0.0) return false;
    const double factor = -0.5 / determinant;
    x += factor * Vec3(-d * e * residual[0] - b * f * residual[1] + b * d * residual[2],
                       -c * f * residual[0] + a * f * residual[1] - a * d * residual[2],
                       c * e * residual[0] - a * e * residual[1] - b * c * residual[2]);
  }
  if (!(x.minCoeff() > 0.0) || !x.allFinite()) return false;
  *depths = x;
  return true;
}

}  // namespace

P3pSolutions SolveP3p(std::span<const Vec3, kP3pSampleSize> bearings_in_camera,
                      std::span<const Vec3, kP3pSampleSize> points_in_world) noexcept {
  P3pSolutions solutions;
  internal::Triangle triangle;
  if (!internal::MakeTriangle(points_in_world, &triangle)) return solutions;
  const Vec3 cosines(bearings_in_camera[0].dot(bearings_in_camera[1]),
                     bearings_in_camera[0].dot(bearings_in_camera[2]),
                     bearings_in_camera[1].dot(bearings_in_camera[2]));
  if (!cosines.allFinite()) return solutions;
  for (const internal::CentralDepth& start :
       internal::CentralDepths(cosines, triangle.squared_sides, 0.0)) {
    Vec3 depths = start.depths;
    if (!(depths.minCoeff() > 0.0) || !PolishDepths(cosines, triangle.squared_sides, &depths))
      continue;
    const Vec3 point_1 = depths[0] * bearings_in_camera[0];
    const Mat3 camera_from_frame = internal::TriangleFrame(
        point_1, depths[1] * bearings_in_camera[1], depths[2] * bearings_in_camera[2]);
    const Mat3 rotation = camera_from_frame * triangle.world_from_frame.transpose();
    solutions.TryPushBack({Quat(rotation), point_1 - rotation * points_in_world[0]});
  }
  return solutions;
}

}  // namespace rsfm
