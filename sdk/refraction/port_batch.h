// Structure-of-arrays path solvers: many points at once, in loops that the compiler vectorises.
//
// A block runs a fixed number of Halley steps on all its points, without a branch; a point that has
// not settled by then (a wild start, no path) is marked and left to the port's own solver. Statuses
// are those of the one-by-one functions, values agree with theirs to rounding. On x86-64 the
// functions exist twice, for AVX2 and for the baseline, chosen when the program starts; operations
// and their order are the same in both, and so are the results, bit for bit.
#pragma once

#include "rsfm/base/vector_clones.h"

namespace rsfm {

inline constexpr int kPortBlock = 64;

// Coordinates of a block of points, and what becomes of them.
struct PortBlock {
  double x[kPortBlock], y[kPortBlock], z[kPortBlock];
  double direction_x[kPortBlock], direction_y[kPortBlock], direction_z[kPortBlock];
  double settled[kPortBlock];  // 1: the direction is good; 0: ask the port's own solver
};

// Unit directions in air of a block of pixels, and their rays in water.
struct RayBlock {
  double air_x[kPortBlock], air_y[kPortBlock], air_z[kPortBlock];
  double origin_x[kPortBlock], origin_y[kPortBlock], origin_z[kPortBlock];
  double water_x[kPortBlock], water_y[kPortBlock], water_z[kPortBlock];
  double settled[kPortBlock];  // 1: the ray is good; 0: ask the port's own function
};

// Constants of a flat port, as FlatPort derives them.
struct FlatBlockParams {
  double normal[3];
  double distance, thickness;
  double invariant_ratio;                                       // index_water / index_lowest
  double apparent_air, apparent_glass;                          // index_water / index of each
  double ratio_glass, ratio_water, excess_glass, excess_water;  // against air, which is the lowest
};
// Precondition: air has the lowest index.
void SolveFlatBlock(const FlatBlockParams& params, PortBlock* block) noexcept;

// A flat port of one layer, whatever its indices.
struct FlatRayParams {
  double normal[3];
  double distance, thickness;
  double to_glass, to_water;  // index_air / index of each
};
void TraceFlatBlock(const FlatRayParams& params, RayBlock* block) noexcept;

struct DomeBlockParams {
  double center[3];
  double inner, outer;
  double air_to_glass, air_to_water;
};
void SolveDomeBlock(const DomeBlockParams& params, PortBlock* block) noexcept;
void TraceDomeBlock(const DomeBlockParams& params, RayBlock* block) noexcept;

}  // namespace rsfm
