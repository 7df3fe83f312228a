#include "rsfm/mapping/contrast.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/mapping/blob_image.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr int kWidth = BlobImage::kWidth, kHeight = BlobImage::kHeight;

// As through murky water: a tenth of the contrast, and light that falls off to one side.
std::vector<std::uint8_t> Murky(const std::vector<std::uint8_t>& clear) {
  std::vector<std::uint8_t> murky;
  for (std::size_t i = 0; i < clear.size(); ++i) {
    const double x = static_cast<double>(i % kWidth) / kWidth;
    murky.push_back(static_cast<std::uint8_t>(0.1 * clear[i] + 60.0 + 80.0 * x + 0.5));
  }
  return murky;
}

// Standard deviation within blocks of 40 x 40 px, their mean.
double LocalContrast(const std::vector<std::uint8_t>& image) {
  double total = 0.0;
  int blocks = 0;
  for (int top = 0; top + 40 <= kHeight; top += 40) {
    for (int left = 0; left + 40 <= kWidth; left += 40, ++blocks) {
      double sum = 0.0, squares = 0.0;
      for (int y = top; y < top + 40; ++y) {
        for (int x = left; x < left + 40; ++x) {
          const double value = image[static_cast<std::size_t>(y * kWidth + x)];
          sum += value;
          squares += value * value;
        }
      }
      total += std::sqrt(std::max(0.0, squares / 1600.0 - sum * sum / 2.56e6));
    }
  }
  return total / blocks;
}

TEST(ContrastEqualiser, BringsOutWhatTheWaterTook) {
  BlobImage image = BlobImage::Texture(Vec2::Zero());
  const std::vector<std::uint8_t> murky = Murky(image.bytes());
  double last = LocalContrast(murky);
  for (const double limit : {2.0, 4.0, 8.0}) {
    std::vector<std::uint8_t> equalised = murky;
    ContrastEqualiser(kWidth, kHeight, limit).Apply(equalised.data(), kWidth);
    const double contrast = LocalContrast(equalised);
    EXPECT_GT(contrast, 1.25 * last) << limit;  // the limit limits
    EXPECT_LT(contrast, 74.0);                  // of greys evenly spread
    last = contrast;
  }
  EXPECT_GT(last, 5.0 * LocalContrast(murky));
}

// Brighter stays brighter within a neighbourhood, and a flat image stays flat.
TEST(ContrastEqualiser, KeepsOrderAndMakesNoEdges) {
  std::vector<std::uint8_t> ramp(kWidth * kHeight), flat(kWidth * kHeight, 93);
  for (std::size_t i = 0; i < ramp.size(); ++i)
    ramp[i] = static_cast<std::uint8_t>(40 + i / kWidth / 4);
  ContrastEqualiser equaliser(kWidth, kHeight, 3.0);
  equaliser.Apply(flat.data(), kWidth);
  const auto [low, high] = std::minmax_element(flat.begin(), flat.end());
  EXPECT_LE(*high - *low, 2);
  equaliser.Apply(ramp.data(), kWidth);
  int largest = 0;
  for (int y = 1; y < kHeight; ++y) {
    for (int x = 1; x < kWidth; ++x) {
      const auto i = static_cast<std::size_t>(y * kWidth + x);
      largest = std::max({largest, std::abs(ramp[i] - ramp[i - 1]), ramp[i - kWidth] - ramp[i]});
    }
  }
  EXPECT_LE(largest, 3);  // between tiles as within them
}

TEST(ContrastEqualiser, WithoutLimitItLeavesTheImage) {
  BlobImage image;
  const std::vector<std::uint8_t> before = image.bytes();
  ContrastEqualiser none(kWidth, kHeight, 0.0);
  none.Apply(image.bytes().data(), kWidth);
  EXPECT_EQ(image.bytes(), before);
  EXPECT_EQ(none.bytes(), 0u);
}

TEST(ContrastEqualiser, TakesNoMemory) {
  BlobImage image;
  ContrastEqualiser equaliser(kWidth, kHeight, 3.0);
  const MallocTrap trap;
  equaliser.Apply(image.bytes().data(), kWidth);
  EXPECT_EQ(trap.count(), 0u);
}

}  // namespace
}  // namespace rsfm
