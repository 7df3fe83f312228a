// Derivatives of the dome's two directions.
#include <algorithm>
#include <cmath>

#include "rsfm/refraction/dome_path.h"

namespace rsfm {

struct DomePort::Frame3 {
  Vec3 u, v, m;   // in-plane unit vectors and the plane's normal
  Vec3 turn;      // d direction / d beta
  double across;  // sine / camera_v, finite on the axis
  double d_beta_d_camera_u, d_beta_d_camera_v, d_beta_d_range;

  // What both derivatives begin with: the solved path, its frame, the direction and its derivative
  // with respect to the point. On failure direction and derivative are untouched.
  static Projection Refract(const DomePort& port, const Vec3& point, Plane* plane, Path* path,
                            Frame3* frame, Vec3* direction, Mat3* d_direction_d_point);
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

Projection DomePort::Frame3::Refract(const DomePort& port, const Vec3& point, Plane* plane,
                                     Path* path, Frame3* frame, Vec3* direction,
                                     Mat3* d_direction_d_point) {
  if (const Projection status = port.Solve(point, plane, path); status != Projection::kOk)
    return status;
  if (!port.Evaluate(*plane, path->cosine, path->sine, path))
    return Projection::kTotalInternalReflection;
  *frame = port.MakeFrame(*plane, *path);
  *direction = Direction(*plane, *path);
  // Moving the point turns u in the plane by v.dP / R and the plane about its axis by m.dP / R.
  const double d_beta_d_turn =
      1.0 + frame->d_beta_d_camera_u * plane->camera_v - frame->d_beta_d_camera_v * plane->camera_u;
  const Vec3 along = frame->d_beta_d_range * frame->u + (d_beta_d_turn / plane->range) * frame->v;
  *d_direction_d_point =
      frame->turn * along.transpose() +
      ((path->cosine - frame->across * plane->camera_u) / plane->range * frame->m) *
          frame->m.transpose();
  return Projection::kOk;
}

Projection DomePort::RefractToAir(const Vec3& point, Vec3* direction,
                                  Mat3* d_direction_d_point) const noexcept {
  Plane plane;
  Path path;
  Frame3 frame;
  return Frame3::Refract(*this, point, &plane, &path, &frame, direction, d_direction_d_point);
}

Projection DomePort::RefractToAir(const Vec3& point, Vec3* direction,
                                  AirJacobian* jacobian) const noexcept {
  Plane plane;
  Path path;
  Frame3 frame;
  const Projection status = Frame3::Refract(*this, point, &plane, &path, &frame, direction,
                                            &jacobian->d_direction_d_point);
  if (status != Projection::kOk) return status;

  auto& d_port = jacobian->d_direction_d_port;
  // Moving the centre moves point and camera the other way, as seen from it: the point's part is
  // -d_direction_d_point.
  const Vec3 of_camera = frame.d_beta_d_camera_u * frame.u + frame.d_beta_d_camera_v * frame.v;
  d_port.leftCols<3>() = -jacobian->d_direction_d_point - frame.turn * of_camera.transpose() -
                         frame.across * frame.m * frame.m.transpose();

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

// The scalars of TraceOut differentiated to a = e.v, |e|^2, the two radii, g = index_air /
// index_glass and w = index_air / index_water, one column each.
struct DomePort::TraceSlopes {
  static constexpr int kA = 0, kE = 1, kInner = 2, kOuter = 3, kGlass = 4, kWater = 5;
  using Row = Eigen::Matrix<double, 1, 6>;
  Row gamma, delta, alpha, beta;
};

DomePort::TraceSlopes DomePort::MakeSlopes(const Trace& trace) const noexcept {
  using Row = TraceSlopes::Row;
  const double g = air_to_glass_, w = air_to_water_;
  const double bb = std::max(center_squared_ - trace.a * trace.a, 0.0);
  const Row d_a = Row::Unit(TraceSlopes::kA), d_inner = Row::Unit(TraceSlopes::kInner),
            d_outer = Row::Unit(TraceSlopes::kOuter), d_g = Row::Unit(TraceSlopes::kGlass),
            d_w = Row::Unit(TraceSlopes::kWater);
  const Row d_bb = Row::Unit(TraceSlopes::kE) - 2.0 * trace.a * d_a;
  // h = sqrt(rho^2 - (m b)^2)
  const auto root = [&](double h, double radius, const Row& d_radius, double m, const Row& d_m) {
    return Row((radius * d_radius - m * bb * d_m - (0.5 * m * m) * d_bb) / h);
  };
  const Row d_air = root(trace.h_air, inner_, d_inner, 1.0, Row::Zero());
  const Row d_in = root(trace.h_in, inner_, d_inner, g, d_g);
  const Row d_out = root(trace.h_out, outer_, d_outer, g, d_g);
  const Row d_water = root(trace.h_water, outer_, d_outer, w, d_w);
  const Row d_lambda = d_air - d_a, d_mu = d_out - d_in;
  const Row d_q = (d_in - g * d_air - trace.h_air * d_g) * per_inner_squared_ -
                  (2.0 * trace.q / inner_) * d_inner;
  const Row d_p = d_g + trace.lambda * d_q + trace.q * d_lambda;
  const double f = w / g;
  const Row d_f = (d_w - f * d_g) / g;
  const Row d_k = (d_water - f * d_out - trace.h_out * d_f) * per_outer_squared_ -
                  (2.0 * trace.k / outer_) * d_outer;
  TraceSlopes slopes;
  slopes.gamma = d_lambda + trace.mu * d_p + trace.p * d_mu;
  slopes.delta = trace.mu * d_q + trace.q * d_mu;
  slopes.alpha = f * d_p + trace.p * d_f + trace.k * slopes.gamma + trace.gamma * d_k;
  slopes.beta = f * d_q + trace.q * d_f + trace.k * slopes.delta + trace.delta * d_k;
  return slopes;
}

Projection DomePort::RefractToWater(const Vec3& direction, Ray3* ray,
                                    WaterJacobian* jacobian) const noexcept {
  Trace trace;
  if (const Projection status = TraceOut(direction, &trace); status != Projection::kOk)
    return status;
  const TraceSlopes slopes = MakeSlopes(trace);
  using Slopes = TraceSlopes;
  const Vec3 c = center_;
  // x(v, c, scalars) = m v + n c; a = -c.v, |e|^2 = c.c.
  const auto chain = [&](double m, double n, const Slopes::Row& d_m, const Slopes::Row& d_n,
                         Mat3* d_air, Eigen::Matrix<double, 3, kNumPortParams>* d_port) {
    const Eigen::Matrix<double, 3, 6> d_scalar = direction * d_m + c * d_n;
    *d_air = m * Mat3::Identity() - d_scalar.col(Slopes::kA) * c.transpose();
    d_port->leftCols<3>() = n * Mat3::Identity() -
                            d_scalar.col(Slopes::kA) * direction.transpose() +
                            2.0 * d_scalar.col(Slopes::kE) * c.transpose();
    d_port->col(3) = d_scalar.col(Slopes::kInner) + d_scalar.col(Slopes::kOuter);
    d_port->col(4) = d_scalar.col(Slopes::kOuter);
    d_port->col(5) =
        d_scalar.col(Slopes::kGlass) / index_[1] + d_scalar.col(Slopes::kWater) / index_[2];
    d_port->col(6) = (-air_to_glass_ / index_[1]) * d_scalar.col(Slopes::kGlass);
    d_port->col(7) = (-air_to_water_ / index_[2]) * d_scalar.col(Slopes::kWater);
  };
  chain(trace.gamma, 1.0 - trace.delta, slopes.gamma, -slopes.delta, &jacobian->d_origin_d_air,
        &jacobian->d_origin_d_port);
  chain(trace.alpha, -trace.beta, slopes.alpha, -slopes.beta, &jacobian->d_direction_d_air,
        &jacobian->d_direction_d_port);
  ray->origin = trace.gamma * direction + (1.0 - trace.delta) * c;
  ray->direction = trace.alpha * direction - trace.beta * c;
  return Projection::kOk;
}

}  // namespace rsfm
