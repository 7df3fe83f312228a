// Structure-of-arrays unprojection: many pixels at once, in loops that the compiler vectorises.
//
// A block runs a fixed number of Newton steps on all its pixels, without a branch; a pixel that has
// not settled by then is marked and left to the lens's own function. On x86-64 the functions exist
// twice, for AVX2 and for the baseline, chosen when the program starts; operations and their order
// are the same in both, and so are the results, bit for bit.
#pragma once

#include "rsfm/base/linear.h"
#include "rsfm/base/vector_clones.h"
#include "rsfm/camera/inverse_series.h"

namespace rsfm {

inline constexpr int kLensBlock = 64;

struct LensBlock {
  double x[kLensBlock], y[kLensBlock];  // pixels in; scratch afterwards
  double direction_x[kLensBlock], direction_y[kLensBlock], direction_z[kLensBlock];  // unit
  double settled[kLensBlock];  // 1: the direction is good; 0: ask the lens's own Unproject

  void Set(int i, const Vec3& direction) {
    direction_x[i] = direction.x();
    direction_y[i] = direction.y();
    direction_z[i] = direction.z();
  }
};

// Constants of a lens with a polynomial distortion or none.
struct LensBlockParams {
  double inverse_fx = 1.0, inverse_fy = 1.0, cx = 0.0, cy = 0.0;
  double max_radius_squared = 0.0;
  InverseSeries series{};
  double radial[4] = {};
  double p1 = 0.0, p2 = 0.0, sx = 0.0, sy = 0.0;
};

// x, y: pixels to points in the plane of the base projection.
void NormalisePixelBlock(const LensBlockParams& params, LensBlock* block) noexcept;
void UndistortBlock(const LensBlockParams& params, LensBlock* block) noexcept;
// Points of the plane z = 1 to unit directions.
void PerspectiveBlock(LensBlock* block) noexcept;

}  // namespace rsfm
