// The solved path through a flat port: what flat_port.cc and flat_jacobian.cc share.
#pragma once

#include "rsfm/refraction/flat_port.h"

namespace rsfm {

struct FlatPort::Path {
  double u;             // tan(theta) in the medium of the lowest index
  double per_r;         // du / dr on the axis
  int steps;            // evaluations of the path equation
  double r, z;          // of the point
  Vec3 radial;          // the point's offset from the axis, of length r
  double sine, cosine;  // of the angle in air
  double sine_over_r;   // finite on the axis
};

// length / (index cos^3) of every medium, the derivative of length tan(theta) to the invariant, and
// what follows.
struct FlatPort::Slope {
  double tangent[kMaxMedia], of[kMaxMedia];
  double gain;  // d theta_air / d r
  Vec3 radial;  // unit, away from the axis; any perpendicular of the axis for a point on it
  Vec3 turn;    // d direction / d theta_air
};

}  // namespace rsfm
