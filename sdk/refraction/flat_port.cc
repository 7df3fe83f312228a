#include "rsfm/refraction/flat_port.h"

#include <algorithm>
#include <cmath>

#include "rsfm/refraction/flat_path.h"

namespace rsfm {

FlatPort::FlatPort(const PortConfig& config) noexcept
    : normal_(config.normal.normalized()),
      num_media_(3 + static_cast<int>(config.outer_layers.size())),
      distance_(config.distance_m) {
  index_[0] = config.index_air;
  index_[1] = config.index_glass;
  length_[0] = config.distance_m;
  length_[1] = config.thickness_m;
  for (int k = 2; k < num_media_ - 1; ++k) {
    index_[k] = config.outer_layers[k - 2].index;
    length_[k] = config.outer_layers[k - 2].thickness_m;
  }
  index_[num_media_ - 1] = config.index_water;
  lowest_ = 0;
  for (int k = 1; k < num_media_; ++k) {
    if (index_[k] < index_[lowest_]) lowest_ = k;
  }
  end_ = 0.0;
  apparent_ = 0.0;
  for (int k = 0; k < num_media_; ++k) {
    ratio_[k] = index_[lowest_] / index_[k];
    excess_[k] = (1.0 - ratio_[k]) * (1.0 + ratio_[k]);
    if (k == num_media_ - 1) break;
    end_ += length_[k];
    apparent_ += length_[k] * config.index_water / index_[k];
  }
}

namespace {

constexpr int kHalleySteps = 8;  // from there on Newton, which is monotone from below
// Relative changes after which the next step would be below rounding: Halley's is of the order of
// the cube, Newton's of the square.
constexpr double kHalleySettled = 5e-6, kNewtonSettled = 1e-9;

// Where a u / sqrt(1 + e u^2) tends to for large u.
double Limit(double a, double e) {
  return a > 0.0 ? a / std::sqrt(e) : 0.0;  // infinite for e = 0
}

// The straight ray from `apparent` up the axis to a point at distance r from it, as tan(theta) in
// the lowest medium: exact on the axis and far away. Where that medium has no such ray, `paraxial`.
double StartingTangent(double apparent, double r, double invariant_ratio, double paraxial) {
  const double radicand = apparent * apparent + r * r * (1.0 - invariant_ratio * invariant_ratio);
  return radicand > 1e-4 * r * r ? invariant_ratio * r / std::sqrt(radicand) : paraxial;
}

// One step from u, never below `paraxial`: Halley's first, then Newton's; true once it has settled.
bool Advance(int step, double paraxial, double residual, double slope, double half_curvature,
             double* u) {
  double next = -1.0;
  if (step < kHalleySteps) {
    const double denominator = slope * slope - residual * half_curvature;
    if (denominator > 0.0) next = *u - residual * slope / denominator;
  }
  if (!(next >= paraxial))
    next = std::max(*u - residual / slope, paraxial);  // Newton; too far from above at worst
  const double change = std::abs(next - *u);
  *u = next;
  return change <= (step < kHalleySteps ? kHalleySettled : kNewtonSettled) * next;
}

}  // namespace

// The path equation is u (l + sum_k a_k w_k) = r, w_k = 1 / sqrt(1 + e_k u^2), over the media other
// than the lowest. With the camera on the glass and nothing of the lowest index between, the left
// side has a limit.
bool FlatPort::SolveThreeMedia(double r, double water, Path* path) const noexcept {
  const double length[3] = {length_[0], length_[1], water};
  const int k1 = lowest_ == 0 ? 1 : 0, k2 = lowest_ == 2 ? 1 : 2;
  const double l = length[lowest_], e1 = excess_[k1], e2 = excess_[k2];
  const double a1 = ratio_[k1] * length[k1], a2 = ratio_[k2] * length[k2];
  if (l <= 0.0 && !(r < Limit(a1, e1) + Limit(a2, e2))) return false;
  const double paraxial = r / (l + a1 + a2);  // below the root: the left side is concave
  double u = StartingTangent(water + apparent_, r, index_[2] / index_[lowest_], paraxial);
  int steps = 0;
  while (steps < kMaxSteps) {
    const double uu = u * u;
    const double q1 = 1.0 / (1.0 + e1 * uu), q2 = 1.0 / (1.0 + e2 * uu);
    const double w1 = a1 * std::sqrt(q1), w2 = a2 * std::sqrt(q2);
    const double d1 = w1 * q1, d2 = w2 * q2;
    if (Advance(steps++, paraxial, u * (l + w1 + w2) - r, l + d1 + d2,
                -1.5 * u * (e1 * d1 * q1 + e2 * d2 * q2), &u)) {
      break;
    }
  }
  path->u = u;
  path->per_r = 1.0 / (l + a1 + a2);
  path->steps = steps;
  return true;
}

bool FlatPort::SolveMoreMedia(double r, double water, Path* path) const noexcept {
  double a[kMaxMedia], sum = 0.0, limit = 0.0;
  for (int k = 0; k < num_media_; ++k) {
    a[k] = ratio_[k] * (k == num_media_ - 1 ? water : length_[k]);
    sum += a[k];
    limit += Limit(a[k], excess_[k]);
  }
  if (!(r < limit)) return false;
  const double paraxial = r / sum;
  double u =
      StartingTangent(water + apparent_, r, index_[num_media_ - 1] / index_[lowest_], paraxial);
  int steps = 0;
  while (steps < kMaxSteps) {
    double value = 0.0, slope = 0.0, curvature = 0.0;
    for (int k = 0; k < num_media_; ++k) {
      const double q = 1.0 / (1.0 + excess_[k] * u * u);
      const double w = a[k] * std::sqrt(q), d = w * q;
      value += w;
      slope += d;
      curvature += excess_[k] * d * q;
    }
    if (Advance(steps++, paraxial, u * value - r, slope, -1.5 * u * curvature, &u)) break;
  }
  path->u = u;
  path->per_r = 1.0 / sum;
  path->steps = steps;
  return true;
}

Projection FlatPort::Solve(const Vec3& point, Path* path) const noexcept {
  if (!IsUsable(point)) return Projection::kNotFinite;
  const double z = normal_.dot(point);
  const double water = z - end_;
  if (!(water > 0.0)) {
    return z - distance_ > 0.0 ? Projection::kInsideGlass : Projection::kBehindPort;
  }
  const Vec3 offset = point - z * normal_;
  const double r = offset.norm();
  if (num_media_ == 3 ? !SolveThreeMedia(r, water, path) : !SolveMoreMedia(r, water, path))
    return Projection::kTotalInternalReflection;
  const double u = path->u, cosine = 1.0 / std::sqrt(1.0 + u * u);
  path->r = r;
  path->z = z;
  path->radial = offset;
  path->sine = index_[lowest_] / index_[0] * u * cosine;
  path->cosine = lowest_ == 0 ? cosine : std::sqrt((1.0 - path->sine) * (1.0 + path->sine));
  path->sine_over_r = r > 0.0 ? path->sine / r : index_[lowest_] / index_[0] * path->per_r;
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

Projection FlatPort::RefractToWater(const Vec3& direction, Ray3* ray) const noexcept {
  const double cosine = normal_.dot(direction);
  if (!(cosine > 0.0))
    return std::isfinite(cosine) ? Projection::kBehindPort : Projection::kNotFinite;
  const Vec3 tangential = direction - cosine * normal_;
  const double sine_squared = tangential.squaredNorm();
  double across;  // how far from the axis the path goes, over the sine in air
  const int last = num_media_ - 1;
  const double to_water = index_[0] / index_[last];
  const double water = 1.0 - to_water * to_water * sine_squared;
  double least = water;
  if (num_media_ == 3) {
    const double to_glass = index_[0] / index_[1];
    const double glass = 1.0 - to_glass * to_glass * sine_squared;
    const double root = std::sqrt(glass);
    across = (distance_ * root + length_[1] * to_glass * cosine) / (cosine * root);
    least = std::min(glass, water);
  } else {
    across = distance_ / cosine;
    for (int k = 1; k < last; ++k) {
      const double ratio = index_[0] / index_[k];
      const double square = 1.0 - ratio * ratio * sine_squared;
      least = std::min(least, square);
      across += length_[k] * ratio / std::sqrt(square);
    }
  }
  if (!(least > 0.0)) {
    return std::isfinite(sine_squared) ? Projection::kTotalInternalReflection
                                       : Projection::kNotFinite;
  }
  ray->origin = across * tangential + end_ * normal_;
  ray->direction = to_water * tangential + std::sqrt(water) * normal_;
  return Projection::kOk;
}

// With t the part of the direction in air across the axis, origin = A t + end n and direction =
// (index_air / index_water) t + c n: the axis is met where their parts along t cancel.
double FlatPort::RangeToAxis(const Vec3& direction, const Ray3&) const noexcept {
  const double cosine = normal_.dot(direction), sine_squared = (1.0 - cosine) * (1.0 + cosine);
  double across = distance_ / cosine;
  for (int k = 1; k < num_media_ - 1; ++k) {
    const double ratio = index_[0] / index_[k];
    across += length_[k] * ratio / std::sqrt(1.0 - ratio * ratio * sine_squared);
  }
  return -across * index_[num_media_ - 1] / index_[0];
}

bool FlatPort::RefractToAir(PortBlock* block) const noexcept {
  if (lowest_ != 0 || num_media_ != 3) return false;
  const FlatBlockParams params = {.normal = {normal_.x(), normal_.y(), normal_.z()},
                                  .distance = distance_,
                                  .thickness = length_[1],
                                  .invariant_ratio = index_[2] / index_[0],
                                  .apparent_air = index_[2] / index_[0],
                                  .apparent_glass = index_[2] / index_[1],
                                  .ratio_glass = ratio_[1],
                                  .ratio_water = ratio_[2],
                                  .excess_glass = excess_[1],
                                  .excess_water = excess_[2]};
  SolveFlatBlock(params, block);
  return true;
}

bool FlatPort::RefractToWater(RayBlock* block) const noexcept {
  if (num_media_ != 3) return false;
  const FlatRayParams params = {.normal = {normal_.x(), normal_.y(), normal_.z()},
                                .distance = distance_,
                                .thickness = length_[1],
                                .to_glass = index_[0] / index_[1],
                                .to_water = index_[0] / index_[2]};
  TraceFlatBlock(params, block);
  return true;
}

int FlatPort::CountSteps(const Vec3& point) const noexcept {
  Path path;
  return Solve(point, &path) == Projection::kOk ? path.steps : 0;
}

}  // namespace rsfm
