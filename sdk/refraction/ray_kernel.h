// The inner loops of RayTable.
#pragma once

#include "rsfm/base/ray3.h"
#include "rsfm/base/vector_clones.h"

namespace rsfm {

// rays[i] = sum_k weights[4 i + k] columns[k], k = 0..3; columns are origin and direction, six
// numbers each.
void BlendColumns(const double* columns, const double* weights, int count, Ray3* rays) noexcept;

}  // namespace rsfm
