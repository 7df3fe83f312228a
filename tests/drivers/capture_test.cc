// A camera that fails, vanishes and returns, on a fake of the system calls with its own clock.
#include "rsfm_drivers/v4l2/capture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/drivers/fake_video.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Result = Capture::Result;

class CaptureTest : public ::testing::Test {
 protected:
  Capture Make() { return Capture(&video_, options_, 8, 6); }
  // The next frame, however many calls that takes; kDown or kNothing after too many.
  Result NextFrame(Capture* capture, int max_calls = 200) {
    Result result = Result::kNothing;
    for (int i = 0; i < max_calls && result != Result::kFrame; ++i)
      result = capture->Next(100, grey_, &frame_);
    return result;
  }

  FakeVideo video_;
  CaptureOptions options_;
  std::uint8_t grey_[48] = {};
  CapturedFrame frame_;
};

TEST_F(CaptureTest, FramesComeWithPixelsAndTime) {
  video_.controls = {{V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 500, 50}}};
  video_.stamp_delay_us = 3000;
  options_.readout_us = 10'000.0;
  Capture capture = Make();
  for (std::uint32_t i = 0; i < 5; ++i) {
    ASSERT_EQ(NextFrame(&capture), Result::kFrame);
    EXPECT_EQ(frame_.sequence, i);
    EXPECT_EQ(grey_[0], i);
    EXPECT_EQ(grey_[47], i);
    EXPECT_EQ(frame_.mid_exposure_us, video_.now_us - 3000 - 10'000 - 2500);
    EXPECT_EQ(frame_.utime, frame_.mid_exposure_us + video_.utc_minus_monotonic_us);
  }
  EXPECT_EQ(capture.counters().frames, 5);
  EXPECT_EQ(capture.counters().missed, 0);
  EXPECT_EQ(video_.num_opens, 1);
}

TEST_F(CaptureTest, StampKinds) {
  video_.stamp_delay_us = 5000;
  video_.stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  options_.readout_us = 2000.0;
  Capture start = Make();
  ASSERT_EQ(NextFrame(&start), Result::kFrame);
  EXPECT_EQ(frame_.mid_exposure_us, video_.now_us - 5000);
  video_.stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN;
  Capture unknown = Make();
  ASSERT_EQ(NextFrame(&unknown), Result::kFrame);
  EXPECT_EQ(frame_.mid_exposure_us, video_.now_us - 2000);
  video_.stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_COPY;
  Capture copied = Make();
  ASSERT_EQ(NextFrame(&copied), Result::kFrame);
  EXPECT_EQ(frame_.mid_exposure_us, video_.now_us - 2000);
  EXPECT_EQ(copied.counters().bad_stamps, 0);
  video_.stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
  video_.stamp_delay_us = -60'000'000;  // a minute ahead
  Capture wrong = Make();
  ASSERT_EQ(NextFrame(&wrong), Result::kFrame);
  EXPECT_EQ(frame_.mid_exposure_us, video_.now_us - 2000);
  EXPECT_EQ(wrong.counters().bad_stamps, 1);
}

TEST_F(CaptureTest, GapsAreCountedAndNewStartsAreNot) {
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  video_.skip = 4;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(capture.counters().missed, 4);
  video_.is_present = false;
  EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kDown);
  video_.is_present = true;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(frame_.sequence, 0u);
  EXPECT_EQ(capture.counters().missed, 4);
  EXPECT_EQ(capture.counters().restarts, 1);
}

TEST_F(CaptureTest, DamagedFramesAreCountedAndNotHandedOut) {
  Capture capture = Make();
  video_.frame_flags = {V4L2_BUF_FLAG_ERROR, 0, V4L2_BUF_FLAG_ERROR};
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(frame_.sequence, 1u);
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(frame_.sequence, 3u);
  EXPECT_EQ(capture.counters().damaged, 2);
  video_.fill = [](std::uint32_t, std::uint8_t*, std::size_t* bytes) { *bytes -= 1; };
  EXPECT_EQ(NextFrame(&capture, 3), Result::kNothing);
  EXPECT_EQ(capture.counters().damaged, 5);
  EXPECT_EQ(capture.counters().missed, 0);
}

TEST_F(CaptureTest, SingleIoErrorsAreSurvivedAndManyReopen) {
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  video_.dequeue_errors = {EIO, EIO};
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(capture.counters().io_errors, 2);
  EXPECT_EQ(video_.num_opens, 1);
  video_.dequeue_errors.assign(Capture::kMaxIoErrors, EIO);
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(video_.num_opens, 2);
  EXPECT_EQ(capture.counters().restarts, 1);
  EXPECT_EQ(capture.counters().io_errors, 2 + Capture::kMaxIoErrors);
}

TEST_F(CaptureTest, AVanishedDeviceIsTriedAgainWithBackOff) {
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  const Utime last = frame_.utime;
  video_.is_present = false;
  EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kDown);
  ASSERT_TRUE(capture.last_problem());
  EXPECT_THAT(ToString(*capture.last_problem()), HasSubstr("VIDIOC_DQBUF"));
  EXPECT_THAT(ToString(*capture.last_problem()), HasSubstr(std::strerror(ENODEV)));
  EXPECT_EQ(video_.num_open, 0);
  // A minute away: 0.1 + 0.2 + 0.4 + ... + 3.2 s, then every 5 s. A caller gets control back
  // within his time-out.
  const std::int64_t start_us = video_.now_us;
  const auto opens = [&] {
    int count = 0;
    std::string before;
    while (video_.now_us - start_us < 60'000'000) {
      const std::int64_t call_us = video_.now_us;
      EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kDown);
      EXPECT_LE(video_.now_us - call_us, 100'000);
      if (ToString(*capture.last_problem()).find("open the camera") != std::string::npos) ++count;
    }
    return count;
  }();
  EXPECT_GT(opens, 0);
  EXPECT_THAT(ToString(*capture.last_problem()), HasSubstr("cannot open the camera"));
  video_.is_present = true;
  const std::int64_t back_us = video_.now_us;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_LE(video_.now_us - back_us, Capture::kLastRetryUs + 300'000);
  EXPECT_GT(frame_.utime, last);
  EXPECT_FALSE(capture.last_problem());
  // A good frame ends the back-off.
  video_.is_present = false;
  EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kDown);
  video_.is_present = true;
  const std::int64_t again_us = video_.now_us;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_LE(video_.now_us - again_us, Capture::kFirstRetryUs + 300'000);
}

TEST_F(CaptureTest, AStuckDeviceIsOpenedAgain) {
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  video_.is_silent = true;
  const std::int64_t start_us = video_.now_us;
  Result result = Result::kNothing;
  while (result == Result::kNothing) result = capture.Next(100, grey_, &frame_);
  EXPECT_EQ(result, Result::kDown);
  EXPECT_NEAR(static_cast<double>(video_.now_us - start_us), 1e6, 1e5);
  EXPECT_THAT(ToString(*capture.last_problem()), HasSubstr("no whole frame for"));
  video_.is_silent = false;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(video_.num_opens, 2);
}

TEST_F(CaptureTest, ASlowTriggerHasTheTimeItIsGiven) {
  options_.watchdog_s = 30.0;
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  video_.is_silent = true;
  for (int i = 0; i < 250; ++i) EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kNothing);
  video_.is_silent = false;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(video_.num_opens, 1);
}

TEST_F(CaptureTest, StreamOnFailsAndRecovers) {
  for (const int error : {EIO, ENOSPC}) {
    video_.failing = {{VIDIOC_STREAMON, error}};
    Capture capture = Make();
    EXPECT_EQ(NextFrame(&capture, 5), Result::kDown);
    EXPECT_THAT(ToString(*capture.last_problem()), HasSubstr("VIDIOC_STREAMON"));
    EXPECT_EQ(video_.num_open, 0);
    video_.failing.clear();
    EXPECT_EQ(NextFrame(&capture), Result::kFrame);
    EXPECT_EQ(capture.counters().restarts, 0);  // it had not been open before
  }
}

TEST_F(CaptureTest, ADeviceThatChangesFormatIsNegotiatedAgain) {
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  // Rows get longer, and pixels two bytes.
  video_.formats = {{V4L2_PIX_FMT_YUYV, 8, 6, 2, 60.0, 4}};
  video_.has_source_change = true;
  EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kDown);
  video_.fill = [](std::uint32_t, std::uint8_t* data, std::size_t* bytes) {
    for (std::size_t i = 0; i < *bytes; ++i) data[i] = static_cast<std::uint8_t>(i % 20);
  };
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(capture.format().fourcc, V4L2_PIX_FMT_YUYV);
  EXPECT_EQ(grey_[1], 2);
  EXPECT_EQ(grey_[8], 0);
  // To a size that is not the rig's: no frame of it is ever handed out.
  video_.formats = {{V4L2_PIX_FMT_GREY, 16, 12, 1, 60.0}};
  video_.has_source_change = true;
  EXPECT_EQ(NextFrame(&capture, 50), Result::kDown);
  EXPECT_THAT(ToString(*capture.last_problem()), HasSubstr("GREY 16x12"));
}

TEST_F(CaptureTest, TimesIncreaseAndFollowAClockThatIsSet) {
  for (const std::int64_t step_us : {-2'500'000L, 2'500'000L, -3'600'000'000L}) {
    Capture capture = Make();
    ASSERT_EQ(NextFrame(&capture), Result::kFrame);
    video_.utc_minus_monotonic_us += step_us;
    Utime last = frame_.utime;
    int num_steps = 0;
    // Both clocks are read within a second: from then on every image has the new time.
    for (int i = 0; i < 60; ++i) {
      ASSERT_EQ(capture.Next(100, grey_, &frame_), Result::kFrame) << i;
      if (frame_.utime - last != 100'000) {
        ++num_steps;
        EXPECT_EQ(frame_.utime - last, 100'000 + step_us);
        EXPECT_LE(i, 10);
      }
      last = frame_.utime;
    }
    EXPECT_EQ(num_steps, 1);
    EXPECT_EQ(last, frame_.mid_exposure_us + video_.utc_minus_monotonic_us);
    EXPECT_EQ(capture.counters().clock_steps, 1);
    EXPECT_EQ(capture.counters().late, 0);
  }
}

TEST_F(CaptureTest, StampsThatRunBackwardsByOneClockAreLate) {
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  const Utime first = frame_.utime;
  video_.stamp_delay_us = 250'000;  // of the next two images: older than the first
  EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kNothing);
  EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kNothing);
  ASSERT_EQ(capture.Next(100, grey_, &frame_), Result::kFrame);
  EXPECT_EQ(frame_.utime, first + 50'000);
  EXPECT_EQ(capture.counters().late, 2);
  EXPECT_EQ(capture.counters().clock_steps, 0);
}

TEST_F(CaptureTest, ControlsChangeWhileItStreams) {
  video_.controls = {{V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 500, 50}}};
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  CaptureOptions changed = options_;
  changed.exposure_us = 2000.0;
  ASSERT_TRUE(capture.ChangeControls(changed));
  EXPECT_EQ(video_.controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 20);
  changed.exposure_us = 90'000.0;
  EXPECT_FALSE(capture.ChangeControls(changed));
  // What is kept holds for the next opening too.
  video_.is_present = false;
  EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kDown);
  video_.controls[V4L2_CID_EXPOSURE_ABSOLUTE].value = 499;
  video_.is_present = true;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(video_.controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 20);
  EXPECT_EQ(frame_.mid_exposure_us, video_.now_us - 1000);
}

TEST_F(CaptureTest, ABadBufferIsCountedOnce) {
  for (const bool have_numbers : {false, true}) {
    FakeVideo& video = video_ = FakeVideo();
    Capture capture = Make();
    ASSERT_EQ(NextFrame(&capture), Result::kFrame);
    video.errors_take_a_number = have_numbers;
    video.bad_frames_have_no_number = !have_numbers;
    video.dequeue_errors = {EIO, EIO};
    ASSERT_EQ(NextFrame(&capture), Result::kFrame);
    EXPECT_EQ(capture.counters().io_errors, 2);
    EXPECT_EQ(capture.counters().missed, 0);
    video.frame_flags = {V4L2_BUF_FLAG_ERROR};
    ASSERT_EQ(NextFrame(&capture), Result::kFrame);
    EXPECT_EQ(capture.counters().damaged, 1);
    EXPECT_EQ(capture.counters().missed, 0);
    // What was lost besides still counts.
    video.errors_take_a_number = true;
    video.dequeue_errors = {EIO};
    video.skip = 3;
    ASSERT_EQ(NextFrame(&capture), Result::kFrame);
    EXPECT_EQ(capture.counters().io_errors, 3);
    EXPECT_EQ(capture.counters().missed, 3);
  }
}

TEST_F(CaptureTest, StreamingDoesNotAllocate) {
  for (const std::uint32_t fourcc : {V4L2_PIX_FMT_GREY, V4L2_PIX_FMT_YUYV, V4L2_PIX_FMT_SRGGB8}) {
    video_ = FakeVideo();
    video_.formats = {{fourcc, 8, 6, fourcc == V4L2_PIX_FMT_YUYV ? 2 : 1, 60.0}};
    video_.controls = {{V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 500, 50}}};
    Capture capture = Make();
    ASSERT_EQ(NextFrame(&capture), Result::kFrame);
    EXPECT_FALSE(capture.TakeNews().empty());
    // What may happen without the device being closed.
    video_.frame_flags = {0, V4L2_BUF_FLAG_ERROR, 0, V4L2_BUF_FLAG_ERROR};
    video_.dequeue_errors = {EIO, EIO, EAGAIN, EIO};
    video_.skip = 2;
    int num_frames = 0, num_told = 0;
    MallocTrap trap;
    for (int i = 0; i < 200; ++i) {
      if (i == 50) video_.is_silent = true;  // poll waits in vain
      if (i == 55) video_.is_silent = false;
      if (i == 90) video_.stamp_delay_us = 250'000;      // late, twice
      if (i == 120) video_.stamp_delay_us = 60'000'000;  // and no stamp
      num_frames += capture.Next(100, grey_, &frame_) == Result::kFrame;
      num_told += static_cast<int>(capture.TakeNews().size());
    }
    const std::size_t calls = trap.count();
    EXPECT_EQ(calls, 0u);
    EXPECT_EQ(num_told, 0);
    EXPECT_GT(num_frames, 180);
    EXPECT_EQ(capture.counters().io_errors, 3);
    EXPECT_EQ(capture.counters().damaged, 2);
    EXPECT_EQ(capture.counters().late, 2);
    EXPECT_GT(capture.counters().bad_stamps, 70);
    EXPECT_EQ(capture.counters().restarts, 0);
  }
}

TEST_F(CaptureTest, ControlsChangedWhileItIsAwayAreTakenWhenItReturns) {
  video_.controls = {{V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 500, 50}}};
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  const auto vanish = [&] {
    video_.is_present = false;
    EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kDown);
  };
  CaptureOptions changed = options_;
  vanish();
  changed.exposure_us = 2000.0;
  EXPECT_TRUE(capture.ChangeControls(changed));
  video_.is_present = true;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(video_.controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 20);
  EXPECT_FALSE(capture.control_problem());
  // Those that the device refuses do not keep it closed, and are named.
  vanish();
  changed.exposure_us = 90'000.0;
  EXPECT_TRUE(capture.ChangeControls(changed));
  EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kDown);
  EXPECT_FALSE(capture.control_problem());  // it is away, that is all
  video_.is_present = true;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(video_.controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 20);
  ASSERT_TRUE(capture.control_problem());
  EXPECT_THAT(ToString(*capture.control_problem()),
              HasSubstr("900 is beyond what the device takes"));
  EXPECT_FALSE(capture.last_problem());
  // They are not tried again; the next change clears the complaint.
  vanish();
  video_.is_present = true;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_TRUE(capture.control_problem());
  changed.exposure_us = 3000.0;
  EXPECT_TRUE(capture.ChangeControls(changed));
  EXPECT_FALSE(capture.control_problem());
  EXPECT_EQ(video_.controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 30);
}

TEST_F(CaptureTest, ControlsThatKeepItClosedCanBeMended) {
  video_.controls = {{V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 500, 50}}};
  options_.exposure_us = 90'000.0;
  Capture capture = Make();
  EXPECT_EQ(NextFrame(&capture, 20), Result::kDown);
  EXPECT_THAT(ToString(*capture.last_problem()), HasSubstr("900 is beyond"));
  CaptureOptions changed = options_;
  changed.exposure_us = 2000.0;
  EXPECT_TRUE(capture.ChangeControls(changed));
  ASSERT_EQ(NextFrame(&capture, 3), Result::kFrame);
  EXPECT_EQ(video_.controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 20);
}

TEST_F(CaptureTest, ControlsThatMeetAVanishingDeviceAreKept) {
  video_.controls = {{V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 500, 50}}};
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  video_.is_present = false;
  CaptureOptions changed = options_;
  changed.exposure_us = 2000.0;
  const IoStatus status = capture.ChangeControls(changed);
  ASSERT_FALSE(status);
  EXPECT_THAT(ToString(status.error()), HasSubstr("those before could not be set again"));
  EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kDown);
  video_.is_present = true;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_EQ(video_.controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 20);
}

TEST_F(CaptureTest, ALogHearsOfEachThingOnce) {
  options_.frame_rate_hz = 30.0;
  video_.highest_rate_hz = 15.0;
  video_.failing = {{VIDIOC_SUBSCRIBE_EVENT, EPERM}};
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  const std::string event = "/dev/video0: cannot do VIDIOC_SUBSCRIBE_EVENT (source change): ";
  EXPECT_THAT(capture.TakeNews(), ElementsAre("/dev/video0: GREY 8 x 6, 15 images/s (30 asked for)",
                                              event + std::strerror(EPERM)));
  // The same again is no news.
  video_.is_present = false;
  EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kDown);
  video_.is_present = true;
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  EXPECT_TRUE(capture.TakeNews().empty());
  EXPECT_EQ(capture.failures()[0].count, 2);
  video_.utc_minus_monotonic_us -= 2'500'000;
  for (int i = 0; i < 30; ++i) ASSERT_EQ(capture.Next(100, grey_, &frame_), Result::kFrame);
  EXPECT_THAT(capture.TakeNews(),
              ElementsAre("the system's clock was set by -2.500 s: images follow it"));
  EXPECT_TRUE(capture.TakeNews().empty());
}

// poll reports an event that cannot be taken again at once: that must not become a busy loop.
TEST_F(CaptureTest, AnEventThatCannotBeTakenIsNamedAndTheLoopRests) {
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  video_.failing = {{VIDIOC_DQEVENT, EIO}};
  video_.has_source_change = true;
  video_.is_silent = true;
  const std::int64_t start_us = video_.now_us;
  for (int i = 0; i < 10; ++i) EXPECT_EQ(capture.Next(100, grey_, &frame_), Result::kNothing);
  EXPECT_GE(video_.now_us - start_us, 10'000);
  ASSERT_EQ(capture.failures().size(), 1u);
  EXPECT_EQ(ToString(capture.failures()[0]),
            std::string("cannot do VIDIOC_DQEVENT: ") + std::strerror(EIO));
  EXPECT_EQ(capture.failures()[0].count, 10);
}

TEST_F(CaptureTest, AnExposureThatCannotBeReadOnceDoesNotMoveTheTime) {
  video_.controls = {{V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 500, 200}}};
  Capture capture = Make();
  ASSERT_EQ(NextFrame(&capture), Result::kFrame);
  video_.failing = {{VIDIOC_G_CTRL, EIO}};
  for (int i = 0; i < 30; ++i) {
    ASSERT_EQ(NextFrame(&capture), Result::kFrame);
    EXPECT_EQ(frame_.mid_exposure_us, video_.now_us - 10'000);
  }
  EXPECT_GT(capture.failures()[0].count, 1);
}

TEST_F(CaptureTest, MjpegThatIsNoJpegIsDamaged) {
  video_.formats = {{V4L2_PIX_FMT_MJPEG, 8, 6, 0, 60.0}};
  Capture capture = Make();
  EXPECT_EQ(NextFrame(&capture, 4), Result::kNothing);
  EXPECT_GT(capture.counters().damaged, 0);
}

}  // namespace
}  // namespace rsfm
