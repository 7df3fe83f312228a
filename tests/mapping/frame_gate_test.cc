#include "rsfm/mapping/frame_gate.h"
#include "rsfm/base/plausible_time.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "tests/mapping/blob_image.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr int kWidth = BlobImage::kWidth, kHeight = BlobImage::kHeight;
constexpr Utime kSecond = 1'000'000;

// An image of its own for every index: noise, as a camera's.
std::vector<std::uint8_t> Shot(int index) {
  static const BlobImage texture = BlobImage::Texture(Vec2::Zero());
  Rng rng(static_cast<std::uint64_t>(100 + index));
  std::vector<std::uint8_t> bytes(texture.View().data, texture.View().data + kWidth * kHeight);
  for (std::uint8_t& value : bytes)
    value = static_cast<std::uint8_t>(std::clamp(value + rng.Uniform(-3.0, 3.0), 0.0, 255.0));
  return bytes;
}

ImageView View(const std::vector<std::uint8_t>& bytes) {
  return {bytes.data(), kWidth, kHeight, kWidth, 1};
}

TEST(FrameGate, LetsGoodImagesThrough) {
  FrameGate gate(kWidth, kHeight);
  for (int i = 0; i < 5; ++i)
    EXPECT_EQ(gate.Check(View(Shot(i)), i * kSecond), FrameVerdict::kGood) << i;
  EXPECT_EQ(gate.count(FrameVerdict::kGood), 5);
}

TEST(FrameGate, TimesMustIncrease) {
  FrameGate gate(kWidth, kHeight);
  EXPECT_EQ(gate.Check(View(Shot(0)), 10 * kSecond), FrameVerdict::kGood);
  EXPECT_EQ(gate.Check(View(Shot(1)), 10 * kSecond), FrameVerdict::kRepeatedTime);
  EXPECT_EQ(gate.Check(View(Shot(2)), 9 * kSecond), FrameVerdict::kOutOfOrder);
  EXPECT_EQ(gate.Check(View(Shot(3)), 10 * kSecond + 1), FrameVerdict::kGood);
  EXPECT_EQ(gate.count(FrameVerdict::kRepeatedTime), 1);
  EXPECT_EQ(gate.count(FrameVerdict::kOutOfOrder), 1);
}

TEST(FrameGate, WhatIsNoTimeIsRefusedHoweverOftenItComes) {
  FrameGate gate(kWidth, kHeight);
  for (int i = 0; i < 4; ++i)
    for (const Utime no_time : {std::numeric_limits<Utime>::min(), kMaxUtime + 1 + i}) {
      gate.SeeTime(no_time);
      EXPECT_EQ(gate.Check(View(Shot(i)), no_time), FrameVerdict::kFromTheFuture);
    }
  EXPECT_EQ(gate.Check(View(Shot(5)), 10 * kSecond), FrameVerdict::kGood);
}

// One stamp from the future must not lock out all that follow.
TEST(FrameGate, OneTimeFromTheFutureIsNotBelieved) {
  FrameGate gate(kWidth, kHeight);
  EXPECT_EQ(gate.Check(View(Shot(0)), 10 * kSecond), FrameVerdict::kGood);
  EXPECT_EQ(gate.Check(View(Shot(1)), 4000 * kSecond), FrameVerdict::kFromTheFuture);
  EXPECT_EQ(gate.Check(View(Shot(2)), 11 * kSecond), FrameVerdict::kGood);
  EXPECT_EQ(gate.Check(View(Shot(3)), 4001 * kSecond), FrameVerdict::kFromTheFuture);
  EXPECT_EQ(gate.Check(View(Shot(4)), 12 * kSecond), FrameVerdict::kGood);
  // The camera was off for an hour: the third image on the new time is believed.
  EXPECT_EQ(gate.Check(View(Shot(5)), 4010 * kSecond), FrameVerdict::kFromTheFuture);
  EXPECT_EQ(gate.Check(View(Shot(6)), 4011 * kSecond), FrameVerdict::kFromTheFuture);
  EXPECT_EQ(gate.Check(View(Shot(7)), 4012 * kSecond), FrameVerdict::kGood);
  EXPECT_EQ(gate.count(FrameVerdict::kFromTheFuture), 4);
  // Or navigation went on all the while: the first.
  gate.SeeTime(9000 * kSecond);
  EXPECT_EQ(gate.Check(View(Shot(8)), 9001 * kSecond), FrameVerdict::kGood);
  // A first image must fit to navigation, too.
  FrameGate fresh(kWidth, kHeight);
  fresh.SeeTime(100 * kSecond);
  EXPECT_EQ(fresh.Check(View(Shot(0)), 90000 * kSecond), FrameVerdict::kFromTheFuture);
  EXPECT_EQ(fresh.Check(View(Shot(1)), 101 * kSecond), FrameVerdict::kGood);
}

// A first stamp an hour ahead, or a clock that is set back: what comes then is the time, once it has
// gone on for a while. Buffers that come late do not go on, or stand among those that are good.
TEST(FrameGate, AClockThatIsSetBackIsFollowed) {
  FrameGate gate(kWidth, kHeight);
  gate.SeeTime(4000 * kSecond);
  EXPECT_EQ(gate.Check(View(Shot(0)), 4000 * kSecond), FrameVerdict::kGood);
  for (int i = 1; i <= 5; ++i)
    EXPECT_EQ(gate.Check(View(Shot(i)), (10 + i) * kSecond), FrameVerdict::kOutOfOrder) << i;
  EXPECT_FALSE(gate.was_set_back());
  EXPECT_EQ(gate.Check(View(Shot(6)), 16 * kSecond), FrameVerdict::kGood);
  EXPECT_TRUE(gate.was_set_back());
  EXPECT_EQ(gate.Check(View(Shot(7)), 17 * kSecond), FrameVerdict::kGood);
  EXPECT_FALSE(gate.was_set_back());
  // The old time is from the future now.
  EXPECT_EQ(gate.Check(View(Shot(8)), 4001 * kSecond), FrameVerdict::kFromTheFuture);
}

TEST(FrameGate, ImagesThatComeLateSetNoClockBack) {
  FrameGate gate(kWidth, kHeight);
  EXPECT_EQ(gate.Check(View(Shot(0)), 100 * kSecond), FrameVerdict::kGood);
  for (int i = 1; i <= 40; ++i) {  // one old one after each good one
    EXPECT_EQ(gate.Check(View(Shot(2 * i)), (50 + i) * kSecond), FrameVerdict::kOutOfOrder) << i;
    EXPECT_EQ(gate.Check(View(Shot(2 * i + 1)), (100 + i) * kSecond), FrameVerdict::kGood) << i;
  }
  for (int i = 0; i < 40; ++i) {  // or the same few again and again
    EXPECT_EQ(gate.Check(View(Shot(i)), (50 + i % 4) * kSecond), FrameVerdict::kOutOfOrder) << i;
  }
  EXPECT_EQ(gate.Check(View(Shot(99)), 141 * kSecond), FrameVerdict::kGood);
  EXPECT_FALSE(gate.was_set_back());
}

TEST(FrameGate, WhatIsNoImageOfTheCamera) {
  FrameGate gate(kWidth, kHeight);
  const std::vector<std::uint8_t> bytes = Shot(0);
  ImageView view = View(bytes);
  view.height -= 8;
  EXPECT_EQ(gate.Check(view, 1), FrameVerdict::kWrongSize);
  view = View(bytes);
  view.data = nullptr;
  EXPECT_EQ(gate.Check(view, 2), FrameVerdict::kNoImage);
  view = View(bytes);
  view.channels = 2;
  EXPECT_EQ(gate.Check(view, 3), FrameVerdict::kNoImage);
  view = View(bytes);
  view.stride_bytes = kWidth - 1;
  EXPECT_EQ(gate.Check(view, 4), FrameVerdict::kNoImage);
  // None of these times was taken.
  EXPECT_EQ(gate.Check(View(bytes), 1), FrameVerdict::kGood);
}

TEST(FrameGate, ImagesThatShowNothing) {
  FrameGate gate(kWidth, kHeight);
  Utime utime = 0;
  const auto check = [&](const std::vector<std::uint8_t>& bytes) {
    return gate.Check(View(bytes), ++utime * kSecond);
  };
  std::vector<std::uint8_t> bytes(kWidth * kHeight, 0);
  EXPECT_EQ(check(bytes), FrameVerdict::kBlack);  // the very first
  const std::vector<std::uint8_t> good = Shot(0);
  EXPECT_EQ(check(good), FrameVerdict::kGood);
  EXPECT_EQ(check(good), FrameVerdict::kDuplicate);
  // A lens cap: the noise of the sensor alone.
  Rng rng(1);
  for (std::uint8_t& value : bytes) value = static_cast<std::uint8_t>(rng.Uniform(0.0, 7.0));
  EXPECT_EQ(check(bytes), FrameVerdict::kBlack);
  std::fill(bytes.begin(), bytes.end(), std::uint8_t{255});
  for (int i = 0; i < 500; ++i) bytes[static_cast<std::size_t>(137 * i)] = 30;  // dead pixels
  EXPECT_EQ(check(bytes), FrameVerdict::kWhite);
  std::fill(bytes.begin(), bytes.end(), std::uint8_t{130});
  EXPECT_EQ(check(bytes), FrameVerdict::kFlat);
  EXPECT_EQ(check(good), FrameVerdict::kDuplicate);  // still that of the last good one
  EXPECT_EQ(check(Shot(1)), FrameVerdict::kGood);
  EXPECT_EQ(gate.count(FrameVerdict::kDuplicate), 2);
}

TEST(FrameGate, HalfTorn) {
  FrameGate gate(kWidth, kHeight);
  Utime utime = 0;
  const std::vector<std::uint8_t> first = Shot(0);
  EXPECT_EQ(gate.Check(View(first), ++utime), FrameVerdict::kGood);
  // Never filled, or filled from the image before; below or above; a half or a sixth.
  for (const int rows : {kHeight / 2, kHeight / 6}) {
    for (const bool is_below : {true, false}) {
      for (const int fill : {0, 128, -1}) {
        std::vector<std::uint8_t> torn = Shot(1);
        const int begin = (is_below ? kHeight - rows : 0) * kWidth;
        for (int i = begin; i < begin + rows * kWidth; ++i) {
          const auto k = static_cast<std::size_t>(i);
          torn[k] = fill >= 0 ? static_cast<std::uint8_t>(fill) : first[k];
        }
        EXPECT_EQ(gate.Check(View(torn), ++utime), FrameVerdict::kTorn) << rows << " " << fill;
        EXPECT_EQ(gate.Check(View(first), ++utime), FrameVerdict::kDuplicate);
      }
    }
  }
  EXPECT_EQ(gate.count(FrameVerdict::kTorn), 12);
  EXPECT_EQ(gate.Check(View(Shot(2)), ++utime), FrameVerdict::kGood);
}

// Black bars that are always there tear nothing; bars that come and stay are taken in the end.
TEST(FrameGate, BarsOfTheCameraAreNoTear) {
  const auto with_bar = [](int index) {
    std::vector<std::uint8_t> bytes = Shot(index);
    std::fill(bytes.begin(), bytes.begin() + kWidth * kHeight / 3, std::uint8_t{0});
    return bytes;
  };
  FrameGate gate(kWidth, kHeight);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(gate.Check(View(with_bar(i)), i), FrameVerdict::kGood) << i;
  FrameGate other(kWidth, kHeight);
  EXPECT_EQ(other.Check(View(Shot(0)), 1), FrameVerdict::kGood);
  for (int i = 1; i <= 8; ++i)
    EXPECT_EQ(other.Check(View(with_bar(i)), 1 + i), FrameVerdict::kTorn) << i;
  EXPECT_EQ(other.Check(View(with_bar(9)), 10), FrameVerdict::kGood);
  EXPECT_EQ(other.Check(View(with_bar(10)), 11), FrameVerdict::kGood);
}

TEST(FrameGate, TakesNoMemory) {
  FrameGate gate(kWidth, kHeight);
  const std::vector<std::uint8_t> bytes = Shot(0);
  const MallocTrap trap;
  EXPECT_EQ(gate.Check(View(bytes), 1), FrameVerdict::kGood);
  EXPECT_EQ(gate.Check(View(bytes), 2), FrameVerdict::kDuplicate);
  EXPECT_EQ(trap.count(), 0u);
}

}  // namespace
}  // namespace rsfm
