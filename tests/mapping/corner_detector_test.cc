#include "rsfm/mapping/corner_detector.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/mapping/blob_image.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

ImagePyramid PyramidOf(const std::vector<std::uint8_t>& image, int width, int height) {
  ImagePyramid pyramid(width, height, 1, CornerDetector::kBorderPx);
  pyramid.Build(image.data(), width);
  return pyramid;
}

// The score at a pixel, by its definition.
double PlainScore(const PyramidLevel& image, int x, int y) {
  double xx = 0.0, xy = 0.0, yy = 0.0;
  const auto at = [&](int u, int v) {
    return static_cast<double>(image.origin[v * image.stride_bytes + u]);
  };
  for (int v = y - 2; v <= y + 2; ++v) {
    for (int u = x - 2; u <= x + 2; ++u) {
      const double gx = 0.5 * (at(u + 1, v) - at(u - 1, v));
      const double gy = 0.5 * (at(u, v + 1) - at(u, v - 1));
      xx += gx * gx / 25.0;
      xy += gx * gy / 25.0;
      yy += gy * gy / 25.0;
    }
  }
  return 0.5 * (xx + yy - std::hypot(xx - yy, 2.0 * xy));
}

TEST(CornerDetector, FindsTheMaximaOfItsScore) {
  BlobImage image = BlobImage::Texture(Vec2::Zero());
  const ImagePyramid pyramid = PyramidOf(image.bytes(), BlobImage::kWidth, BlobImage::kHeight);
  CornerDetector detector(200);
  for (const ImagePart& part :
       {ImagePart{100, 60, 300, 130}, {0, 0, 64, 64}, {416, 256, 480, 320}}) {
    std::vector<Corner> corners(400);
    const int count = detector.Detect(pyramid.level(0), part, 1.0f, corners);
    ASSERT_GT(count, 5);
    // In single precision, and with fused products on some processors, what is nearly equal may be
    // either.
    constexpr double kNearly = 1e-4;
    int surely = 0, perhaps = 0;
    for (int y = part.top; y < part.bottom; ++y) {
      for (int x = part.left; x < part.right; ++x) {
        const double score = PlainScore(pyramid.level(0), x, y);
        double most_beside = 1.0;
        for (int k = 0; k < 9; ++k)
          if (k != 4)
            most_beside =
                std::max(most_beside, PlainScore(pyramid.level(0), x + k % 3 - 1, y + k / 3 - 1));
        surely += score > (1.0 + kNearly) * most_beside ? 1 : 0;
        perhaps += score > (1.0 - kNearly) * most_beside ? 1 : 0;
      }
    }
    EXPECT_GE(count, surely);
    EXPECT_LE(count, perhaps);
    EXPECT_LE(perhaps - surely, 2 + surely / 20);
    for (int i = 0; i < count; ++i) {
      const Corner& corner = corners[static_cast<std::size_t>(i)];
      if (i > 0) {
        EXPECT_LE(corner.score, corners[static_cast<std::size_t>(i - 1)].score);
      }
      const auto x = static_cast<int>(std::lround(corner.x)),
                 y = static_cast<int>(std::lround(corner.y));
      EXPECT_NEAR(corner.score, PlainScore(pyramid.level(0), x, y), 1e-3 * corner.score);
    }
    // With less room: the best of the same.
    std::vector<Corner> best(5);
    ASSERT_EQ(detector.Detect(pyramid.level(0), part, 1.0f, best), 5);
    for (std::size_t i = 0; i < best.size(); ++i) EXPECT_EQ(best[i].score, corners[i].score);
  }
}

// A texture moved by parts of a pixel takes its corners along.
TEST(CornerDetector, InterpolatesBetweenPixels) {
  const Vec2 shift(0.5, 0.3);
  BlobImage first = BlobImage::Texture(Vec2::Zero()), second = BlobImage::Texture(shift);
  CornerDetector detector(400);
  std::vector<Corner> before(60), after(400);
  const auto detect = [&](BlobImage& image, std::vector<Corner>& corners) {
    const ImagePyramid pyramid = PyramidOf(image.bytes(), BlobImage::kWidth, BlobImage::kHeight);
    const int count = detector.Detect(pyramid.level(0), {40, 40, 440, 280}, 1.0f, corners);
    corners.resize(static_cast<std::size_t>(count));
  };
  detect(first, before);
  detect(second, after);
  ASSERT_EQ(before.size(), 60u);
  std::vector<double> errors;
  for (const Corner& corner : before) {
    double nearest = 1e9;
    for (const Corner& other : after)
      nearest = std::min(
          nearest, std::hypot(other.x - corner.x - shift.x(), other.y - corner.y - shift.y()));
    errors.push_back(nearest);
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[30], 0.25);  // whole pixels: 0.58
}

TEST(CornerDetector, EdgesAndFlatPlacesAreNone) {
  constexpr int kSize = 64;
  std::vector<std::uint8_t> image(kSize * kSize, 77);
  CornerDetector detector(kSize);
  std::vector<Corner> corners(10);
  EXPECT_EQ(
      detector.Detect(PyramidOf(image, kSize, kSize).level(0), {0, 0, kSize, kSize}, 0.1f, corners),
      0);
  for (std::size_t i = 0; i < image.size(); ++i) image[i] = i % kSize < 30 ? 40 : 200;
  const ImagePyramid edge = PyramidOf(image, kSize, kSize);
  EXPECT_EQ(detector.Detect(edge.level(0), {0, 0, kSize, kSize}, 0.1f, corners), 0);
  EXPECT_EQ(detector.Detect(edge.level(0), {0, 0, kSize, kSize}, 0.1f, {}), 0);
  EXPECT_EQ(detector.Detect(edge.level(0), {9, 9, 9, 20}, 0.1f, corners), 0);
}

TEST(CornerDetector, TakesNoMemory) {
  BlobImage image = BlobImage::Texture(Vec2::Zero());
  const ImagePyramid pyramid = PyramidOf(image.bytes(), BlobImage::kWidth, BlobImage::kHeight);
  CornerDetector detector(64);
  std::vector<Corner> corners(20);
  const MallocTrap trap;
  EXPECT_GT(detector.Detect(pyramid.level(0), {64, 64, 128, 128}, 1.0f, corners), 3);
  EXPECT_EQ(trap.count(), 0u);
}

}  // namespace
}  // namespace rsfm
