#include "rsfm/refraction/dome_port.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "rsfm/refraction/dome_path.h"

namespace rsfm {

DomePort::DomePort(const PortConfig& config) noexcept
    : center_(config.center_m),
      inner_(config.radius_m),
      outer_(config.radius_m + config.thickness_m),
      index_{config.index_air, config.index_glass, config.index_water},
      air_to_glass_(config.index_air / config.index_glass),
      air_to_water_(config.index_air / config.index_water),
      inner_squared_(inner_ * inner_),
      outer_squared_(outer_ * outer_),
      per_inner_squared_(1.0 / inner_squared_),
      per_outer_squared_(1.0 / outer_squared_),
      center_squared_(center_.squaredNorm()),
      paraxial_bend_((air_to_glass_ - 1.0) / inner_ + (air_to_water_ - air_to_glass_) / outer_) {}

Vec3 DomePort::Axis() const noexcept {
  const double norm = center_.norm();
  return norm > 0.0 ? Vec3(center_ / norm) : Vec3(Vec3::UnitZ());
}

// False on total internal reflection.
bool DomePort::Evaluate(const Plane& plane, double cosine, double sine, Path* path) const noexcept {
  const double b = plane.camera_u * sine - plane.camera_v * cosine;    // camera x direction
  const double d_b = plane.camera_u * cosine + plane.camera_v * sine;  // d b / d beta; d^2 b = -b
  const double b_glass = air_to_glass_ * b, b_water = air_to_water_ * b;
  const double bb = b * b, bb_glass = b_glass * b_glass, bb_water = b_water * b_water;
  const double s_air = inner_squared_ - bb, s_in = inner_squared_ - bb_glass;
  const double s_out = outer_squared_ - bb_glass, s_water = outer_squared_ - bb_water;
  if (!(s_air > 0.0) || !(s_in > 0.0) || !(s_out > 0.0) || !(s_water > 0.0)) return false;
  const double h_air = std::sqrt(s_air), h_in = std::sqrt(s_in), h_out = std::sqrt(s_out),
               h_water = std::sqrt(s_water);
  const double i_air = 1.0 / h_air, i_in = 1.0 / h_in, i_out = 1.0 / h_out, i_water = 1.0 / h_water;

  // The turns as complex numbers times rho^2: (h_out_of + i b_out_of) (h_into - i b_into).
  const double inner_re = (h_in * h_air + b_glass * b), inner_im = (b_glass * h_air - h_in * b);
  const double outer_re = (h_water * h_out + b_water * b_glass),
               outer_im = (b_water * h_out - h_water * b_glass);
  const double scale = 1.0 / (inner_squared_ * outer_squared_);
  const double turn_re = scale * (inner_re * outer_re - inner_im * outer_im);
  const double turn_im = scale * (inner_re * outer_im + inner_im * outer_re);
  const double turned_cosine = cosine * turn_re - sine * turn_im;
  const double turned_sine = sine * turn_re + cosine * turn_im;

  const double g = air_to_glass_, w = air_to_water_;
  const double bend = g * i_in - i_air + w * i_water - g * i_out;
  const double bend_slope = g * g * b_glass * i_in * i_in * i_in - b * i_air * i_air * i_air +
                            w * w * b_water * i_water * i_water * i_water -
                            g * g * b_glass * i_out * i_out * i_out;
  const double first = 1.0 + d_b * bend;  // d (beta + turns) / d beta
  const double second = -b * bend + d_b * d_b * bend_slope;
  const double inverse_range = 1.0 / plane.range;

  path->cosine = cosine;
  path->sine = sine;
  path->b_air = b;
  path->b_glass = b_glass;
  path->b_water = b_water;
  path->i_air = i_air;
  path->i_glass_in = i_in;
  path->i_glass_out = i_out;
  path->i_water = i_water;
  path->turned_cosine = turned_cosine;
  path->turned_sine = turned_sine;
  path->bend = bend;
  path->residual = turned_sine - b_water * inverse_range;
  path->slope = turned_cosine * first - w * d_b * inverse_range;
  path->curvature = -turned_sine * first * first + turned_cosine * second + b_water * inverse_range;
  return true;
}

namespace {
// Radians, after which the next step, of the order of the cube, is below rounding.
constexpr double kSettled = 5e-6;
constexpr double kMaxParaxialSine = 0.8;
}  // namespace

Projection DomePort::Solve(const Vec3& point, Plane* plane, Path* path) const noexcept {
  if (!IsUsable(point)) return Projection::kNotFinite;
  const Vec3 from_center = point - center_;
  const double range = from_center.norm();
  if (!(range > outer_)) return range > inner_ ? Projection::kInsideGlass : Projection::kBehindPort;
  plane->range = range;
  plane->u = from_center / range;
  plane->camera_u = -center_.dot(plane->u);
  plane->camera_across = -center_ - plane->camera_u * plane->u;
  plane->camera_v = plane->camera_across.norm();

  // Start: the paraxial path, exact where point, camera and centre are in line; where that is no
  // direction at all, the straight line from the camera to the point.
  const double k = range * paraxial_bend_ - air_to_water_;
  double sine = plane->camera_v * k / (range + plane->camera_u * k), cosine;
  if (std::abs(sine) < kMaxParaxialSine) {
    cosine = std::sqrt(1.0 - sine * sine);
  } else {
    cosine = range - plane->camera_u;
    sine = -plane->camera_v;
    const double norm = 1.0 / std::sqrt(cosine * cosine + sine * sine);
    cosine *= norm;
    sine *= norm;
  }
  bool converged = false;
  for (plane->steps = 1; plane->steps <= kMaxFastSteps; ++plane->steps) {
    if (!Evaluate(*plane, cosine, sine, path)) break;
    const double denominator = path->slope * path->slope - 0.5 * path->residual * path->curvature;
    const double step = -path->residual * path->slope / denominator;
    if (!(path->slope > 0.0) || !(denominator > 0.0) || !(std::abs(step) < 1.0)) break;
    // Turn by the step: exact to its third order, like Halley's method itself.
    const double quarter = 0.25 * step * step, unit = 1.0 / (1.0 + quarter);
    const double turn_cosine = (1.0 - quarter) * unit, turn_sine = step * unit;
    const double old_cosine = cosine;
    cosine = cosine * turn_cosine - sine * turn_sine;
    sine = sine * turn_cosine + old_cosine * turn_sine;
    if (std::abs(step) <= kSettled) {  // the next one is of the order of the cube
      converged = true;
      break;
    }
  }
  if (converged) {
    // The last step changed the angle by kSettled at most: the terms that derivatives need follow
    // to first order in it, but are wanted in full, so they are taken where the light really goes
    // only when asked for (MakeFrame).
    path->cosine = cosine;
    path->sine = sine;
    return path->turned_cosine > 0.0
               ? Projection::kOk
               : (SolveBracketed(plane, path) ? Projection::kOk
                                              : Projection::kTotalInternalReflection);
  }
  return SolveBracketed(plane, path) ? Projection::kOk : Projection::kTotalInternalReflection;
}

// The polar angle at which the path leaves a sphere of the point's radius grows with the angle
// alpha at the camera between the ray and the camera's own radius, from 0 to pi, whenever air is
// the thinnest medium: bisected there.
bool DomePort::SolveBracketed(Plane* plane, Path* path) const noexcept {
  const double eccentricity = std::hypot(plane->camera_u, plane->camera_v);
  const double target = std::atan2(
      plane->camera_v, plane->camera_u);  // angle between camera's radius and the point's
  const auto swept = [&](double alpha, double* angle) {
    const double b = eccentricity * std::sin(alpha);
    const double b_glass = air_to_glass_ * b, b_water = air_to_water_ * b;
    if (std::abs(b_glass) >= inner_ || std::abs(b_water) >= outer_) return false;
    *angle = alpha - std::asin(b / inner_) + std::asin(b_glass / inner_) -
             std::asin(b_glass / outer_) + std::asin(b_water / outer_) -
             std::asin(b_water / plane->range);
    return true;
  };
  double low = 0.0, high = std::numbers::pi, angle = 0.0;
  if (eccentricity == 0.0) high = 0.0;
  for (int step = 0; step < kMaxBracketSteps; ++step, ++plane->steps) {
    const double middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) break;
    // Where no light passes, the path at the target lies on the side of the nearer end.
    const bool passes = swept(middle, &angle);
    if (passes ? angle < target : target > 0.5 * std::numbers::pi) {
      low = middle;
    } else {
      high = middle;
    }
  }
  // The camera's radius stands at +target from u, so the direction at alpha from it stands at
  // target - alpha.
  const double beta = target - 0.5 * (low + high);
  if (!Evaluate(*plane, std::cos(beta), std::sin(beta), path)) return false;
  return path->turned_cosine > 0.0 && std::abs(path->residual) < 1e-9;
}

Vec3 DomePort::Direction(const Plane& plane, const Path& path) noexcept {
  const double across = plane.camera_v > 0.0 ? path.sine / plane.camera_v : 0.0;
  return path.cosine * plane.u + across * plane.camera_across;
}

Projection DomePort::RefractToAir(const Vec3& point, Vec3* direction) const noexcept {
  Plane plane;
  Path path;
  if (const Projection status = Solve(point, &plane, &path); status != Projection::kOk)
    return status;
  *direction = Direction(plane, path);
  return Projection::kOk;
}

// In the basis of the direction v and the camera's place e as seen from the centre, every crossing
// point and direction is a sum of two: with b the distance of a stretch's line from the centre, h =
// sqrt(rho^2 - b^2) on either side of each surface, and a surface's normal its crossing point over
// rho,
//   on the inner surface  e + lambda v,               lambda = h_air - e.v
//   in glass              p v + q e,                  q = (h_in - g h_air) / inner^2, p = g + q
//   lambda on the outer surface  gamma v + delta e,          (1, 0) times lambda plus mu = h_out -
//   h_in times (p, q) in water              alpha v + beta e
// which takes four square roots and no division.
Projection DomePort::TraceOut(const Vec3& direction, Trace* trace) const noexcept {
  const double a = -center_.dot(direction);
  const double bb = std::max(center_squared_ - a * a, 0.0);
  const double g = air_to_glass_, w = air_to_water_;
  const double s_air = inner_squared_ - bb, s_in = inner_squared_ - g * g * bb;
  const double s_out = outer_squared_ - g * g * bb, s_water = outer_squared_ - w * w * bb;
  if (!(s_air > 0.0))
    return std::isfinite(s_air) ? Projection::kOutsideDome : Projection::kNotFinite;
  if (!(s_in > 0.0) || !(s_out > 0.0) || !(s_water > 0.0))
    return std::isfinite(s_air) ? Projection::kTotalInternalReflection : Projection::kNotFinite;
  const double h_air = std::sqrt(s_air), h_in = std::sqrt(s_in), h_out = std::sqrt(s_out),
               h_water = std::sqrt(s_water);
  trace->a = a;
  trace->h_air = h_air;
  trace->h_in = h_in;
  trace->h_out = h_out;
  trace->h_water = h_water;
  trace->lambda = h_air - a;
  trace->mu = h_out - h_in;
  trace->q = (h_in - g * h_air) * per_inner_squared_;
  trace->p = g + trace->q * trace->lambda;
  trace->gamma = trace->lambda + trace->mu * trace->p;
  trace->delta = 1.0 + trace->mu * trace->q;
  const double from_glass = index_[1] / index_[2];
  trace->k = (h_water - from_glass * h_out) * per_outer_squared_;
  trace->alpha = from_glass * trace->p + trace->k * trace->gamma;
  trace->beta = from_glass * trace->q + trace->k * trace->delta;
  return Projection::kOk;
}

Projection DomePort::RefractToWater(const Vec3& direction, Ray3* ray) const noexcept {
  Trace trace;
  if (const Projection status = TraceOut(direction, &trace); status != Projection::kOk)
    return status;
  ray->origin = trace.gamma * direction + (1.0 - trace.delta) * center_;
  ray->direction = trace.alpha * direction - trace.beta * center_;
  return Projection::kOk;
}

// The axis is spanned by e: it is met where the parts along v cancel.
double DomePort::RangeToAxis(const Vec3& direction, const Ray3&) const noexcept {
  Trace trace;
  if (TraceOut(direction, &trace) != Projection::kOk)
    return std::numeric_limits<double>::infinity();
  return -trace.gamma / trace.alpha;
}

bool DomePort::RefractToAir(PortBlock* block) const noexcept {
  SolveDomeBlock(BlockParams(), block);
  return true;
}

bool DomePort::RefractToWater(RayBlock* block) const noexcept {
  TraceDomeBlock(BlockParams(), block);
  return true;
}

DomeBlockParams DomePort::BlockParams() const noexcept {
  return {.center = {center_.x(), center_.y(), center_.z()},
          .inner = inner_,
          .outer = outer_,
          .air_to_glass = air_to_glass_,
          .air_to_water = air_to_water_};
}

int DomePort::CountSteps(const Vec3& point) const noexcept {
  Plane plane;
  Path path;
  return Solve(point, &plane, &path) == Projection::kOk ? plane.steps : 0;
}

}  // namespace rsfm
