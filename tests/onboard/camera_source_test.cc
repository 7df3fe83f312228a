// The daemon's camera on a fake of the system calls: what its status and its log are told.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/drivers/fake_video.h"
#include "tools/onboard/frame_source.h"

namespace rsfm {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(CameraSourceTest, StatusAndLogHearWhatTheCameraRefuses) {
  FakeVideo video;
  video.controls = {{V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 500, 50}}};
  video.highest_rate_hz = 15.0;
  CaptureOptions options;
  options.frame_rate_hz = 30.0;
  CameraSource source(&video, options, 8, 6);
  FramePool pool(1, 48);
  Frame* frame = pool.Acquire();
  const auto next = [&] {
    for (int i = 0; i < 100; ++i)
      if (source.Next(frame) == FrameSource::Result::kFrame) return true;
    return false;
  };
  ASSERT_TRUE(next());
  EXPECT_EQ(frame->utime, frame->origin_us + video.utc_minus_monotonic_us);
  EXPECT_THAT(source.problem(), IsEmpty());
  EXPECT_THAT(source.TakeNews(),
              ElementsAre("/dev/video0: GREY 8 x 6, 15 images/s (30 asked for)"));
  EXPECT_THAT(source.TakeNews(), IsEmpty());
  // Away, and meanwhile it is asked for what it cannot do.
  video.is_present = false;
  EXPECT_EQ(source.Next(frame), FrameSource::Result::kNothing);
  EXPECT_THAT(source.problem(), HasSubstr(std::strerror(ENODEV)));
  options.exposure_us = 90'000.0;
  EXPECT_TRUE(source.ChangeControls(options));
  video.is_present = true;
  ASSERT_TRUE(next());
  EXPECT_THAT(source.problem(), HasSubstr("capture.exposure_us: 900 is beyond"));
  EXPECT_EQ(source.counters().restarts, 1);
  // Both at once.
  video.is_present = false;
  EXPECT_EQ(source.Next(frame), FrameSource::Result::kNothing);
  EXPECT_THAT(source.problem(),
              AllOf(HasSubstr("900 is beyond"), HasSubstr(std::strerror(ENODEV))));
  FramePool::Release(frame);
}

}  // namespace
}  // namespace rsfm
