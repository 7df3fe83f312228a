#include "rsfm_drivers/v4l2/frame_clock.h"

#include <gtest/gtest.h>

namespace rsfm {
namespace {

TEST(FrameClockTest, MidExposureOfGlobalAndRollingShutters) {
  CaptureOptions options;
  options.readout_us = 8000.0;
  EXPECT_EQ(MidExposureUs(StampKind::kStart, 100'000, 4000.0, options), 102'000);
  EXPECT_EQ(MidExposureUs(StampKind::kEnd, 100'000, 4000.0, options), 90'000);
  options.rolling_shutter = true;
  EXPECT_EQ(MidExposureUs(StampKind::kStart, 100'000, 4000.0, options), 106'000);
  EXPECT_EQ(MidExposureUs(StampKind::kEnd, 100'000, 4000.0, options), 94'000);
  EXPECT_EQ(MidExposureUs(StampKind::kNone, 100'000, 4000.0, options), 94'000);
  options.time_offset_us = -500.0;
  EXPECT_EQ(MidExposureUs(StampKind::kEnd, 100'000, 0.0, options), 95'500);
}

// Start and end of the same frame give the same middle.
TEST(FrameClockTest, BothStampsOfAFrameAgree) {
  for (const bool rolling : {false, true}) {
    CaptureOptions options;
    options.readout_us = 12'000.0;
    options.rolling_shutter = rolling;
    const double exposure_us = 5000.0;
    const std::int64_t start = 1'000'000, end = start + 5000 + 12'000;
    EXPECT_EQ(MidExposureUs(StampKind::kStart, start, exposure_us, options),
              MidExposureUs(StampKind::kEnd, end, exposure_us, options));
  }
}

TEST(ClockOffsetTest, FollowsADisciplinedClockSmoothlyAndASetClockAtOnce) {
  ClockOffset offset;
  EXPECT_FALSE(offset.is_known());
  const Utime utc = 1'700'000'000'000'000;
  offset.Track(1000, utc + 1010, 1020);
  EXPECT_EQ(offset.ToUtc(5000), utc + 5000);
  // 80 us off: an eighth of it is taken.
  offset.Track(2000, utc + 2010 + 80, 2020);
  EXPECT_EQ(offset.ToUtc(5000), utc + 5010);
  for (int i = 0; i < 60; ++i) offset.Track(2000, utc + 2010 + 80, 2020);
  EXPECT_NEAR(static_cast<double>(offset.ToUtc(5000) - utc), 5080.0, 1.0);
  EXPECT_EQ(offset.num_steps(), 0);
  offset.Track(3000, utc + 3'600'000'000, 3000);
  EXPECT_EQ(offset.ToUtc(3000), utc + 3'600'000'000);
  EXPECT_EQ(offset.num_steps(), 1);
  EXPECT_NEAR(static_cast<double>(offset.last_step_us()), 3.6e9, 5000.0);
  offset.Track(4000, utc + 4000, 4000);
  EXPECT_EQ(offset.ToUtc(5000), utc + 5000);
  EXPECT_EQ(offset.num_steps(), 2);
  EXPECT_NEAR(static_cast<double>(offset.last_step_us()), -3.6e9, 5000.0);
}

// On a busy machine a thread may lose the processor between two readings.
TEST(ClockOffsetTest, AReadingThatTookLongIsNoStep) {
  ClockOffset offset;
  const Utime utc = 1'700'000'000'000'000;
  offset.Track(1000, utc + 1000, 1000);
  offset.Track(2000, utc + 2000, 62'000);  // UTC was read at once, then 60 ms passed: 30 ms off
  EXPECT_EQ(offset.num_steps(), 0);
  EXPECT_EQ(offset.ToUtc(5000), utc + 5000);
  offset.Track(70'000, utc + 170'000, 130'000);  // a step of 70 to 130 ms all the same
  EXPECT_EQ(offset.num_steps(), 1);
}

TEST(FrameClockTest, StampsThatCannotBeAreNone) {
  EXPECT_TRUE(IsPlausibleStamp(1'000'000, 1'040'000));
  EXPECT_TRUE(IsPlausibleStamp(1'040'000, 1'000'000));  // a frame ahead
  EXPECT_FALSE(IsPlausibleStamp(1'600'000, 1'000'000));
  EXPECT_FALSE(IsPlausibleStamp(1'000'000, 12'000'000));
  EXPECT_FALSE(IsPlausibleStamp(0, 1000));
  EXPECT_FALSE(IsPlausibleStamp(-5, 1000));
}

}  // namespace
}  // namespace rsfm
