#include "rsfm/mapping/contrast.h"

#include <algorithm>

#include "rsfm/base/vector_clones.h"

namespace rsfm {
namespace {

constexpr int kTiles = 8;  // along either side
constexpr int kGreys = 256;

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

// The first pixel of a tile.
int Begin(int tile, int size) { return tile * size / kTiles; }

// A pixel between two tiles' centres: the first of them, and the share of the other in 256.
void Between(int pixel, int size, int* tile, int* share) {
  const double at = (pixel + 0.5) * kTiles / size - 0.5;
  *tile = std::clamp(static_cast<int>(at + 1.0) - 1, 0, kTiles - 2);
  *share = static_cast<int>(std::clamp(at - *tile, 0.0, 1.0) * 256.0 + 0.5);
}

RSFM_VECTOR_CLONES
void Blend(const std::uint8_t* upper, const std::uint8_t* lower, int share, int count,
           std::uint16_t* blended) {
  for (int i = 0; i < count; ++i)
    blended[i] = static_cast<std::uint16_t>(upper[i] * (256 - share) + lower[i] * share);
}

}  // namespace

ContrastEqualiser::ContrastEqualiser(int width_px, int height_px, double limit)
    : width_(width_px), height_(height_px), limit_(limit) {
  if (!(limit > 0.0)) return;
  tables_ = FixedVector<std::uint8_t>(kTiles * kTiles * kGreys);
  tables_.TryResize(tables_.capacity());
  blended_ = FixedVector<std::uint16_t>(kTiles * kGreys);
  blended_.TryResize(blended_.capacity());
  columns_ = FixedVector<Column>(Count(width_px));
  for (int x = 0; x < width_px; ++x) {
    int tile, share;
    Between(x, width_px, &tile, &share);
    columns_.TryPushBack(
        {static_cast<std::uint16_t>(tile * kGreys), static_cast<std::uint16_t>(share)});
  }
}

void ContrastEqualiser::MakeTable(const std::uint8_t* grey, int stride_bytes, int tile_x,
                                  int tile_y) noexcept {
  const int left = Begin(tile_x, width_), right = Begin(tile_x + 1, width_);
  const int top = Begin(tile_y, height_), bottom = Begin(tile_y + 1, height_);
  // Four histograms: equal neighbours do not wait for each other.
  std::int32_t histograms[4][kGreys] = {};
  for (int y = top; y < bottom; ++y) {
    const std::uint8_t* row = grey + static_cast<std::ptrdiff_t>(y) * stride_bytes;
    for (int x = left; x < right; ++x) ++histograms[x & 3][row[x]];
  }
  const int area = (right - left) * (bottom - top);
  const int most = std::max(1, static_cast<int>(limit_ * area / kGreys));
  int excess = 0;
  std::int32_t* histogram = histograms[0];
  for (int i = 0; i < kGreys; ++i) {
    histogram[i] += histograms[1][i] + histograms[2][i] + histograms[3][i];
    excess += std::max(0, histogram[i] - most);
    histogram[i] = std::min(histogram[i], most);
  }
  // The excess goes to all greys alike; what is left over of the division goes to every n-th.
  const int each = excess / kGreys, left_over = excess % kGreys;
  std::uint8_t* table = tables_.data() + Count(tile_y * kTiles + tile_x) * kGreys;
  std::int64_t sum = 0;
  for (int i = 0; i < kGreys; ++i) {
    sum += histogram[i] + each + ((i + 1) * left_over / kGreys - i * left_over / kGreys);
    table[i] = static_cast<std::uint8_t>((sum * (kGreys - 1) + area / 2) / area);
  }
}

void ContrastEqualiser::Apply(std::uint8_t* grey, int stride_bytes) noexcept {
  if (tables_.empty()) return;
  for (int tile_y = 0; tile_y < kTiles; ++tile_y) {
    for (int tile_x = 0; tile_x < kTiles; ++tile_x) MakeTable(grey, stride_bytes, tile_x, tile_y);
  }
  for (int y = 0; y < height_; ++y) {
    int tile, share;
    Between(y, height_, &tile, &share);
    const std::uint8_t* upper = tables_.data() + Count(tile * kTiles) * kGreys;
    Blend(upper, upper + kTiles * kGreys, share, kTiles * kGreys, blended_.data());
    std::uint8_t* row = grey + static_cast<std::ptrdiff_t>(y) * stride_bytes;
    for (int x = 0; x < width_; ++x) {
      const Column at = columns_[Count(x)];
      const std::uint16_t* table = blended_.data() + at.table + row[x];
      const std::uint32_t value = table[0] * (256u - at.right) + table[kGreys] * at.right;
      row[x] = static_cast<std::uint8_t>((value + 32768u) >> 16);
    }
  }
}

}  // namespace rsfm
