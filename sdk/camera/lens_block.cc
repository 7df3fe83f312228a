#include "rsfm/camera/lens_block.h"

#include <algorithm>
#include <cmath>

// Compiled with -O3 -fno-math-errno -fno-trapping-math, without which no compiler may vectorise a
// square root.
namespace rsfm {

RSFM_VECTOR_CLONES
void NormalisePixelBlock(const LensBlockParams& params, LensBlock* block) noexcept {
  const double limit = params.max_radius_squared;
  for (int i = 0; i < kLensBlock; ++i) {
    const double x = (block->x[i] - params.cx) * params.inverse_fx;
    const double y = (block->y[i] - params.cy) * params.inverse_fy;
    block->x[i] = x;
    block->y[i] = y;
    block->settled[i] = x * x + y * y <= limit ? 1.0 : 0.0;
  }
}

// The steps of ComposedLens::Undistort with PolynomialDistortion; see there for the equations.
RSFM_VECTOR_CLONES
void UndistortBlock(const LensBlockParams& params, LensBlock* block) noexcept {
  constexpr int kSteps = 3;
  const double k1 = params.radial[0], k2 = params.radial[1], k3 = params.radial[2],
               k4 = params.radial[3];
  const double p1 = params.p1, p2 = params.p2, sx = params.sx, sy = params.sy;
  const double limit = params.max_radius_squared;
  const auto& b = params.series.b;
  const double b1 = b[0], b2 = b[1], b3 = b[2], b4 = b[3], b5 = b[4], b6 = b[5];
  for (int i = 0; i < kLensBlock; ++i) {
    const double qx = (block->x[i] - params.cx) * params.inverse_fx;
    const double qy = (block->y[i] - params.cy) * params.inverse_fy;
    const double q2 = qx * qx + qy * qy, q4 = q2 * q2;
    double factor = q2 * ((b1 + b2 * q2) + q4 * ((b3 + b4 * q2) + q4 * (b5 + b6 * q2)));
    factor = std::abs(factor) < kMaxSeriesFactor ? factor : 0.0;
    double x = qx + factor * qx, y = qy + factor * qy;
    double change = 0.0, least = 1.0;
#pragma GCC unroll 3  // an inner loop would keep the outer one from being vectorised
    for (int step = 0; step < kSteps; ++step) {
      const double xx = x * x, yy = y * y, xy = x * y, r2 = xx + yy;
      const double radial = r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)));
      const double slope = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3 + r2 * (4.0 * k4)));
      const double u = x + x * radial + 2.0 * p1 * xy + p2 * (r2 + 2.0 * xx) + sx * r2 - qx;
      const double v = y + y * radial + 2.0 * p2 * xy + p1 * (r2 + 2.0 * yy) + sy * r2 - qy;
      const double mixed = 2.0 * xy * slope + 2.0 * p1 * x + 2.0 * p2 * y;
      const double uu = 1.0 + radial + 2.0 * xx * slope + 2.0 * p1 * y + (6.0 * p2 + 2.0 * sx) * x;
      const double vv = 1.0 + radial + 2.0 * yy * slope + 2.0 * p2 * x + (6.0 * p1 + 2.0 * sy) * y;
      const double uv = mixed + 2.0 * sx * y, vu = mixed + 2.0 * sy * x;
      const double determinant = uu * vv - uv * vu, inverse = 1.0 / determinant;
      const double dx = inverse * (vv * u - uv * v), dy = inverse * (uu * v - vu * u);
      x -= dx;
      y -= dy;
      change = dx * dx + dy * dy;
      least = std::min(least, determinant);
    }
    const double r2 = x * x + y * y;
    block->x[i] = x;
    block->y[i] = y;
    block->settled[i] =
        ((least > 0.0) & (r2 <= limit) & (change <= 1e-16 * (1e-6 + r2))) ? 1.0 : 0.0;
  }
}

RSFM_VECTOR_CLONES
void PerspectiveBlock(LensBlock* block) noexcept {
  for (int i = 0; i < kLensBlock; ++i) {
    const double scale =
        1.0 / std::sqrt(1.0 + block->x[i] * block->x[i] + block->y[i] * block->y[i]);
    block->direction_x[i] = scale * block->x[i];
    block->direction_y[i] = scale * block->y[i];
    block->direction_z[i] = scale;
  }
}

}  // namespace rsfm
