#include "rsfm/mapping/corner_detector.h"

#include <algorithm>
#include <cmath>

#include "rsfm/base/vector_clones.h"

namespace rsfm {
namespace {

constexpr int kRadius = 2;  // of the sums
constexpr int kRows = 2 * kRadius + 1;
constexpr float kScale = 1.0f / (4.0f * kRows * kRows);  // differences span two pixels

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

// Products of the differences at `columns` pixels and two more at either end, summed over five.
RSFM_VECTOR_CLONES
void SumProducts(const std::uint8_t* row, int stride_bytes, int columns,
                 std::int32_t* __restrict xx, std::int32_t* __restrict xy,
                 std::int32_t* __restrict yy) {
  const std::uint8_t *above = row - stride_bytes, *below = row + stride_bytes;
  for (int x = 0; x < columns; ++x) {
    std::int32_t sum_xx = 0, sum_xy = 0, sum_yy = 0;
    for (int k = -kRadius; k <= kRadius; ++k) {
      const auto gx = static_cast<std::int16_t>(row[x + k + 1] - row[x + k - 1]);
      const auto gy = static_cast<std::int16_t>(below[x + k] - above[x + k]);
      sum_xx += static_cast<std::int32_t>(gx) * gx;
      sum_xy += static_cast<std::int32_t>(gx) * gy;
      sum_yy += static_cast<std::int32_t>(gy) * gy;
    }
    xx[x] = sum_xx;
    xy[x] = sum_xy;
    yy[x] = sum_yy;
  }
}

struct FiveRows {
  const std::int32_t* row[kRows];
};

RSFM_VECTOR_CLONES
void SmallerEigenvalues(const FiveRows& xx, const FiveRows& xy, const FiveRows& yy, int columns,
                        float* __restrict scores) {
  for (int x = 0; x < columns; ++x) {
    const auto sum = [x](const FiveRows& of) {
      return static_cast<float>(of.row[0][x] + of.row[1][x] + of.row[2][x] + of.row[3][x] +
                                of.row[4][x]);
    };
    const float a = sum(xx), b = sum(xy), c = sum(yy);
    scores[x] = 0.5f * kScale * (a + c - std::sqrt((a - c) * (a - c) + 4.0f * b * b));
  }
}

// The offset of the maximum of the parabola through three values, the middle one largest.
float PeakOf(float before, float at, float after) {
  const float curvature = before - 2.0f * at + after;
  return curvature < 0.0f ? std::clamp(0.5f * (before - after) / curvature, -0.5f, 0.5f) : 0.0f;
}

// Into a list of falling scores that keeps its best; equal scores stay in order.
void Insert(const Corner& corner, std::span<Corner> corners, int* count) {
  int i = *count < static_cast<int>(corners.size()) ? (*count)++ : *count - 1;
  for (; i > 0 && corners[Count(i - 1)].score < corner.score; --i)
    corners[Count(i)] = corners[Count(i - 1)];
  corners[Count(i)] = corner;
}

}  // namespace

CornerDetector::CornerDetector(int max_width_px)
    : stride_(max_width_px + 2),
      products_(3 * kRows * Count(max_width_px + 2)),
      scores_(3 * Count(max_width_px + 2)) {
  products_.TryResize(products_.capacity());
  scores_.TryResize(scores_.capacity());
}

void CornerDetector::AddRow(const PyramidLevel& image, int left, int columns, int y) noexcept {
  const std::uint8_t* row =
      image.origin + static_cast<std::ptrdiff_t>(y) * image.stride_bytes + left;
  std::int32_t* to = products_.data() + Count((y + 2 * kRows) % kRows) * 3 * Count(stride_);
  SumProducts(row, image.stride_bytes, columns, to, to + stride_, to + 2 * stride_);
}

// Of row y, from the products of rows y - 2 to y + 2.
const float* CornerDetector::ScoreRow(int columns, int y) noexcept {
  FiveRows rows[3];
  for (int k = 0; k < kRows; ++k) {
    const int slot = (y + k - kRadius + 2 * kRows) % kRows;
    for (int i = 0; i < 3; ++i)
      rows[i].row[k] = products_.data() + Count(slot * 3 + i) * Count(stride_);
  }
  float* scores = scores_.data() + Count((y + 3) % 3) * Count(stride_);
  SmallerEigenvalues(rows[0], rows[1], rows[2], columns, scores);
  return scores;
}

int CornerDetector::Detect(const PyramidLevel& image, const ImagePart& part, float min_score,
                           std::span<Corner> corners) noexcept {
  if (corners.empty() || part.right <= part.left || part.right - part.left + 2 > stride_) return 0;
  const int left = part.left - 1, columns = part.right - part.left + 2;
  int count = 0;
  const float *above = nullptr, *here = nullptr;
  for (int y = part.top - 1 - kRadius; y < part.bottom + 1 + kRadius; ++y) {
    AddRow(image, left, columns, y);
    const int score_y = y - kRadius;
    if (score_y < part.top - 1) continue;
    const float* below = ScoreRow(columns, score_y);
    if (score_y > part.top) {
      for (int x = 1; x + 1 < columns; ++x) {
        const float score = here[x];
        if (!(score >= min_score) || score <= here[x - 1] || score < here[x + 1]) continue;
        if (score <= above[x - 1] || score <= above[x] || score <= above[x + 1]) continue;
        if (score < below[x - 1] || score < below[x] || score < below[x + 1]) continue;
        if (count == static_cast<int>(corners.size()) && score <= corners.back().score) continue;
        Insert({static_cast<float>(left + x) + PeakOf(here[x - 1], score, here[x + 1]),
                static_cast<float>(score_y - 1) + PeakOf(above[x], score, below[x]), score},
               corners, &count);
      }
    }
    above = here;
    here = below;
  }
  return count;
}

}  // namespace rsfm
