// Contrast of murky water: adaptive histogram equalisation with a limit [Zuiderveld 1994, Graphics
// Gems IV, "Contrast limited adaptive histogram equalization"], in fixed memory.
#pragma once

#include <cstddef>
#include <cstdint>

#include "rsfm/base/fixed_vector.h"

namespace rsfm {

class ContrastEqualiser {
 public:
  // The only place that allocates. The image is divided into 8 x 8 tiles; `limit` times the mean
  // height of a tile's histogram is what a grey value may have, the rest is spread over all. 0: the
  // images stay as they are.
  ContrastEqualiser(int width_px, int height_px, double limit);

  // In place; an image of the size given above.
  void Apply(std::uint8_t* grey, int stride_bytes) noexcept;

  std::size_t bytes() const { return tables_.bytes() + columns_.bytes() + blended_.bytes(); }

 private:
  // Where a column lies between the centres of two tiles.
  struct Column {
    std::uint16_t table = 0;  // of the tile to the left, in the row of blended tables
    std::uint16_t right = 0;  // share of the tile to the right, 256 all
  };
  void MakeTable(const std::uint8_t* grey, int stride_bytes, int tile_x, int tile_y) noexcept;

  int width_ = 0, height_ = 0;
  double limit_ = 0.0;
  FixedVector<std::uint8_t> tables_;  // of each tile, 256 values
  FixedVector<Column> columns_;
  FixedVector<std::uint16_t> blended_;  // tables of one row of pixels
};

}  // namespace rsfm
