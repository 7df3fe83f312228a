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

std::vector<std::uint8_t> Noisy() {
  Rng rng(5);
  std::vector<std::uint8_t> image = Smooth();
  for (auto& grey : image) grey = static_cast<std::uint8_t>(grey + rng.Uniform(-20.0, 20.0));
  return image;
}

// `image` with `count` bytes more before its end marker.
std::vector<std::uint8_t> Pad(std::vector<std::uint8_t> image, std::size_t count, int value) {
  image.insert(image.end() - 2, count, static_cast<std::uint8_t>(value));
  return image;
}

constexpr int kHeaderBytes = 400;  // and a bit: before the rows

class JpegDataTest : public ::testing::Test {
 protected:
  JpegDataTest() {
    auto encoder = JpegEncoder::Create(kWidth, kHeight);
    const auto encoded = encoder->Encode(Noisy().data(), kWidth, 80);
    data_.assign(encoded->begin(), encoded->end());
    EXPECT_TRUE(Decode(data_));
    whole_ = grey_;
  }
  bool Decode(const std::vector<std::uint8_t>& data) {
    grey_.assign(static_cast<std::size_t>(kWidth) * kHeight, 0);
    return decoder_->Decode(data, kWidth, kHeight, grey_.data()).has_value();
  }

  Expected<JpegDecoder> decoder_ = JpegDecoder::Create();
  std::vector<std::uint8_t> data_, grey_, whole_;
};

TEST_F(JpegDataTest, PaddingBeforeTheEndIsNoDamage) {
  for (const std::size_t count : {1u, 2u, 5u, 8u, 20u, 64u, 511u, 4096u}) {
    for (const int value : {0x00, 0xff, 0x55}) {
      EXPECT_TRUE(Decode(Pad(data_, count, value))) << count << " of " << value;
      EXPECT_EQ(grey_, whole_);
    }
  }
  // What follows the end is nobody's.
  std::vector<std::uint8_t> longer = Pad(data_, 64, 0);
  longer.insert(longer.end(), 300, 0xd9);
  EXPECT_TRUE(Decode(longer));
  EXPECT_TRUE(Decode(data_));
}

TEST_F(JpegDataTest, ACutOffImageIsRefusedWhateverItIsPaddedWith) {
  for (const std::size_t lost : {100u, 300u, 600u}) {
    ASSERT_LT(lost + kHeaderBytes, data_.size());
    std::vector<std::uint8_t> cut = data_;
    cut.erase(cut.end() - 2 - static_cast<std::ptrdiff_t>(lost), cut.end() - 2);
    EXPECT_FALSE(Decode(cut)) << lost;
    // Padding that is taken for rows must not make it whole.
    for (const int value : {0x00, 0x55})
      EXPECT_FALSE(Decode(Pad(cut, 4096, value))) << lost << " " << value;
  }
}

// Rows that lost their place leave codes over before the end, or run out of them. (Many flipped
// bits cannot be told from another picture: JPEG has no check sum.)
TEST_F(JpegDataTest, DamagedRowsThatShowAreRefusedPaddedOrNot) {
  std::vector<std::uint8_t> more = data_;
  more.insert(more.end() - 2, data_.end() - 60, data_.end() - 2);
  EXPECT_FALSE(Decode(more));
  Rng rng(11);
  int num_refused = 0, num_refused_padded = 0;
  for (int i = 0; i < 300; ++i) {
    std::vector<std::uint8_t> damaged = data_;
    const auto at = static_cast<std::size_t>(
        rng.Uniform(kHeaderBytes, static_cast<double>(damaged.size()) - 200.0));
    for (std::size_t k = 0; k < 8; ++k)
      damaged[at + k] = static_cast<std::uint8_t>(rng.Uniform(0.0, 254.9));
    if (Decode(damaged)) continue;
    ++num_refused;
    num_refused_padded += !Decode(Pad(damaged, 64, 0));
  }
  EXPECT_GT(num_refused, 100);
  EXPECT_EQ(num_refused_padded, num_refused);
}

// Without the segments of that marker before the rows.
std::vector<std::uint8_t> Without(std::uint8_t marker, const std::vector<std::uint8_t>& data) {
  std::vector<std::uint8_t> result(data.begin(), data.begin() + 2);
  std::size_t at = 2;
  while (data[at + 1] != 0xda) {
    const std::size_t next = at + 2 + 256u * data[at + 2] + data[at + 3];
    if (data[at + 1] != marker)
      result.insert(result.end(), data.begin() + static_cast<std::ptrdiff_t>(at),
                    data.begin() + static_cast<std::ptrdiff_t>(next));
    at = next;
  }
  result.insert(result.end(), data.begin() + static_cast<std::ptrdiff_t>(at), data.end());
  return result;
}

TEST_F(JpegDataTest, NoImageLivesOnTheTablesOfAnother) {
  ASSERT_TRUE(Decode(data_));
  const auto without_scales = Without(0xdb, data_);
  ASSERT_LT(without_scales.size(), data_.size());
  EXPECT_FALSE(Decode(without_scales));
  // Many cameras leave out the codes, and mean those of the standard [ITU-T T.81, K.3].
  const auto without_codes = Without(0xc4, data_);
  ASSERT_LT(without_codes.size(), data_.size());
  EXPECT_TRUE(Decode(without_codes));
  EXPECT_EQ(grey_, whole_);
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
