// The SIFT descriptor [Lowe 2004, IJCV, sec. 6] of a patch at the image's own scale, as RootSIFT
// [Arandjelovic 2012, CVPR]: what tracked points are recognised by later. Fixed memory.
//
// The patch is smoothed to a sigma of 2 px; its direction is that of its intensity centroid [Rosin
// 1999, CVIU]. A cell of the 4 x 4 is 6 px wide.
#pragma once

#include <cstdint>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/mapping/image_pyramid.h"
#include "rsfm/mapping/patch_tracker.h"

namespace rsfm {

// 128 histogram values, none negative, to bytes: their square roots at a length of 512.
void PackRootSift(const float* values, std::uint8_t* packed) noexcept;

class PatchDescriber {
 public:
  static constexpr int kBorderPx = 44;  // what the image must have around it

  // The only place that allocates.
  PatchDescriber();

  // 128 bytes. Precondition: the place (top-left pixel's centre at (0, 0)) is in the image. All
  // zero where there is no gradient at all.
  void Describe(const PyramidLevel& image, PatchPlace at, std::uint8_t* packed) noexcept;

  std::size_t bytes() const { return pixels_.bytes(); }

 private:
  FixedVector<float> pixels_;
  float *source_, *across_, *smooth_, *weights_, *size_, *direction_;
};

}  // namespace rsfm
