// Which of a device's formats is taken, and how V4L2 names them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rsfm/io/diagnostic.h"
#include "rsfm/io/onboard_options.h"
#include "rsfm_drivers/v4l2/grey.h"
#include "rsfm_drivers/v4l2/video_system.h"

namespace rsfm {

// The format's family, kAuto where it is none that is read here.
PixelFormat FormatOf(std::uint32_t fourcc);
std::string FourccName(std::uint32_t fourcc);  // "YUYV"

struct FrameSize {
  int width = 0, height = 0;
  bool is_range = false;  // then the largest of it
};
// What a device offers. Empty where it does not say.
std::vector<std::uint32_t> ListFormats(VideoSystem* system, int fd);
std::vector<FrameSize> ListSizes(VideoSystem* system, int fd, std::uint32_t fourcc);
// The highest frame rate in that size; 0 where the device does not say.
double MaxRate(VideoSystem* system, int fd, std::uint32_t fourcc, int width, int height);

struct StreamFormat {
  RawFormat raw;
  std::uint32_t fourcc = 0;
  std::size_t image_bytes = 0;
  double frame_rate_hz = 0.0;  // 0: the device does not say
};

// Sets the first format of CaptureOptions::format's list that the device has in that size and,
// where a rate is asked for, at that rate; then the rate. `device` names it in messages.
//   kUnsupported  no such format and size: the message lists what there is
//   kIo           an ioctl failed: the message names it and its errno
IoExpected<StreamFormat> ChooseFormat(VideoSystem* system, int fd, const CaptureOptions& options,
                                      int width, int height, const std::string& device);

}  // namespace rsfm
