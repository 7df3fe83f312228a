#include "rsfm/mapping/patch_describer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "rsfm/mapping/descriptor_matcher.h"
#include "tests/mapping/blob_image.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr int kWidth = BlobImage::kWidth, kHeight = BlobImage::kHeight;
const Vec2 kCentre(240.0, 160.0);

// A texture turned about the image's centre, then moved; its light changed.
ImagePyramid Draw(double angle, const Vec2& shift, double gain) {
  static const BlobImage texture = BlobImage::Texture(Vec2::Zero());
  const Eigen::Rotation2Dd turn(angle);
  std::vector<double> light(kWidth * kHeight, 110.0);
  for (const Blob& blob : texture.blobs()) {
    const Vec2 at = turn * (blob.pixel - kCentre) + kCentre + shift;
    const int reach = static_cast<int>(4.0 * blob.sigma_px) + 1;
    const int cx = static_cast<int>(at.x()), cy = static_cast<int>(at.y());
    for (int y = std::max(0, cy - reach); y < std::min(kHeight, cy + reach); ++y) {
      for (int x = std::max(0, cx - reach); x < std::min(kWidth, cx + reach); ++x) {
        const double squared = (Vec2(x + 0.5, y + 0.5) - at).squaredNorm();
        light[static_cast<std::size_t>(y * kWidth + x)] +=
            gain * blob.height * std::exp(-0.5 * squared / (blob.sigma_px * blob.sigma_px));
      }
    }
  }
  std::vector<std::uint8_t> bytes;
  for (const double value : light)
    bytes.push_back(static_cast<std::uint8_t>(std::clamp(value + 0.5, 0.0, 255.0)));
  ImagePyramid pyramid(kWidth, kHeight, 1, PatchDescriber::kBorderPx);
  pyramid.Build(bytes.data(), kWidth);
  return pyramid;
}

// Places in a ring about the centre: they stay in the image however it is turned.
std::vector<Vec2> Places() {
  std::vector<Vec2> places;
  for (int y = 60; y <= 260; y += 20) {
    for (int x = 140; x <= 340; x += 20) {
      if ((Vec2(x, y) - kCentre).norm() < 110.0) places.push_back(Vec2(x, y));
    }
  }
  return places;
}

std::vector<std::uint8_t> Describe(const ImagePyramid& image, double angle, const Vec2& shift) {
  PatchDescriber describer;
  std::vector<std::uint8_t> rows;
  for (const Vec2& place : Places()) {
    const Vec2 at =
        Eigen::Rotation2Dd(angle) * (place - kCentre) + kCentre + shift - Vec2::Constant(0.5);
    rows.resize(rows.size() + 128);
    describer.Describe(image.level(0), {static_cast<float>(at.x()), static_cast<float>(at.y())},
                       rows.data() + rows.size() - 128);
  }
  return rows;
}

TEST(PatchDescriber, KnowsAPatchAgainWhereverItLiesAndHoweverItIsLit) {
  const std::vector<std::uint8_t> first = Describe(Draw(0.0, Vec2::Zero(), 1.0), 0.0, Vec2::Zero());
  const auto count = static_cast<int>(Places().size());
  for (const double angle : {0.0, 0.4, 1.7, 3.0, -2.2}) {
    const Vec2 shift(6.3, -4.6);
    const double gain = angle == 0.0 ? 0.6 : 1.0;
    const std::vector<std::uint8_t> second = Describe(Draw(angle, shift, gain), angle, shift);
    DescriptorMatcher matcher(count);
    std::vector<DescriptorMatch> matches(static_cast<std::size_t>(count));
    const int found = matcher.Match({first.data(), count, DescriptorType::kSift},
                                    {second.data(), count, DescriptorType::kSift}, 0.85, matches);
    int right = 0;
    for (int k = 0; k < found; ++k)
      right +=
          matches[static_cast<std::size_t>(k)].query == matches[static_cast<std::size_t>(k)].train;
    EXPECT_GE(right, count * 85 / 100) << angle << " of " << count;
    EXPECT_LE(found - right, 2) << angle;
  }
}

TEST(PatchDescriber, LengthIsThatOfRootSiftAndFlatIsZero) {
  const std::vector<std::uint8_t> rows = Describe(Draw(0.0, Vec2::Zero(), 1.0), 0.0, Vec2::Zero());
  for (std::size_t row = 0; row < rows.size(); row += 128) {
    double squares = 0.0;
    for (std::size_t k = row; k < row + 128; ++k) squares += rows[k] * rows[k];
    EXPECT_NEAR(std::sqrt(squares), 512.0, 8.0);
  }
  for (const std::uint8_t value : Describe(Draw(0.0, Vec2::Zero(), 0.0), 0.0, Vec2::Zero()))
    EXPECT_EQ(value, 0);
}

TEST(PatchDescriber, WorksAtTheImagesEdgeAndTakesNoMemory) {
  const ImagePyramid image = Draw(0.0, Vec2::Zero(), 1.0);
  PatchDescriber describer;
  std::uint8_t row[128];
  const MallocTrap trap;
  for (const PatchPlace& at : {PatchPlace{0.0f, 0.0f}, {479.4f, 319.4f}, {0.0f, 319.0f}}) {
    describer.Describe(image.level(0), at, row);
    EXPECT_GT(*std::max_element(row, row + 128), 0);
  }
  EXPECT_EQ(trap.count(), 0u);
}

}  // namespace
}  // namespace rsfm
