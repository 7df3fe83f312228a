#include "rsfm/refraction/port_batch.h"

#include <algorithm>
#include <cmath>

// Compiled with -O3 -fno-math-errno -fno-trapping-math, without which no compiler may vectorise a
// square root.
namespace rsfm {

// The steps of FlatPort::Solve with air as the lowest medium; see there for the equations.
RSFM_VECTOR_CLONES
void SolveFlatBlock(const FlatBlockParams& params, PortBlock* block) noexcept {
  constexpr int kSteps = 3;
  const double nx = params.normal[0], ny = params.normal[1], nz = params.normal[2];
  const double e1 = params.excess_glass, e2 = params.excess_water;
  const double l = params.distance, a1 = params.ratio_glass * params.thickness;
  const double glass_end = params.distance + params.thickness;
  const double apparent_in =
      params.thickness * params.apparent_glass + params.distance * params.apparent_air;
  const double k = params.invariant_ratio;
  for (int i = 0; i < kPortBlock; ++i) {
    const double height = nx * block->x[i] + ny * block->y[i] + nz * block->z[i];
    const double water = height - glass_end;
    const double ox = block->x[i] - height * nx, oy = block->y[i] - height * ny,
                 oz = block->z[i] - height * nz;
    const double r2 = ox * ox + oy * oy + oz * oz;
    const double r = std::sqrt(r2);
    const double apparent = water + apparent_in;
    const double a2 = params.ratio_water * water;
    const double radicand = apparent * apparent + r2 * (1.0 - k * k);
    const bool regular = (water > 0.0) & (radicand > 1e-4 * r2) & (r2 > 1e-20) & (r2 < 1e20);
    double u = k * r / std::sqrt(regular ? radicand : 1.0);
    double change = 1.0;
    for (int step = 0; step < kSteps; ++step) {
      const double uu = u * u;
      const double q1 = 1.0 / (1.0 + e1 * uu), q2 = 1.0 / (1.0 + e2 * uu);
      const double w1 = a1 * std::sqrt(q1), w2 = a2 * std::sqrt(q2);
      const double residual = u * (l + w1 + w2) - r;
      const double d1 = w1 * q1, d2 = w2 * q2;
      const double slope = l + d1 + d2;
      const double half_curvature = -1.5 * u * (e1 * d1 * q1 + e2 * d2 * q2);
      change = residual * slope / (slope * slope - residual * half_curvature);
      u -= change;
    }
    const double cosine = 1.0 / std::sqrt(1.0 + u * u);
    const double scale = u * cosine / r;
    block->direction_x[i] = cosine * nx + scale * ox;
    block->direction_y[i] = cosine * ny + scale * oy;
    block->direction_z[i] = cosine * nz + scale * oz;
    block->settled[i] = (regular & (u > 0.0) & (std::abs(change) <= 5e-6 * u)) ? 1.0 : 0.0;
  }
}

// The steps of DomePort::Evaluate and Solve; see there for the equations.
RSFM_VECTOR_CLONES
void SolveDomeBlock(const DomeBlockParams& params, PortBlock* block) noexcept {
  constexpr int kSteps = 2;  // what usual rigs take
  const double cx = params.center[0], cy = params.center[1], cz = params.center[2];
  const double g = params.air_to_glass, w = params.air_to_water;
  const double inner2 = params.inner * params.inner, outer2 = params.outer * params.outer;
  const double scale = 1.0 / (inner2 * outer2);
  const double paraxial_bend = (g - 1.0) / params.inner + (w - g) / params.outer;
  for (int i = 0; i < kPortBlock; ++i) {
    const double px = block->x[i] - cx, py = block->y[i] - cy, pz = block->z[i] - cz;
    const double range = std::sqrt(px * px + py * py + pz * pz);
    const double inverse_range = 1.0 / range;
    const double ux = px * inverse_range, uy = py * inverse_range, uz = pz * inverse_range;
    const double camera_u = -(cx * ux + cy * uy + cz * uz);
    const double ax = -cx - camera_u * ux, ay = -cy - camera_u * uy, az = -cz - camera_u * uz;
    const double camera_v = std::sqrt(ax * ax + ay * ay + az * az);
    // The paraxial start.
    const double k = range * paraxial_bend - w;
    const double start = camera_v * k / (range + camera_u * k);
    const bool near_axis = std::abs(start) < 0.8;
    double sine = near_axis ? start : 0.0, cosine = std::sqrt(1.0 - sine * sine);
    double step_size = 1.0, turned_cosine = 0.0;
    double regular = (range > params.outer) & (range < 1e20) & near_axis ? 1.0 : 0.0;
#pragma GCC unroll 2  // an inner loop would keep the outer one from being vectorised
    for (int step = 0; step < kSteps; ++step) {
      const double b = camera_u * sine - camera_v * cosine,
                   d_b = camera_u * cosine + camera_v * sine;
      const double bg = g * b, bw = w * b;
      const double s_air = inner2 - b * b, s_in = inner2 - bg * bg, s_out = outer2 - bg * bg,
                   s_water = outer2 - bw * bw;
      const double least = std::min(std::min(s_air, s_in), std::min(s_out, s_water));
      regular = least > 0.0 ? regular : 0.0;
      const double h_air = std::sqrt(std::max(s_air, 1e-30)),
                   h_in = std::sqrt(std::max(s_in, 1e-30));
      const double h_out = std::sqrt(std::max(s_out, 1e-30)),
                   h_water = std::sqrt(std::max(s_water, 1e-30));
      const double i_air = 1.0 / h_air, i_in = 1.0 / h_in, i_out = 1.0 / h_out,
                   i_water = 1.0 / h_water;
      const double inner_re = h_in * h_air + bg * b, inner_im = bg * h_air - h_in * b;
      const double outer_re = h_water * h_out + bw * bg, outer_im = bw * h_out - h_water * bg;
      const double turn_re = scale * (inner_re * outer_re - inner_im * outer_im);
      const double turn_im = scale * (inner_re * outer_im + inner_im * outer_re);
      turned_cosine = cosine * turn_re - sine * turn_im;
      const double turned_sine = sine * turn_re + cosine * turn_im;
      const double bend = g * i_in - i_air + w * i_water - g * i_out;
      const double bend_slope = g * g * bg * i_in * i_in * i_in - b * i_air * i_air * i_air +
                                w * w * bw * i_water * i_water * i_water -
                                g * g * bg * i_out * i_out * i_out;
      const double first = 1.0 + d_b * bend, second = -b * bend + d_b * d_b * bend_slope;
      const double residual = turned_sine - bw * inverse_range;
      const double slope = turned_cosine * first - w * d_b * inverse_range;
      const double curvature =
          -turned_sine * first * first + turned_cosine * second + bw * inverse_range;
      const double denominator = slope * slope - 0.5 * residual * curvature;
      step_size = -residual * slope / denominator;
      const double sound = std::min(std::min(slope, denominator), 1.0 - std::abs(step_size));
      regular = sound > 0.0 ? regular : 0.0;
      const double quarter = 0.25 * step_size * step_size, unit = 1.0 / (1.0 + quarter);
      const double turn_cosine = (1.0 - quarter) * unit, turn_sine = step_size * unit;
      const double old_cosine = cosine;
      cosine = cosine * turn_cosine - sine * turn_sine;
      sine = sine * turn_cosine + old_cosine * turn_sine;
    }
    const double across = camera_v > 0.0 ? sine / camera_v : 0.0;
    block->direction_x[i] = cosine * ux + across * ax;
    block->direction_y[i] = cosine * uy + across * ay;
    block->direction_z[i] = cosine * uz + across * az;
    block->settled[i] = (std::abs(step_size) <= 5e-6) & (turned_cosine > 0.0) ? regular : 0.0;
  }
}

// FlatPort::RefractToWater.
RSFM_VECTOR_CLONES
void TraceFlatBlock(const FlatRayParams& params, RayBlock* block) noexcept {
  const double nx = params.normal[0], ny = params.normal[1], nz = params.normal[2];
  const double g = params.to_glass, w = params.to_water, d = params.distance;
  const double t = params.thickness * g, end = params.distance + params.thickness;
  for (int i = 0; i < kPortBlock; ++i) {
    const double cosine = nx * block->air_x[i] + ny * block->air_y[i] + nz * block->air_z[i];
    const double tx = block->air_x[i] - cosine * nx, ty = block->air_y[i] - cosine * ny,
                 tz = block->air_z[i] - cosine * nz;
    const double sine_squared = tx * tx + ty * ty + tz * tz;
    const double glass = 1.0 - g * g * sine_squared, water = 1.0 - w * w * sine_squared;
    const double least = std::min(cosine, std::min(glass, water));
    const double root = std::sqrt(std::max(glass, 1e-30));
    const double across = (d * root + t * cosine) / (cosine * root);
    const double along = std::sqrt(std::max(water, 0.0));
    block->origin_x[i] = across * tx + end * nx;
    block->origin_y[i] = across * ty + end * ny;
    block->origin_z[i] = across * tz + end * nz;
    block->water_x[i] = w * tx + along * nx;
    block->water_y[i] = w * ty + along * ny;
    block->water_z[i] = w * tz + along * nz;
    block->settled[i] = least > 0.0 ? 1.0 : 0.0;
  }
}

// DomePort::RefractToWater.
RSFM_VECTOR_CLONES
void TraceDomeBlock(const DomeBlockParams& params, RayBlock* block) noexcept {
  const double cx = params.center[0], cy = params.center[1], cz = params.center[2];
  const double g = params.air_to_glass, w = params.air_to_water, from_glass = w / g;
  const double inner2 = params.inner * params.inner, outer2 = params.outer * params.outer;
  const double per_inner2 = 1.0 / inner2, per_outer2 = 1.0 / outer2;
  const double distance2 = cx * cx + cy * cy + cz * cz;
  for (int i = 0; i < kPortBlock; ++i) {
    const double vx = block->air_x[i], vy = block->air_y[i], vz = block->air_z[i];
    const double a = -(cx * vx + cy * vy + cz * vz);
    const double bb = std::max(distance2 - a * a, 0.0);
    const double s_air = inner2 - bb, s_in = inner2 - g * g * bb, s_out = outer2 - g * g * bb,
                 s_water = outer2 - w * w * bb;
    const double least = std::min(std::min(s_air, s_in), std::min(s_out, s_water));
    const double h_air = std::sqrt(std::max(s_air, 0.0)), h_in = std::sqrt(std::max(s_in, 0.0));
    const double h_out = std::sqrt(std::max(s_out, 0.0)),
                 h_water = std::sqrt(std::max(s_water, 0.0));
    const double lambda = h_air - a, mu = h_out - h_in;
    const double q = (h_in - g * h_air) * per_inner2, p = g + q * lambda;
    const double gamma = lambda + mu * p, delta = 1.0 + mu * q;
    const double k = (h_water - from_glass * h_out) * per_outer2;
    const double alpha = from_glass * p + k * gamma, beta = from_glass * q + k * delta;
    const double back = 1.0 - delta;
    block->origin_x[i] = gamma * vx + back * cx;
    block->origin_y[i] = gamma * vy + back * cy;
    block->origin_z[i] = gamma * vz + back * cz;
    block->water_x[i] = alpha * vx - beta * cx;
    block->water_y[i] = alpha * vy - beta * cy;
    block->water_z[i] = alpha * vz - beta * cz;
    block->settled[i] = least > 0.0 ? 1.0 : 0.0;
  }
}

}  // namespace rsfm
