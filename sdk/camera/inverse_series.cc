#include "rsfm/camera/inverse_series.h"

namespace rsfm {

// Powers of a series P = 1 + a1 x + ...: with c = P^m,  k c_k = sum_i (m i - (k - i)) a_i c_(k-i)
// [Knuth, The Art of Computer Programming 2, sec. 4.7, eq. (9)].
InverseSeries RevertRadialSeries(const std::array<double, InverseSeries::kTerms>& a) noexcept {
  InverseSeries series;
  for (int n = 1; n <= InverseSeries::kTerms; ++n) {
    const double power = -(2.0 * n + 1.0);
    std::array<double, InverseSeries::kTerms + 1> c{1.0};
    for (int k = 1; k <= n; ++k) {
      double sum = 0.0;
      for (int i = 1; i <= k; ++i) sum += (power * i - (k - i)) * a[i - 1] * c[k - i];
      c[k] = sum / k;
    }
    series.b[n - 1] = c[n] / (2.0 * n + 1.0);
  }
  return series;
}

}  // namespace rsfm
