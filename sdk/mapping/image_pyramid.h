// An 8-bit image and its halvings, each with a border of repeated edge pixels, so that a patch
// about any point of the image can be read without a question. Fixed memory.
#pragma once

#include <cstddef>
#include <cstdint>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/base/static_vector.h"

namespace rsfm {

// Pixels of one level. Row y begins at `origin + y * stride_bytes`; rows and columns down to
// -border_px and up to the size plus border_px - 1 may be read.
struct PyramidLevel {
  const std::uint8_t* origin = nullptr;
  int width = 0, height = 0;
  int stride_bytes = 0;
};

class ImagePyramid {
 public:
  static constexpr int kMaxLevels = 8;

  ImagePyramid() = default;
  // The only place that allocates. Levels whose shorter side would fall below 16 px are left out.
  ImagePyramid(int width_px, int height_px, int num_levels, int border_px);

  // From an image of the size given above. Each level is the one before, smoothed by the binomial
  // (1 4 6 4 1) / 16 in both directions, at its even pixels [Burt & Adelson 1983, IEEE T-COM]:
  // pixel x of a level has the centre of pixel 2 x of the one before.
  void Build(const std::uint8_t* grey, int stride_bytes) noexcept;

  int num_levels() const { return static_cast<int>(levels_.size()); }
  const PyramidLevel& level(int i) const { return levels_[static_cast<std::size_t>(i)]; }
  int border_px() const { return border_px_; }
  std::size_t bytes() const { return pixels_.bytes() + row_.bytes(); }

 private:
  std::uint8_t* Row(int level, int y) noexcept;
  void FillBorder(int level) noexcept;
  void Halve(int level) noexcept;

  int border_px_ = 0;
  FixedVector<std::uint8_t> pixels_;
  FixedVector<std::uint16_t> row_;  // one row, smoothed downwards; its even and odd pixels
  StaticVector<PyramidLevel, kMaxLevels> levels_;
};

}  // namespace rsfm
