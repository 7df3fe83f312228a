// Which of a device's formats is taken, and how V4L2 names them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rsfm/io/diagnostic.h"
#include "rsfm/io/onboard_options.h"
#include "rsfm_drivers/v4l2/call_failures.h"
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
// What a device offers. Empty where it does not say; a list that breaks off adds to `failures`.
std::vector<std::uint32_t> ListFormats(VideoSystem* system, int fd, CallFailures* failures);
std::vector<FrameSize> ListSizes(VideoSystem* system, int fd, std::uint32_t fourcc,
                                 CallFailures* failures);
// The highest frame rate in that size; 0 where the device does not say.
double MaxRate(VideoSystem* system, int fd, std::uint32_t fourcc, int width, int height,
               CallFailures* failures);

struct StreamFormat {
  RawFormat raw;
  std::uint32_t fourcc = 0;
  std::size_t image_bytes = 0;
  double frame_rate_hz = 0.0;  // as granted; 0: the device does not say
  double asked_rate_hz = 0.0;  // 0: none was asked for

  // The device said that it gives another rate than it was asked for, or will not say.
  bool IsOtherRate() const;
};
// "GREY 1280 x 960, 15 images/s (30 asked for)"
std::string ToString(const StreamFormat& format);

// Sets the first format of CaptureOptions::format's list that the device has in that size and,
// where a rate is asked for, at that rate; then the rate. `device` names it in messages.
//   kUnsupported  no such format and size, or interlaced only: the message lists what there is
//   kIo           an ioctl failed: the message names it and its errno
// A rate that cannot be asked for or set is no error: `failures` and the result say so.
IoExpected<StreamFormat> ChooseFormat(VideoSystem* system, int fd, const CaptureOptions& options,
                                      int width, int height, const std::string& device,
                                      CallFailures* failures);

}  // namespace rsfm
