#include "rsfm/mapping/image_pyramid.h"

#include <algorithm>
#include <cstring>

#include "rsfm/base/vector_clones.h"

namespace rsfm {
namespace {

constexpr int kMinSide = 16;
constexpr int kSlack = 64;  // bytes after the last row: whole vectors are read

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

RSFM_VECTOR_CLONES
void SmoothDown(const std::uint8_t* const (&rows)[5], int count, std::uint16_t* smoothed) {
  const std::uint8_t *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3], *e = rows[4];
  for (int x = 0; x < count; ++x)
    smoothed[x] = static_cast<std::uint16_t>(a[x] + e[x] + 4 * (b[x] + d[x]) + 6 * c[x]);
}

// `smoothed` begins two pixels before the row's first.
RSFM_VECTOR_CLONES
void SmoothAcross(const std::uint16_t* smoothed, int count, std::uint8_t* out) {
  for (int x = 0; x < count; ++x) {
    const std::uint16_t* s = smoothed + 2 * x;
    const auto sum = static_cast<std::uint16_t>(s[0] + s[4] + 4 * (s[1] + s[3]) + 6 * s[2] + 128);
    out[x] = static_cast<std::uint8_t>(sum >> 8);
  }
}

}  // namespace

ImagePyramid::ImagePyramid(int width_px, int height_px, int num_levels, int border_px)
    : border_px_(std::max(border_px, 2)) {
  std::size_t total = 0;
  std::size_t offsets[kMaxLevels] = {};
  for (int i = 0; i < std::min(num_levels, kMaxLevels); ++i) {
    if (i > 0 && std::min(width_px, height_px) < kMinSide) break;
    const int stride = width_px + 2 * border_px_;
    offsets[i] = total + Count(border_px_) * Count(stride) + Count(border_px_);
    total += Count(stride) * Count(height_px + 2 * border_px_);
    levels_.TryPushBack({nullptr, width_px, height_px, stride});
    width_px = (width_px + 1) / 2;
    height_px = (height_px + 1) / 2;
  }
  pixels_ = FixedVector<std::uint8_t>(total + kSlack);
  pixels_.TryResize(pixels_.capacity());
  row_ = FixedVector<std::uint16_t>(Count(levels_[0].stride_bytes) + kSlack);
  row_.TryResize(row_.capacity());
  for (std::size_t i = 0; i < levels_.size(); ++i) levels_[i].origin = pixels_.data() + offsets[i];
}

std::uint8_t* ImagePyramid::Row(int level, int y) noexcept {
  const PyramidLevel& at = levels_[Count(level)];
  return pixels_.data() + (at.origin - pixels_.data()) +
         static_cast<std::ptrdiff_t>(y) * at.stride_bytes;
}

void ImagePyramid::FillBorder(int level) noexcept {
  const PyramidLevel& at = levels_[Count(level)];
  for (int y = 0; y < at.height; ++y) {
    std::uint8_t* row = Row(level, y);
    std::memset(row - border_px_, row[0], Count(border_px_));
    std::memset(row + at.width, row[at.width - 1], Count(border_px_));
  }
  for (int i = 1; i <= border_px_; ++i) {
    std::memcpy(Row(level, -i) - border_px_, Row(level, 0) - border_px_, Count(at.stride_bytes));
    std::memcpy(Row(level, at.height - 1 + i) - border_px_, Row(level, at.height - 1) - border_px_,
                Count(at.stride_bytes));
  }
}

void ImagePyramid::Halve(int level) noexcept {
  const PyramidLevel& half = levels_[Count(level)];
  for (int y = 0; y < half.height; ++y) {
    const std::uint8_t* rows[5];
    for (int k = 0; k < 5; ++k) rows[k] = Row(level - 1, 2 * y + k - 2) - 2;
    SmoothDown(rows, levels_[Count(level - 1)].width + 4, row_.data());
    SmoothAcross(row_.data(), half.width, Row(level, y));
  }
}

void ImagePyramid::Build(const std::uint8_t* grey, int stride_bytes) noexcept {
  if (levels_.empty()) return;
  for (int y = 0; y < levels_[0].height; ++y)
    std::memcpy(Row(0, y), grey + static_cast<std::ptrdiff_t>(y) * stride_bytes,
                Count(levels_[0].width));
  FillBorder(0);
  for (int i = 1; i < num_levels(); ++i) {
    Halve(i);
    FillBorder(i);
  }
}

}  // namespace rsfm
