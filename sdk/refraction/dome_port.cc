#include "rsfm/refraction/dome_port.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "rsfm/refraction/snell.h"

namespace rsfm {

// u points from the dome's centre to the point; the camera lies at (camera_u, camera_v) along u and
// its perpendicular v.
struct DomePort::Plane {
  Vec3 u;
  Vec3 camera_across;  // the camera's position across u: camera_v * v
  double range;        // of the point from the centre
  double camera_u, camera_v;
  int steps;
};

struct DomePort::Path {
  double cosine, sine;             // of beta, the direction in air against u
  double b_air, b_glass, b_water;  // signed distances of the three stretches from the centre
  double i_air, i_glass_in, i_glass_out, i_water;  // 1 / sqrt(rho^2 - b^2) at the two surfaces
  double turned_cosine, turned_sine;               // of the direction in water against u
  double bend;                                     // d turns / d b_air
  double residual, slope, curvature;
};

DomePort::DomePort(const PortConfig& config) noexcept
    : center_(config.center_m),
      inner_(config.radius_m),
      outer_(config.radius_m + config.thickness_m),
      index_{config.index_air, config.index_glass, config.index_water},
      air_to_glass_(config.index_air / config.index_glass),
      air_to_water_(config.index_air / config.index_water),
      inner_squared_(inner_ * inner_),
      outer_squared_(outer_ * outer_) {}

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

  // Start: the straight line from the camera to the point.
  double cosine = range - plane->camera_u, sine = -plane->camera_v;
  const double norm = 1.0 / std::sqrt(cosine * cosine + sine * sine);
  cosine *= norm;
  sine *= norm;
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
    if (std::abs(step) <= 2e-6) {  // the next one is of the order of the cube
      converged = true;
      break;
    }
  }
  if (converged) {
    // The last step changed the angle by 2e-6 at most: the terms that derivatives need follow to
    // first order in it, but are wanted in full, so they are taken where the light really goes only
    // when asked for (MakeFrame).
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

struct DomePort::Frame3 {
  Vec3 u, v, m;   // in-plane unit vectors and the plane's normal
  Vec3 turn;      // d direction / d beta
  double across;  // sine / camera_v, finite on the axis
  double d_beta_d_camera_u, d_beta_d_camera_v, d_beta_d_range;
};

DomePort::Frame3 DomePort::MakeFrame(const Plane& plane, const Path& path) const noexcept {
  Frame3 frame;
  frame.u = plane.u;
  // v perpendicular to u to the last digit, however short the vector it comes from.
  frame.v =
      plane.camera_v > 0.0 ? Vec3(plane.camera_across / plane.camera_v) : plane.u.unitOrthogonal();
  frame.v -= plane.u.dot(frame.v) * plane.u;
  const double norm = frame.v.norm();
  frame.v = norm > 0.5 ? Vec3(frame.v / norm) : plane.u.unitOrthogonal();
  if (plane.camera_v > 1e-8 * inner_) {
    frame.across = path.sine / plane.camera_v;
  } else {  // point, camera and centre in line: the paraxial limit, good to second order
    const double k = plane.range * path.bend - air_to_water_;
    frame.across = k / (plane.range + plane.camera_u * k);
  }
  frame.m = frame.u.cross(frame.v);
  frame.turn = -path.sine * frame.u + path.cosine * frame.v;
  const double per_b =
      path.turned_cosine * path.bend - air_to_water_ / plane.range;  // d residual / d b_air
  frame.d_beta_d_camera_u = -per_b * path.sine / path.slope;
  frame.d_beta_d_camera_v = per_b * path.cosine / path.slope;
  frame.d_beta_d_range = -path.b_water / (plane.range * plane.range * path.slope);
  return frame;
}

Projection DomePort::RefractToAir(const Vec3& point, Vec3* direction) const noexcept {
  Plane plane;
  Path path;
  if (const Projection status = Solve(point, &plane, &path); status != Projection::kOk)
    return status;
  const double across = plane.camera_v > 0.0 ? path.sine / plane.camera_v : 0.0;
  *direction = path.cosine * plane.u + across * plane.camera_across;
  return Projection::kOk;
}

Projection DomePort::RefractToAir(const Vec3& point, Vec3* direction,
                                  Mat3* d_direction_d_point) const noexcept {
  Plane plane;
  Path path;
  if (const Projection status = Solve(point, &plane, &path); status != Projection::kOk)
    return status;
  if (!Evaluate(plane, path.cosine, path.sine, &path)) return Projection::kTotalInternalReflection;
  const Frame3 frame = MakeFrame(plane, path);
  *direction = path.cosine * plane.u + frame.across * plane.camera_across;
  // Moving the point turns u in the plane by v.dP / R and the plane about its axis by m.dP / R.
  const double d_beta_d_turn =
      1.0 + frame.d_beta_d_camera_u * plane.camera_v - frame.d_beta_d_camera_v * plane.camera_u;
  const Vec3 along = frame.d_beta_d_range * frame.u + (d_beta_d_turn / plane.range) * frame.v;
  *d_direction_d_point =
      frame.turn * along.transpose() +
      ((path.cosine - frame.across * plane.camera_u) / plane.range * frame.m) * frame.m.transpose();
  return Projection::kOk;
}

Projection DomePort::RefractToAir(const Vec3& point, Vec3* direction,
                                  AirJacobian* jacobian) const noexcept {
  Plane plane;
  Path path;
  if (const Projection status = Solve(point, &plane, &path); status != Projection::kOk)
    return status;
  if (!Evaluate(plane, path.cosine, path.sine, &path)) return Projection::kTotalInternalReflection;
  const Frame3 frame = MakeFrame(plane, path);
  *direction = path.cosine * plane.u + frame.across * plane.camera_across;
  const double d_beta_d_turn =
      1.0 + frame.d_beta_d_camera_u * plane.camera_v - frame.d_beta_d_camera_v * plane.camera_u;
  const Vec3 along = frame.d_beta_d_range * frame.u + (d_beta_d_turn / plane.range) * frame.v;
  const Mat3 across = frame.m * frame.m.transpose();
  jacobian->d_direction_d_point =
      frame.turn * along.transpose() +
      (path.cosine - frame.across * plane.camera_u) / plane.range * across;

  auto& d_port = jacobian->d_direction_d_port;
  // Moving the centre moves point and camera the other way, as seen from it: the point's part is
  // -d_direction_d_point.
  const Vec3 of_camera = frame.d_beta_d_camera_u * frame.u + frame.d_beta_d_camera_v * frame.v;
  d_port.leftCols<3>() =
      -jacobian->d_direction_d_point - frame.turn * of_camera.transpose() - frame.across * across;

  // d residual / d parameter at fixed beta, then d beta = -that / slope. The turns' share comes
  // with cos of the turned angle.
  const double c = path.turned_cosine, g = air_to_glass_, w = air_to_water_, b = path.b_air;
  const double d_inner = (path.b_air * path.i_air - path.b_glass * path.i_glass_in) / inner_;
  const double d_outer = (path.b_glass * path.i_glass_out - path.b_water * path.i_water) / outer_;
  const double glass = path.i_glass_in - path.i_glass_out;
  const double d_air =
      c * (g * b * glass + w * b * path.i_water) / index_[0] - w * b / (index_[0] * plane.range);
  const double d_glass = -c * path.b_glass * glass / index_[1];
  const double d_water =
      -c * path.b_water * path.i_water / index_[2] + path.b_water / (index_[2] * plane.range);
  const Vec3 turn = frame.turn / -path.slope;
  d_port.col(3) = c * (d_inner + d_outer) * turn;
  d_port.col(4) = c * d_outer * turn;
  d_port.col(5) = d_air * turn;
  d_port.col(6) = d_glass * turn;
  d_port.col(7) = d_water * turn;
  return Projection::kOk;
}

Projection DomePort::RefractToWater(const Vec3& direction, Ray3* ray) const noexcept {
  // Camera at the origin, inside the inner sphere: the far intersection.
  const double along = -center_.dot(direction);
  const double inside = inner_squared_ - center_.squaredNorm();
  const double discriminant = along * along + inside;
  if (!(inside > 0.0) || !(discriminant > 0.0)) {
    return std::isfinite(discriminant) ? Projection::kOutsideDome : Projection::kNotFinite;
  }
  const Vec3 on_inner = (std::sqrt(discriminant) - along) * direction;  // in the camera frame
  const Vec3 inner_normal = (on_inner - center_) / inner_;
  Vec3 in_glass, in_water;
  if (!Refract(direction, inner_normal, air_to_glass_, &in_glass))
    return Projection::kTotalInternalReflection;
  const double along_glass = inner_ * inner_normal.dot(in_glass);
  const double path_in_glass =
      std::sqrt(along_glass * along_glass + outer_squared_ - inner_squared_) - along_glass;
  const Vec3 on_outer = on_inner + path_in_glass * in_glass;
  const Vec3 outer_normal = (on_outer - center_) / outer_;
  if (!Refract(in_glass, outer_normal, index_[1] / index_[2], &in_water))
    return Projection::kTotalInternalReflection;
  *ray = {on_outer, in_water};
  return Projection::kOk;
}

bool DomePort::RefractToAir(PortBlock* block) const noexcept {
  const DomeBlockParams params = {.center = {center_.x(), center_.y(), center_.z()},
                                  .inner = inner_,
                                  .outer = outer_,
                                  .air_to_glass = air_to_glass_,
                                  .air_to_water = air_to_water_};
  SolveDomeBlock(params, block);
  return true;
}

int DomePort::CountSteps(const Vec3& point) const noexcept {
  Plane plane;
  Path path;
  return Solve(point, &plane, &path) == Projection::kOk ? plane.steps : 0;
}

}  // namespace rsfm
