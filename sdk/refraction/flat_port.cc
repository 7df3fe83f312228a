#include "rsfm/refraction/flat_port.h"

#include <algorithm>
#include <cmath>

namespace rsfm {

struct FlatPort::Path {
  Vec3 radial;          // unit, away from the axis; any perpendicular of the axis for a point on it
  double r, z;          // of the point
  double sine, cosine;  // of the angle in air
  double tangent[3];    // of the angles in air, glass, water
  double sine_over_r;   // finite on the axis
  int steps;
};

FlatPort::FlatPort(const PortConfig& config) noexcept
    : normal_(config.normal.normalized()),
      distance_(config.distance_m),
      thickness_(config.thickness_m),
      index_{config.index_air, config.index_glass, config.index_water} {
  lowest_ = 0;
  for (int k = 1; k < 3; ++k) {
    if (index_[k] < index_[lowest_]) lowest_ = k;
  }
  for (int k = 0; k < 3; ++k) {
    ratio_[k] = index_[lowest_] / index_[k];
    excess_[k] = (1.0 - ratio_[k]) * (1.0 + ratio_[k]);
  }
  depth_ratio_[0] = index_[2] / index_[0];
  depth_ratio_[1] = index_[2] / index_[1];
}

namespace {

constexpr int kHalleySteps = 8;  // from there on Newton, which is monotone from below

// Where a u / sqrt(1 + e u^2) tends to for large u.
double Limit(double a, double e) {
  return a > 0.0 ? a / std::sqrt(e) : 0.0;  // infinite for e = 0
}

}  // namespace

Projection FlatPort::Solve(const Vec3& point, Path* path) const noexcept {
  if (!IsUsable(point)) return Projection::kNotFinite;
  const double z = normal_.dot(point);
  const double water = z - distance_ - thickness_;
  if (!(water > 0.0)) {
    return z - distance_ > 0.0 ? Projection::kInsideGlass : Projection::kBehindPort;
  }
  const Vec3 offset = point - z * normal_;
  const double r = offset.norm();

  const double length[3] = {distance_, thickness_, water};
  // The path equation is u (l + sum_k a_k w_k) = r, w_k = 1 / sqrt(1 + e_k u^2), over the media
  // other than the lowest.
  const int k1 = lowest_ == 0 ? 1 : 0, k2 = lowest_ == 2 ? 1 : 2;
  const double l = length[lowest_], e1 = excess_[k1], e2 = excess_[k2];
  const double a1 = ratio_[k1] * length[k1], a2 = ratio_[k2] * length[k2];

  // With the camera on the glass and nothing of the lowest index between, the left side has a
  // limit.
  if (l <= 0.0 && !(r < Limit(a1, e1) + Limit(a2, e2))) return Projection::kTotalInternalReflection;
  const double paraxial = r / (l + a1 + a2);  // below the root: the left side is concave

  // Start: the straight ray to the paraxial image of the lens in water; exact on the axis and far
  // away.
  const double apparent = water + thickness_ * depth_ratio_[1] + distance_ * depth_ratio_[0];
  const double invariant_ratio = index_[2] / index_[lowest_];
  const double radicand = apparent * apparent + r * r * (1.0 - invariant_ratio * invariant_ratio);
  double u = radicand > 1e-4 * r * r ? invariant_ratio * r / std::sqrt(radicand) : paraxial;

  int steps = 0;
  for (; steps < kMaxSteps; ++steps) {
    const double uu = u * u;
    const double q1 = 1.0 / (1.0 + e1 * uu), q2 = 1.0 / (1.0 + e2 * uu);
    const double w1 = a1 * std::sqrt(q1), w2 = a2 * std::sqrt(q2);
    const double residual = u * (l + w1 + w2) - r;
    const double d1 = w1 * q1, d2 = w2 * q2;
    const double slope = l + d1 + d2;
    double next = -1.0;
    if (steps < kHalleySteps) {
      const double half_curvature = -1.5 * u * (e1 * d1 * q1 + e2 * d2 * q2);
      const double denominator = slope * slope - residual * half_curvature;
      if (denominator > 0.0) next = u - residual * slope / denominator;
    }
    if (!(next >= paraxial))
      next = std::max(u - residual / slope, paraxial);  // Newton; too far from above at worst
    const double change = std::abs(next - u);
    u = next;
    // Both methods' next step would be below rounding: Halley's is of the order of the cube.
    if (change <= (steps < kHalleySteps ? 1e-6 : 1e-9) * u) {
      ++steps;
      break;
    }
  }

  const double invariant = index_[lowest_] * u / std::sqrt(1.0 + u * u);
  path->r = r;
  path->z = z;
  path->radial = offset;
  path->steps = steps;
  path->sine = invariant / index_[0];
  path->cosine = lowest_ == 0 ? 1.0 / std::sqrt(1.0 + u * u)
                              : std::sqrt((1.0 - path->sine) * (1.0 + path->sine));
  path->tangent[lowest_] = u;
  path->tangent[k1] = ratio_[k1] * u / std::sqrt(1.0 + e1 * u * u);
  path->tangent[k2] = ratio_[k2] * u / std::sqrt(1.0 + e2 * u * u);
  path->sine_over_r = r > 0.0 ? path->sine / r : index_[lowest_] / (index_[0] * (l + a1 + a2));
  if (!std::isfinite(path->sine_over_r)) path->sine_over_r = 0.0;
  return Projection::kOk;
}

Vec3 FlatPort::Direction(const Path& path) const noexcept {
  return path.cosine * normal_ + path.sine_over_r * path.radial;
}

Projection FlatPort::RefractToAir(const Vec3& point, Vec3* direction) const noexcept {
  Path path;
  if (const Projection status = Solve(point, &path); status != Projection::kOk) return status;
  *direction = Direction(path);
  return Projection::kOk;
}

namespace {

// Unit vector along `offset`, perpendicular to the axis to the last digit however short the offset;
// any perpendicular for none.
Vec3 RadialUnit(const Vec3& offset, double r, const Vec3& axis) {
  if (!(r > 0.0)) return axis.unitOrthogonal();
  Vec3 radial = offset / r;
  radial -= axis.dot(radial) * axis;
  const double norm = radial.norm();
  return norm > 0.5 ? Vec3(radial / norm) : Vec3(axis.unitOrthogonal());
}

// 1 / (index cos^3), the derivative of length tan(theta) to the invariant, for one medium.
double InvariantSlope(double index, double tangent) {
  const double secant_squared = 1.0 + tangent * tangent;
  return secant_squared * std::sqrt(secant_squared) / index;
}

}  // namespace

Projection FlatPort::RefractToAir(const Vec3& point, Vec3* direction,
                                  Mat3* d_direction_d_point) const noexcept {
  Path path;
  if (const Projection status = Solve(point, &path); status != Projection::kOk) return status;
  *direction = Direction(path);
  *d_direction_d_point = PointJacobian(path);
  return Projection::kOk;
}

// With F(s; r, z) = sum_k l_k tan(theta_k(s)) - r = 0:  ds/dr = 1 / F_s,  ds/dz = -tan(theta_water)
// / F_s, and d theta_air = ds / (index_air cos(theta_air)). Across the plane the direction turns
// about the axis by dx / r.
Mat3 FlatPort::PointJacobian(const Path& path) const noexcept {
  const double slope =
      distance_ * InvariantSlope(index_[0], path.tangent[0]) +
      thickness_ * InvariantSlope(index_[1], path.tangent[1]) +
      (path.z - distance_ - thickness_) * InvariantSlope(index_[2], path.tangent[2]);
  const double gain = 1.0 / (index_[0] * path.cosine * slope);  // d theta_air / d r
  const Vec3 radial = RadialUnit(path.radial, path.r, normal_);
  const Vec3 turn = path.cosine * radial - path.sine * normal_;  // d direction / d theta_air
  const Vec3 binormal = normal_.cross(radial);
  return (gain * turn) * (radial - path.tangent[2] * normal_).transpose() +
         (path.sine_over_r * binormal) * binormal.transpose();
}

Projection FlatPort::RefractToAir(const Vec3& point, Vec3* direction,
                                  AirJacobian* jacobian) const noexcept {
  Path path;
  if (const Projection status = Solve(point, &path); status != Projection::kOk) return status;
  const Vec3 air = Direction(path);
  const Mat3 d_point = PointJacobian(path);
  const double length[3] = {distance_, thickness_, path.z - distance_ - thickness_};
  double slopes[3], slope = 0.0;
  for (int k = 0; k < 3; ++k) {
    slopes[k] = length[k] * InvariantSlope(index_[k], path.tangent[k]);
    slope += slopes[k];
  }
  const double gain = 1.0 / (index_[0] * path.cosine * slope);
  const Vec3 turn = path.cosine * RadialUnit(path.radial, path.r, normal_) - path.sine * normal_;

  jacobian->d_direction_d_point = d_point;
  auto& d_port = jacobian->d_direction_d_port;
  // Turning port and point together turns the direction: a(Qn, QP) = Q a(n, P). So with dn = omega
  // x n, da = omega x a - (da/dP) (omega x P), and omega = n x dn.
  const Mat3 turn_of_air = normal_.dot(air) * Mat3::Identity() - normal_ * air.transpose();
  const Mat3 turn_of_point = path.z * Mat3::Identity() - normal_ * point.transpose();
  d_port.leftCols<3>() =
      (turn_of_air - d_point * turn_of_point) * (Mat3::Identity() - normal_ * normal_.transpose());
  // The water layer gives up what distance and thickness take.
  d_port.col(3) = (gain * (path.tangent[2] - path.tangent[0])) * turn;
  d_port.col(4) = (gain * (path.tangent[2] - path.tangent[1])) * turn;
  // dF/d index_k = -l_k s / (index_k^2 cos^3): at fixed s, a denser medium bends less.
  const double invariant = index_[0] * path.sine;
  for (int k = 0; k < 3; ++k) d_port.col(5 + k) = (gain * slopes[k] * invariant / index_[k]) * turn;
  d_port.col(5) -= (path.tangent[0] / index_[0]) * turn;  // sin(theta_air) = s / index_air
  *direction = air;
  return Projection::kOk;
}

Projection FlatPort::RefractToWater(const Vec3& direction, Ray3* ray) const noexcept {
  const double cosine = normal_.dot(direction);
  if (!(cosine > 0.0))
    return std::isfinite(cosine) ? Projection::kBehindPort : Projection::kNotFinite;
  const Vec3 tangential = direction - cosine * normal_;
  const double sine_squared = tangential.squaredNorm();
  const double to_glass = index_[0] / index_[1], to_water = index_[0] / index_[2];
  const double glass = 1.0 - to_glass * to_glass * sine_squared,
               water = 1.0 - to_water * to_water * sine_squared;
  if (!(glass > 0.0) || !(water > 0.0)) {
    return std::isfinite(sine_squared) ? Projection::kTotalInternalReflection
                                       : Projection::kNotFinite;
  }
  ray->origin = (distance_ / cosine + thickness_ * to_glass / std::sqrt(glass)) * tangential +
                (distance_ + thickness_) * normal_;
  ray->direction = to_water * tangential + std::sqrt(water) * normal_;
  return Projection::kOk;
}

bool FlatPort::RefractToAir(PortBlock* block) const noexcept {
  if (lowest_ != 0) return false;
  const FlatBlockParams params = {.normal = {normal_.x(), normal_.y(), normal_.z()},
                                  .distance = distance_,
                                  .thickness = thickness_,
                                  .invariant_ratio = index_[2] / index_[0],
                                  .apparent_air = depth_ratio_[0],
                                  .apparent_glass = depth_ratio_[1],
                                  .ratio_glass = ratio_[1],
                                  .ratio_water = ratio_[2],
                                  .excess_glass = excess_[1],
                                  .excess_water = excess_[2]};
  SolveFlatBlock(params, block);
  return true;
}

int FlatPort::CountSteps(const Vec3& point) const noexcept {
  Path path;
  return Solve(point, &path) == Projection::kOk ? path.steps : 0;
}

}  // namespace rsfm
