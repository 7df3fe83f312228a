// Opening and negotiating on a fake of the system calls: what is chosen, and what every failure
// says.
#include "rsfm_drivers/v4l2/video_device.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rsfm_drivers/v4l2/device_list.h"
#include "tests/drivers/fake_video.h"

namespace rsfm {
namespace {

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
  const auto cameras = ListCameras(&video_);
  ASSERT_EQ(cameras.size(), 1u);  // /dev/video7 cannot be opened
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
  EXPECT_FALSE(DescribeCamera(&video_, "/dev/video7"));
  EXPECT_EQ(video_.num_open, 0);
}

}  // namespace
}  // namespace rsfm
