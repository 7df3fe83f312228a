#include "rsfm/refraction/ray_kernel.h"

// Compiled with -O3.
namespace rsfm {

RSFM_VECTOR_CLONES
void BlendColumns(const double* columns, const double* weights, int count, Ray3* rays) noexcept {
  for (int i = 0; i < count; ++i) {
    const double w0 = weights[4 * i], w1 = weights[4 * i + 1], w2 = weights[4 * i + 2],
                 w3 = weights[4 * i + 3];
    double value[6];
    for (int c = 0; c < 6; ++c) {
      value[c] =
          (w0 * columns[c] + w1 * columns[6 + c]) + (w2 * columns[12 + c] + w3 * columns[18 + c]);
    }
    double* origin = rays[i].origin.data();
    double* direction = rays[i].direction.data();
    for (int c = 0; c < 3; ++c) origin[c] = value[c];
    for (int c = 0; c < 3; ++c) direction[c] = value[3 + c];
  }
}

}  // namespace rsfm
