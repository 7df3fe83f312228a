// One axis of a pinhole from slopes and pixels.
#pragma once

namespace rsfm {

// Least squares of pixel = focal * slope + centre, from running sums.
struct LineFit {
  double n = 0, sum_s = 0, sum_p = 0, sum_ss = 0, sum_sp = 0;

  void Add(double slope, double pixel) noexcept {
    n += 1;
    sum_s += slope;
    sum_p += pixel;
    sum_ss += slope * slope;
    sum_sp += slope * pixel;
  }
  // False with fewer than 16 pairs, for slopes that are all one, and for a focal length that is not
  // positive.
  bool Solve(double* focal, double* center) const noexcept {
    const double spread = n * sum_ss - sum_s * sum_s;
    if (!(n >= 16.0) || !(spread > 1e-12 * n * n)) return false;
    *focal = (n * sum_sp - sum_s * sum_p) / spread;
    *center = (sum_p - *focal * sum_s) / n;
    return *focal > 0.0;
  }
};

}  // namespace rsfm
