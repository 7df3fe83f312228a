// Opening and negotiating on a fake of the system calls: what is chosen, and what every failure
// says.
#include "rsfm_drivers/v4l2/video_device.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rsfm_drivers/v4l2/device_list.h"
#include "tests/drivers/fake_video.h"

namespace rsfm {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class VideoDeviceTest : public ::testing::Test {
 protected:
  IoExpected<VideoDevice> Open() { return VideoDevice::Open(&video_, options_, 8, 6); }
  std::string Problem() {
    const auto device = Open();
    EXPECT_FALSE(device);
    EXPECT_EQ(video_.num_open, 0);
    EXPECT_EQ(video_.num_mapped, 0);
    return device ? std::string() : ToString(device.error());
  }

  FakeVideo video_;
  CaptureOptions options_;
};

TEST_F(VideoDeviceTest, TakesTheFormatThatNeedsLeastWork) {
  video_.formats = {{V4L2_PIX_FMT_MJPEG, 8, 6, 0, 60},
                    {V4L2_PIX_FMT_YUYV, 8, 6, 2, 30},
                    {V4L2_PIX_FMT_SRGGB8, 8, 6, 1, 30},
                    {V4L2_PIX_FMT_NV12, 8, 6, 1, 30}};
  auto device = Open();
  ASSERT_TRUE(device) << ToString(device.error());
  EXPECT_EQ(device->format().fourcc, V4L2_PIX_FMT_NV12);
}

TEST_F(VideoDeviceTest, TakesTheFormatThatReachesTheRate) {
  video_.formats = {{V4L2_PIX_FMT_YUYV, 8, 6, 2, 10}, {V4L2_PIX_FMT_MJPEG, 8, 6, 0, 60}};
  options_.frame_rate_hz = 30.0;
  auto device = Open();
  ASSERT_TRUE(device) << ToString(device.error());
  EXPECT_EQ(device->format().fourcc, V4L2_PIX_FMT_MJPEG);
  EXPECT_EQ(device->format().raw.format, PixelFormat::kMjpeg);
  EXPECT_DOUBLE_EQ(device->format().frame_rate_hz, 30.0);
  // Where none does, the best of them.
  video_.formats[1].max_rate_hz = 15;
  auto slow = Open();
  ASSERT_TRUE(slow);
  EXPECT_EQ(slow->format().fourcc, V4L2_PIX_FMT_YUYV);
}

TEST_F(VideoDeviceTest, EveryFormatIsReadAndNamed) {
  const std::pair<std::uint32_t, PixelFormat> all[] = {
      {V4L2_PIX_FMT_GREY, PixelFormat::kGrey},     {V4L2_PIX_FMT_Y10, PixelFormat::kY10},
      {V4L2_PIX_FMT_Y16, PixelFormat::kY16},       {V4L2_PIX_FMT_YUYV, PixelFormat::kYuyv},
      {V4L2_PIX_FMT_NV12, PixelFormat::kNv12},     {V4L2_PIX_FMT_MJPEG, PixelFormat::kMjpeg},
      {V4L2_PIX_FMT_SBGGR8, PixelFormat::kBayer8}, {V4L2_PIX_FMT_SGBRG8, PixelFormat::kBayer8},
      {V4L2_PIX_FMT_SGRBG8, PixelFormat::kBayer8}, {V4L2_PIX_FMT_SRGGB8, PixelFormat::kBayer8}};
  for (const auto& [fourcc, format] : all) {
    video_.formats = {{fourcc, 8, 6, format == PixelFormat::kMjpeg ? 0 : 2, 30}};
    options_.format = format;
    auto device = Open();
    ASSERT_TRUE(device) << FourccName(fourcc) << ToString(device.error());
    EXPECT_EQ(device->format().raw.format, format);
    EXPECT_EQ(device->format().raw.stride_bytes, format == PixelFormat::kMjpeg ? 0 : 16);
  }
}

TEST_F(VideoDeviceTest, SaysWhatThereIsInsteadOfWhatWasWanted) {
  video_.formats = {{V4L2_PIX_FMT_YUYV, 640, 480, 2, 30}};
  EXPECT_THAT(Problem(), HasSubstr("/dev/video0: capture.format: has no auto image of 8 x 6 px; it "
                                   "offers YUYV 640x480"));
  options_.format = PixelFormat::kGrey;
  EXPECT_THAT(Problem(), HasSubstr("no grey image"));
}

TEST_F(VideoDeviceTest, EveryFailingCallIsNamedWithItsErrnoAndNothingLeaks) {
  const std::pair<unsigned long, const char*> calls[] = {
      {VIDIOC_QUERYCAP, "VIDIOC_QUERYCAP"}, {VIDIOC_TRY_FMT, "VIDIOC_TRY_FMT"},
      {VIDIOC_S_FMT, "VIDIOC_S_FMT"},       {VIDIOC_S_PARM, "VIDIOC_S_PARM"},
      {VIDIOC_REQBUFS, "VIDIOC_REQBUFS"},   {VIDIOC_QUERYBUF, "VIDIOC_QUERYBUF"},
      {VIDIOC_QBUF, "VIDIOC_QBUF"},         {VIDIOC_STREAMON, "VIDIOC_STREAMON"},
      {FakeVideo::kMap, "map a buffer"}};
  options_.frame_rate_hz = 5.0;
  for (const auto& [request, name] : calls) {
    video_.failing = {{request, EIO}};
    const std::string problem = Problem();
    EXPECT_THAT(problem, HasSubstr(name));
    EXPECT_THAT(problem, HasSubstr(std::strerror(EIO))) << name;
  }
  video_.failing = {{VIDIOC_STREAMON, ENOSPC}};
  EXPECT_THAT(Problem(), HasSubstr("USB bus has no bandwidth"));
}

TEST_F(VideoDeviceTest, WhatIsNoCameraSaysSo) {
  options_.device = "/dev/video9";
  EXPECT_THAT(Problem(), HasSubstr("/dev/video9"));
  options_.device = "/dev/video0";
  video_.capabilities = V4L2_CAP_VIDEO_OUTPUT | V4L2_CAP_STREAMING;
  EXPECT_THAT(Problem(), HasSubstr("does not capture"));
  video_.capabilities = V4L2_CAP_VIDEO_CAPTURE_MPLANE | V4L2_CAP_STREAMING;
  EXPECT_THAT(Problem(), HasSubstr("multi-planar"));
}

TEST_F(VideoDeviceTest, ExposureAndGainAreSetByHandOrLeftToTheCamera) {
  video_.controls = {{V4L2_CID_EXPOSURE_AUTO, {"Exposure, Auto", 0, 3, 0}},
                     {V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure (Absolute)", 1, 500, 7}},
                     {V4L2_CID_GAIN, {"Gain", 0, 64, 3}},
                     {V4L2_CID_AUTOGAIN, {"Gain, Automatic", 0, 1, 0}}};
  options_.exposure_us = 4000.0;
  options_.gain = 20.0;
  auto device = Open();
  ASSERT_TRUE(device) << ToString(device.error());
  EXPECT_EQ(video_.controls[V4L2_CID_EXPOSURE_AUTO].value, V4L2_EXPOSURE_MANUAL);
  EXPECT_EQ(video_.controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 40);
  EXPECT_EQ(video_.controls[V4L2_CID_GAIN].value, 20);
  EXPECT_EQ(video_.controls[V4L2_CID_AUTOGAIN].value, 0);
  EXPECT_EQ(device->ExposureUs(), 4000.0);
  EXPECT_TRUE(device->SetControls(CaptureOptions()));
  EXPECT_EQ(video_.controls[V4L2_CID_EXPOSURE_AUTO].value, V4L2_EXPOSURE_APERTURE_PRIORITY);
  EXPECT_EQ(video_.controls[V4L2_CID_AUTOGAIN].value, 1);
}

TEST_F(VideoDeviceTest, ControlsThatAreNotThereOrOutOfRangeAreNamed) {
  options_.exposure_us = 4000.0;  // stock vivid has none either
  EXPECT_THAT(Problem(), HasSubstr("capture.exposure_us: is no control of this device"));
  video_.controls = {{V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 30, 7}}};
  EXPECT_THAT(Problem(), HasSubstr("40 is beyond what the device takes; give 1 to 30"));
  options_.exposure_us = 0.0;
  options_.gain = 3.0;
  EXPECT_THAT(Problem(), HasSubstr("capture.gain"));
  options_.gain = -1.0;
  options_.controls = {{"trigger_mode", 1}};
  EXPECT_THAT(Problem(), HasSubstr("capture.controls.trigger_mode: is no control"));
}

TEST_F(VideoDeviceTest, TriggerAndOtherControlsGoByNameOrNumber) {
  video_.controls = {{0x009a0902, {"Trigger Mode", 0, 3, 0}}, {0x009a0955, {"Strobe", 0, 9, 0}}};
  options_.controls = {{"trigger_mode", 2}, {"0x009a0955", 4}};
  ASSERT_TRUE(Open());
  EXPECT_EQ(video_.controls[0x009a0902].value, 2);
  EXPECT_EQ(video_.controls[0x009a0955].value, 4);
  // All bits of a mask.
  video_.controls = {{0x009a0902, {"Trigger Lines", 0, -1, 0, V4L2_CTRL_TYPE_BITMASK}}};
  options_.controls = {{"trigger_lines", 0xc0000001}};
  ASSERT_TRUE(Open());
  EXPECT_EQ(static_cast<std::uint32_t>(video_.controls[0x009a0902].value), 0xc0000001u);
  options_.controls = {{"trigger_lines", 0x1'0000'0000}};
  EXPECT_THAT(Problem(), HasSubstr("give 0 to 4294967295"));
}

TEST_F(VideoDeviceTest, ClosingGivesEverythingBack) {
  {
    auto device = Open();
    ASSERT_TRUE(device);
    const VideoDevice moved(std::move(*device));
    EXPECT_EQ(video_.num_open, 1);
    EXPECT_EQ(video_.num_mapped, 4);
  }
  EXPECT_EQ(video_.num_open, 0);
  EXPECT_EQ(video_.num_mapped, 0);
  EXPECT_FALSE(video_.is_streaming);
}

TEST_F(VideoDeviceTest, ListAndInfo) {
  video_.controls = {{V4L2_CID_GAIN, {"Gain", 0, 64, 3}}};
  std::vector<Diagnostic> problems;
  const auto cameras = ListCameras(&video_, &problems);
  ASSERT_EQ(cameras.size(), 1u);
  ASSERT_EQ(problems.size(), 1u);
  EXPECT_THAT(ToString(problems[0]), HasSubstr("/dev/video7: cannot open the camera"));
  EXPECT_EQ(cameras[0].card, "Fake camera");
  const auto details = DescribeCamera(&video_, "/dev/video0");
  ASSERT_TRUE(details);
  ASSERT_EQ(details->formats.size(), 1u);
  EXPECT_EQ(FourccName(details->formats[0].fourcc), "GREY");
  ASSERT_EQ(details->formats[0].sizes.size(), 1u);
  EXPECT_EQ(details->formats[0].sizes[0].max_rate_hz, 60.0);
  ASSERT_EQ(details->controls.size(), 1u);
  EXPECT_EQ(details->controls[0].name, "gain");
  EXPECT_EQ(details->controls[0].value, 3);
  EXPECT_EQ(details->failures.size(), 0u);
  EXPECT_FALSE(DescribeCamera(&video_, "/dev/video7"));
  EXPECT_EQ(video_.num_open, 0);
  // What could not be asked is said.
  for (const auto& [request, name] :
       {std::pair<unsigned long, const char*>{VIDIOC_ENUM_FMT, "VIDIOC_ENUM_FMT"},
        {VIDIOC_ENUM_FRAMESIZES, "VIDIOC_ENUM_FRAMESIZES"},
        {VIDIOC_ENUM_FRAMEINTERVALS, "VIDIOC_ENUM_FRAMEINTERVALS"},
        {VIDIOC_QUERYCTRL, "VIDIOC_QUERYCTRL"},
        {VIDIOC_G_CTRL, "VIDIOC_G_CTRL"}}) {
    video_.failing = {{request, EIO}};
    const auto some = DescribeCamera(&video_, "/dev/video0");
    ASSERT_TRUE(some);
    ASSERT_EQ(some->failures.size(), 1u) << name;
    EXPECT_EQ(ToString(some->failures[0]),
              std::string("cannot do ") + name + ": " + std::strerror(EIO));
  }
  video_.failing = {{VIDIOC_QUERYCAP, EIO}};
  EXPECT_TRUE(ListCameras(&video_, &problems).empty());
  EXPECT_THAT(ToString(problems[1]), HasSubstr("VIDIOC_QUERYCAP"));
}

TEST_F(VideoDeviceTest, ARateThatIsNotGrantedIsSaid) {
  options_.frame_rate_hz = 30.0;
  video_.highest_rate_hz = 15.0;
  auto slow = Open();
  ASSERT_TRUE(slow);
  EXPECT_EQ(ToString(slow->format()), "GREY 8 x 6, 15 images/s (30 asked for)");
  EXPECT_TRUE(slow->format().IsOtherRate());
  video_.highest_rate_hz = 29.97;
  EXPECT_EQ(ToString(Open()->format()), "GREY 8 x 6, 29.97 images/s");
  video_.can_set_rate = false;
  video_.period = {1, 20};
  EXPECT_EQ(ToString(Open()->format()), "GREY 8 x 6, 20 images/s (30 asked for)");
  options_.frame_rate_hz = 0.0;
  EXPECT_EQ(ToString(Open()->format()), "GREY 8 x 6, 20 images/s");
}

TEST_F(VideoDeviceTest, InterlacedImagesAreRefused) {
  for (const v4l2_field field : {V4L2_FIELD_INTERLACED, V4L2_FIELD_ALTERNATE, V4L2_FIELD_SEQ_TB,
                                 V4L2_FIELD_TOP, V4L2_FIELD_INTERLACED_BT}) {
    video_.formats = {{V4L2_PIX_FMT_YUYV, 8, 6, 2, 60.0, 0, field}};
    EXPECT_THAT(Problem(), HasSubstr("interlaced images of 8 x 6 px only (V4L2 field " +
                                     std::to_string(field) + ")"));
  }
  // Another format of the same camera may be whole.
  video_.formats.push_back({V4L2_PIX_FMT_SRGGB8, 8, 6, 1, 60.0});
  EXPECT_EQ(Open()->format().fourcc, V4L2_PIX_FMT_SRGGB8);
  video_.formats = {{V4L2_PIX_FMT_YUYV, 8, 6, 2, 60.0, 0, V4L2_FIELD_ANY}};
  EXPECT_TRUE(Open());
}

TEST_F(VideoDeviceTest, WhatIsOptionalAndFailsIsNamedWithItsErrno) {
  video_.controls = {{V4L2_CID_EXPOSURE_AUTO, {"Exposure, Auto", 0, 3, 0}},
                     {V4L2_CID_AUTOGAIN, {"Gain, Automatic", 0, 1, 0}},
                     {V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 500, 7}}};
  const auto failures = [this] {
    auto device = Open();
    EXPECT_TRUE(device) << ToString(device.error());
    std::vector<std::string> texts;
    for (std::size_t i = 0; device && i < device->failures()->size(); ++i)
      texts.push_back(ToString((*device->failures())[i]));
    return texts;
  };
  const auto text = [](const char* call, int error) {
    return std::string("cannot do ") + call + ": " + std::strerror(error);
  };
  EXPECT_TRUE(failures().empty());
  video_.controls[V4L2_CID_EXPOSURE_AUTO].value = 1;  // else it is as it was asked for
  video_.controls[V4L2_CID_AUTOGAIN].value = 0;
  video_.refusing = {{V4L2_CID_EXPOSURE_AUTO, EBUSY}, {V4L2_CID_AUTOGAIN, EACCES}};
  EXPECT_THAT(failures(), ElementsAre(text("VIDIOC_S_CTRL (exposure_auto)", EBUSY),
                                      text("VIDIOC_S_CTRL (autogain)", EACCES)));
  video_.refusing.clear();
  video_.failing = {{VIDIOC_QUERYCTRL, EIO}};
  EXPECT_THAT(failures(), ElementsAre(text("VIDIOC_QUERYCTRL (exposure_auto)", EIO),
                                      text("VIDIOC_QUERYCTRL (autogain)", EIO)));
  video_.failing = {{VIDIOC_SUBSCRIBE_EVENT, EPERM}, {VIDIOC_G_PARM, EIO}};
  EXPECT_THAT(failures(), ElementsAre(text("VIDIOC_G_PARM (frame rate)", EIO),
                                      text("VIDIOC_SUBSCRIBE_EVENT (source change)", EPERM)));
  // What a device need not have is no failure, unless it was asked for.
  video_.failing = {{VIDIOC_G_PARM, ENOTTY}};
  video_.has_events = false;
  video_.controls.clear();
  EXPECT_TRUE(failures().empty());
  options_.frame_rate_hz = 20.0;
  EXPECT_THAT(failures(), ElementsAre(text("VIDIOC_G_PARM (frame rate)", ENOTTY)));
}

TEST_F(VideoDeviceTest, WhatWasAskedForAndFailsIsAnError) {
  video_.controls = {{V4L2_CID_EXPOSURE_AUTO, {"Exposure, Auto", 0, 3, 3}},
                     {V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 500, 7}},
                     {V4L2_CID_GAIN, {"Gain", 0, 64, 3}},
                     {V4L2_CID_AUTOGAIN, {"Gain, Automatic", 0, 1, 1}}};
  video_.refusing = {{V4L2_CID_EXPOSURE_AUTO, EBUSY}};
  options_.exposure_us = 4000.0;
  EXPECT_THAT(Problem(),
              HasSubstr("capture.exposure_us: cannot do VIDIOC_S_CTRL (exposure_auto): " +
                        std::string(std::strerror(EBUSY))));
  options_.exposure_us = 0.0;
  options_.gain = 4.0;
  video_.refusing = {{V4L2_CID_AUTOGAIN, EIO}};
  EXPECT_THAT(Problem(), HasSubstr("capture.gain: cannot do VIDIOC_S_CTRL (autogain): " +
                                   std::string(std::strerror(EIO))));
  // One that is always manual need not let itself be set.
  video_.controls[V4L2_CID_AUTOGAIN].value = 0;
  ASSERT_TRUE(Open());
  EXPECT_EQ(video_.controls[V4L2_CID_GAIN].value, 4);
  video_.refusing.clear();
  video_.failing = {{VIDIOC_QUERYCTRL, EIO}};
  EXPECT_THAT(Problem(),
              HasSubstr("VIDIOC_QUERYCTRL (autogain): " + std::string(std::strerror(EIO))));
}

TEST_F(VideoDeviceTest, AnExposureThatCannotBeReadOnceIsTheOneBefore) {
  video_.controls = {{V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure", 1, 500, 50}}};
  auto device = Open();
  ASSERT_TRUE(device);
  EXPECT_EQ(device->ExposureUs(), 5000.0);
  for (const int error : {EIO, EBUSY, ETIMEDOUT}) {
    video_.failing = {{VIDIOC_G_CTRL, error}};
    EXPECT_EQ(device->ExposureUs(), 5000.0);
  }
  EXPECT_EQ(device->failures()->size(), 3u);
  video_.failing.clear();
  video_.controls[V4L2_CID_EXPOSURE_ABSOLUTE].value = 60;
  EXPECT_EQ(device->ExposureUs(), 6000.0);
  // A device without it is not asked again and again.
  video_.failing = {{VIDIOC_G_CTRL, EINVAL}};
  EXPECT_EQ(device->ExposureUs(), 0.0);
  video_.failing.clear();
  EXPECT_EQ(device->ExposureUs(), 0.0);
}

}  // namespace
}  // namespace rsfm
