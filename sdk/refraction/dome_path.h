// The solved path through a dome: what dome_port.cc and dome_jacobian.cc share.
#pragma once

#include "rsfm/refraction/dome_port.h"

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

struct DomePort::Trace {
  double a;  // e.v
  double h_air, h_in, h_out, h_water;
  double lambda, mu, q, p, k;
  double gamma, delta, alpha, beta;
};

}  // namespace rsfm
