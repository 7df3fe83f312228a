// Which cameras there are, and what each can do.
#pragma once

#include <string>
#include <vector>

#include "rsfm/io/diagnostic.h"
#include "rsfm_drivers/v4l2/video_device.h"

namespace rsfm {

struct CameraInfo {
  std::string path, card, driver, bus;
};
struct CameraDetails {
  struct Size {
    FrameSize size;
    double max_rate_hz = 0.0;  // 0: the device does not say
  };
  struct Format {
    std::uint32_t fourcc = 0;
    std::vector<Size> sizes;
  };
  CameraInfo info;
  std::vector<Format> formats;
  std::vector<ControlInfo> controls;
  CallFailures failures;  // what could not be asked
};

// Every device that captures video by streaming. `problems`: those that could not be asked whether
// they do.
std::vector<CameraInfo> ListCameras(VideoSystem* system, std::vector<Diagnostic>* problems);
IoExpected<CameraDetails> DescribeCamera(VideoSystem* system, const std::string& path);

}  // namespace rsfm
