#include "rsfm_drivers/v4l2/device_list.h"

#include <linux/videodev2.h>

#include <cstring>

namespace rsfm {
namespace {

template <std::size_t N>
std::string Text(const __u8 (&bytes)[N]) {
  const char* text = reinterpret_cast<const char*>(bytes);
  return std::string(text, ::strnlen(text, N));
}

// 0, or the errno of what failed. *captures: video, by streaming.
int Query(VideoSystem* system, int fd, CameraInfo* info, bool* captures) {
  v4l2_capability capability = {};
  if (const int error = system->Ioctl(fd, VIDIOC_QUERYCAP, &capability); error != 0) return error;
  const std::uint32_t can = (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0
                                ? capability.device_caps
                                : capability.capabilities;
  info->card = Text(capability.card);
  info->driver = Text(capability.driver);
  info->bus = Text(capability.bus_info);
  *captures = (can & V4L2_CAP_VIDEO_CAPTURE) != 0 && (can & V4L2_CAP_STREAMING) != 0;
  return 0;
}

}  // namespace

std::vector<CameraInfo> ListCameras(VideoSystem* system, std::vector<Diagnostic>* problems) {
  std::vector<CameraInfo> cameras;
  for (const std::string& path : system->List()) {
    int fd = -1;
    if (const int error = system->Open(path.c_str(), &fd); error != 0) {
      problems->push_back(FromErrno(error, path, "open the camera"));
      continue;
    }
    const UniqueFd owner(system, fd);
    CameraInfo info;
    info.path = path;
    bool captures = false;
    if (const int error = Query(system, fd, &info, &captures); error != 0) {
      problems->push_back(FromErrno(error, path, "do VIDIOC_QUERYCAP"));
    } else if (captures) {
      cameras.push_back(std::move(info));
    }
  }
  return cameras;
}

IoExpected<CameraDetails> DescribeCamera(VideoSystem* system, const std::string& path) {
  int fd = -1;
  if (const int error = system->Open(path.c_str(), &fd); error != 0)
    return Fail(FromErrno(error, path, "open the camera"));
  const UniqueFd owner(system, fd);
  CameraDetails details;
  details.info.path = path;
  bool captures = false;
  if (const int error = Query(system, fd, &details.info, &captures); error != 0 || !captures) {
    return Fail({Errc::kInvalidArgument, path, "VIDIOC_QUERYCAP",
                 error != 0 ? std::string("is not a camera: ") + std::strerror(error)
                            : "does not capture video by streaming",
                 "rsfm_tool camera list shows those there are"});
  }
  CallFailures* failures = &details.failures;
  for (const std::uint32_t fourcc : ListFormats(system, fd, failures)) {
    CameraDetails::Format format{fourcc, {}};
    for (const FrameSize& size : ListSizes(system, fd, fourcc, failures)) {
      format.sizes.push_back(
          {size, MaxRate(system, fd, fourcc, size.width, size.height, failures)});
    }
    details.formats.push_back(std::move(format));
  }
  details.controls = ListControls(system, fd, failures);
  return details;
}

}  // namespace rsfm
