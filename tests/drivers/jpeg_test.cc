#include "rsfm_drivers/jpeg/jpeg.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "rsfm/base/rng.h"

namespace rsfm {
namespace {

constexpr int kWidth = 64, kHeight = 48;

std::vector<std::uint8_t> Smooth() {
  std::vector<std::uint8_t> image;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x)
      image.push_back(static_cast<std::uint8_t>(128 + 60 * std::sin(0.2 * x) * std::cos(0.15 * y)));
  }
  return image;
}

TEST(JpegTest, WhatIsEncodedDecodesNearlyTheSame) {
  const auto image = Smooth();
  auto encoder = JpegEncoder::Create(kWidth, kHeight);
  auto decoder = JpegDecoder::Create();
  ASSERT_TRUE(encoder && decoder);
  const auto data = encoder->Encode(image.data(), kWidth, 95);
  ASSERT_TRUE(data);
  EXPECT_LT(data->size(), image.size());
  std::vector<std::uint8_t> back(image.size());
  ASSERT_TRUE(decoder->Decode(*data, kWidth, kHeight, back.data()));
  for (std::size_t i = 0; i < image.size(); ++i) EXPECT_NEAR(back[i], image[i], 6) << i;
}

TEST(JpegTest, AnotherSizeIsRefusedAndNothingWritten) {
  const auto image = Smooth();
  auto encoder = JpegEncoder::Create(kWidth, kHeight);
  auto decoder = JpegDecoder::Create();
  const auto data = encoder->Encode(image.data(), kWidth, 80);
  std::vector<std::uint8_t> back(image.size(), 9);
  const Status status = decoder->Decode(*data, kHeight, kWidth, back.data());
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, Errc::kInvalidArgument);
  EXPECT_EQ(back, std::vector<std::uint8_t>(image.size(), 9));
}

TEST(JpegTest, EveryCutAndRandomBytesAreErrors) {
  const auto image = Smooth();
  auto encoder = JpegEncoder::Create(kWidth, kHeight);
  auto decoder = JpegDecoder::Create();
  const auto data = encoder->Encode(image.data(), kWidth, 80);
  std::vector<std::uint8_t> back(image.size());
  for (std::size_t size = 0; size + 2 < data->size(); size += 7)
    EXPECT_FALSE(decoder->Decode(data->first(size), kWidth, kHeight, back.data())) << size;
  Rng rng(3);
  for (int i = 0; i < 50; ++i) {
    std::vector<std::uint8_t> noise(200);
    for (auto& byte : noise) byte = static_cast<std::uint8_t>(rng.Uniform(0.0, 255.99));
    EXPECT_FALSE(decoder->Decode(noise, kWidth, kHeight, back.data()));
  }
  // The decoder goes on with the next good one.
  EXPECT_TRUE(decoder->Decode(*data, kWidth, kHeight, back.data()));
}

TEST(JpegTest, ImpossibleRequestsAreRefused) {
  EXPECT_FALSE(JpegEncoder::Create(0, 10));
  EXPECT_FALSE(JpegEncoder::Create(10, 70000));
  auto encoder = JpegEncoder::Create(kWidth, kHeight);
  EXPECT_FALSE(encoder->Encode(Smooth().data(), kWidth, 0));
  EXPECT_FALSE(encoder->Encode(Smooth().data(), kWidth, 101));
}

}  // namespace
}  // namespace rsfm
