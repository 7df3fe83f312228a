// Conversions to grey against the formula, pixel by pixel, with padded rows and odd widths.
#include "rsfm_drivers/v4l2/grey.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <vector>

#include "rsfm/base/rng.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

std::vector<std::uint8_t> RandomBytes(std::size_t count, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<std::uint8_t> bytes(count);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(rng.Uniform(0.0, 255.99));
  return bytes;
}

using Expect = std::function<int(const std::vector<std::uint8_t>& raw, int stride, int x, int y)>;

struct GreyCase {
  const char* name;
  PixelFormat format;
  int bytes_per_pixel;
  Expect expected;
};

int Mirror(int i, int size) { return i < 0 ? 1 : i >= size ? size - 2 : i; }

constexpr int kHeight = 5;
constexpr int kWidths[] = {2, 3, 15, 16, 17, 33, 64, 101};

class GreyTest : public ::testing::TestWithParam<int> {
 protected:
  // `width` is needed by the mosaic's border.
  static std::vector<GreyCase> Cases(int width) {
    return {
        {"grey", PixelFormat::kGrey, 1,
         [](const auto& raw, int stride, int x, int y) { return raw[y * stride + x]; }},
        {"yuyv", PixelFormat::kYuyv, 2,
         [](const auto& raw, int stride, int x, int y) { return raw[y * stride + 2 * x]; }},
        {"y16", PixelFormat::kY16, 2,
         [](const auto& raw, int stride, int x, int y) { return raw[y * stride + 2 * x + 1]; }},
        {"y10", PixelFormat::kY10, 2,
         [](const auto& raw, int stride, int x, int y) {
           const int value = raw[y * stride + 2 * x] + 256 * raw[y * stride + 2 * x + 1];
           return std::min(value / 4, 255);
         }},
        {"nv12", PixelFormat::kNv12, 1,
         [](const auto& raw, int stride, int x, int y) { return raw[y * stride + x]; }},
        {"bayer8", PixelFormat::kBayer8, 1,
         [width](const auto& raw, int stride, int x, int y) {
           int sum = 8;
           for (int dy = -1; dy <= 1; ++dy) {
             for (int dx = -1; dx <= 1; ++dx) {
               sum += (2 - std::abs(dx)) * (2 - std::abs(dy)) *
                      raw[Mirror(y + dy, kHeight) * stride + Mirror(x + dx, width)];
             }
           }
           return sum / 16;
         }},
    };
  }
};

TEST_P(GreyTest, EveryPixelIsWhatTheFormatSays) {
  const int width = GetParam();
  for (const GreyCase& c : Cases(width)) {
    for (const int padding : {0, 6}) {
      const RawFormat format{c.format, width, kHeight, width * c.bytes_per_pixel + padding};
      auto converter = GreyConverter::Create(format);
      ASSERT_TRUE(converter) << c.name;
      const auto raw = RandomBytes(format.MinBytes(), 7 + static_cast<std::uint64_t>(width));
      // A byte on either side that must stay as it is.
      std::vector<std::uint8_t> grey(static_cast<std::size_t>(width) * kHeight + 2, 77);
      MallocTrap trap;
      ASSERT_TRUE(converter->Convert(raw, grey.data() + 1)) << c.name;
      EXPECT_EQ(trap.count(), 0u);
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < width; ++x) {
          ASSERT_EQ(grey[static_cast<std::size_t>(y * width + x + 1)],
                    c.expected(raw, format.stride_bytes, x, y))
              << c.name << " " << width << " at " << x << " " << y;
        }
      }
      EXPECT_EQ(grey.front(), 77);
      EXPECT_EQ(grey.back(), 77);
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Widths, GreyTest, ::testing::ValuesIn(kWidths));

TEST(GreyConverterTest, AShortImageIsRefusedAndNothingWritten) {
  const RawFormat format{PixelFormat::kYuyv, 16, 4, 40};
  auto converter = GreyConverter::Create(format);
  ASSERT_TRUE(converter);
  EXPECT_EQ(format.MinBytes(), 3u * 40 + 32);
  std::vector<std::uint8_t> grey(64, 5);
  const auto raw = RandomBytes(format.MinBytes() - 1, 1);
  const Status status = converter->Convert(raw, grey.data());
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, Errc::kNotEnoughData);
  EXPECT_TRUE(std::all_of(grey.begin(), grey.end(), [](std::uint8_t g) { return g == 5; }));
}

TEST(GreyConverterTest, ImpossibleFormatsAreRefused) {
  EXPECT_FALSE(GreyConverter::Create({PixelFormat::kGrey, 1, 4, 16}));
  EXPECT_FALSE(GreyConverter::Create({PixelFormat::kGrey, 16, 0, 16}));
  EXPECT_FALSE(GreyConverter::Create({PixelFormat::kYuyv, 16, 4, 31}));
  EXPECT_FALSE(GreyConverter::Create({PixelFormat::kAuto, 16, 4, 64}));
}

// A flat colour behind any order of filters has one grey: a quarter red and blue, half green.
TEST(GreyConverterTest, AFlatColourIsFlatBehindTheMosaic) {
  constexpr int kWidth = 20, kRows = 12;
  const int red = 200, green = 100, blue = 40;
  for (int order = 0; order < 4; ++order) {
    std::vector<std::uint8_t> raw;
    for (int y = 0; y < kRows; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const int phase = ((y + order / 2) % 2) * 2 + (x + order % 2) % 2;
        raw.push_back(static_cast<std::uint8_t>(phase == 0 ? red : phase == 3 ? blue : green));
      }
    }
    auto converter = GreyConverter::Create({PixelFormat::kBayer8, kWidth, kRows, kWidth});
    std::vector<std::uint8_t> grey(raw.size());
    ASSERT_TRUE(converter->Convert(raw, grey.data()));
    for (const std::uint8_t value : grey) EXPECT_EQ(value, (red + 2 * green + blue + 2) / 4);
  }
}

}  // namespace
}  // namespace rsfm
