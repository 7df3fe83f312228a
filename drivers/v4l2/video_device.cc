#include "rsfm_drivers/v4l2/video_device.h"

#include <linux/videodev2.h>

#include <algorithm>
#include <cerrno>

namespace rsfm {
namespace {

StampKind KindOf(std::uint32_t flags) {
  if ((flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) != V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC)
    return StampKind::kNone;
  return (flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE ? StampKind::kStart
                                                                                 : StampKind::kEnd;
}

v4l2_buffer MakeBuffer(std::uint32_t index) {
  v4l2_buffer buffer = {};
  buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  buffer.memory = V4L2_MEMORY_MMAP;
  buffer.index = index;
  return buffer;
}

}  // namespace

VideoDevice::VideoDevice(VideoDevice&& other) noexcept
    : system_(other.system_),
      fd_(std::move(other.fd_)),
      path_(std::move(other.path_)),
      format_(other.format_),
      buffers_(other.buffers_),
      is_streaming_(std::exchange(other.is_streaming_, false)),
      has_exposure_(other.has_exposure_),
      exposure_us_(other.exposure_us_),
      failures_(other.failures_) {
  other.buffers_.clear();
}

VideoDevice::~VideoDevice() { Stop(); }

void VideoDevice::Stop() noexcept {
  int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (is_streaming_) {
    const int error = system_->Ioctl(fd_.get(), VIDIOC_STREAMOFF, &type);
    if (error != 0 && error != ENODEV) failures_.Add("VIDIOC_STREAMOFF", error);
  }
  is_streaming_ = false;
  for (const Buffer& buffer : buffers_) system_->Unmap(buffer.data, buffer.bytes);
  buffers_.clear();
}

IoExpected<VideoDevice> VideoDevice::Open(VideoSystem* system, const CaptureOptions& options,
                                          int width, int height) {
  int fd = -1;
  if (const int error = system->Open(options.device.c_str(), &fd); error != 0)
    return Fail(FromErrno(error, options.device, "open the camera"));
  VideoDevice device(system, UniqueFd(system, fd), options.device);
  if (auto s = device.Check(); !s) return Fail(s.error());
  auto format = ChooseFormat(system, fd, options, width, height, options.device, &device.failures_);
  if (!format) return Fail(format.error());
  device.format_ = *format;
  if (auto s = device.SetControls(options); !s) return Fail(s.error());
  if (auto s = device.MapBuffers(options.num_buffers); !s) return Fail(s.error());
  if (auto s = device.Start(); !s) return Fail(s.error());
  return device;
}

IoStatus VideoDevice::Check() {
  v4l2_capability capability = {};
  if (const int error = system_->Ioctl(fd_.get(), VIDIOC_QUERYCAP, &capability); error != 0) {
    if (error != ENOTTY) return Fail(FromErrno(error, path_, "do VIDIOC_QUERYCAP"));
    return Fail({Errc::kInvalidArgument, path_, "capture.device", "is not a video device",
                 "rsfm_tool camera list shows those there are"});
  }
  const std::uint32_t can = (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0
                                ? capability.device_caps
                                : capability.capabilities;
  if ((can & V4L2_CAP_VIDEO_CAPTURE) == 0 || (can & V4L2_CAP_STREAMING) == 0) {
    return Fail({Errc::kUnsupported, path_, "capture.device",
                 (can & V4L2_CAP_VIDEO_CAPTURE_MPLANE) != 0
                     ? "captures through the multi-planar interface only, which is not supported"
                     : "does not capture video by streaming",
                 "rsfm_tool camera list shows those that do"});
  }
  return {};
}

IoStatus VideoDevice::MapBuffers(int count) {
  v4l2_requestbuffers request = {};
  request.count = static_cast<std::uint32_t>(std::clamp(count, 2, kMaxBuffers));
  request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  request.memory = V4L2_MEMORY_MMAP;
  if (const int error = system_->Ioctl(fd_.get(), VIDIOC_REQBUFS, &request); error != 0)
    return Fail(FromErrno(error, path_, "do VIDIOC_REQBUFS"));
  if (request.count < 2) return Fail(FromErrno(ENOMEM, path_, "get two buffers of the device"));
  const auto granted = std::min(request.count, static_cast<std::uint32_t>(kMaxBuffers));
  for (std::uint32_t i = 0; i < granted; ++i) {
    v4l2_buffer buffer = MakeBuffer(i);
    if (const int error = system_->Ioctl(fd_.get(), VIDIOC_QUERYBUF, &buffer); error != 0)
      return Fail(FromErrno(error, path_, "do VIDIOC_QUERYBUF"));
    Buffer mapped{nullptr, buffer.length};
    if (const int error = system_->Map(fd_.get(), buffer.length, buffer.m.offset, &mapped.data);
        error != 0) {
      return Fail(FromErrno(error, path_, "map a buffer"));
    }
    static_cast<void>(buffers_.TryPushBack(mapped));  // granted <= capacity
    if (const int error = system_->Ioctl(fd_.get(), VIDIOC_QBUF, &buffer); error != 0)
      return Fail(FromErrno(error, path_, "do VIDIOC_QBUF"));
  }
  return {};
}

IoStatus VideoDevice::Start() {
  v4l2_event_subscription subscription = {};
  subscription.type = V4L2_EVENT_SOURCE_CHANGE;
  // Most cameras have no such event.
  const int subscribed = system_->Ioctl(fd_.get(), VIDIOC_SUBSCRIBE_EVENT, &subscription);
  if (subscribed != 0 && !IsAbsent(subscribed))
    failures_.Add("VIDIOC_SUBSCRIBE_EVENT (source change)", subscribed);
  int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (const int error = system_->Ioctl(fd_.get(), VIDIOC_STREAMON, &type); error != 0) {
    return Fail(FromErrno(error, path_,
                          error == ENOSPC ? "do VIDIOC_STREAMON (the USB bus has no bandwidth left)"
                                          : "do VIDIOC_STREAMON"));
  }
  is_streaming_ = true;
  return {};
}

Status VideoDevice::Dequeue(RawFrame* frame) noexcept {
  v4l2_buffer buffer = MakeBuffer(0);
  if (const int error = system_->Ioctl(fd_.get(), VIDIOC_DQBUF, &buffer); error != 0)
    return Fail(Errc::kIo, "VIDIOC_DQBUF", error);
  if (buffer.index >= buffers_.size()) return Fail(Errc::kIo, "VIDIOC_DQBUF", EINVAL);
  const Buffer& memory = buffers_[buffer.index];
  frame->data = {static_cast<const std::uint8_t*>(memory.data),
                 std::min<std::size_t>(buffer.bytesused, memory.bytes)};
  frame->index = buffer.index;
  frame->sequence = buffer.sequence;
  frame->stamp_kind = KindOf(buffer.flags);
  frame->stamp_us = static_cast<std::int64_t>(buffer.timestamp.tv_sec) * 1'000'000 +
                    static_cast<std::int64_t>(buffer.timestamp.tv_usec);
  frame->is_damaged = (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0;
  return {};
}

Status VideoDevice::Requeue(std::uint32_t index) noexcept {
  v4l2_buffer buffer = MakeBuffer(index);
  if (const int error = system_->Ioctl(fd_.get(), VIDIOC_QBUF, &buffer); error != 0)
    return Fail(Errc::kIo, "VIDIOC_QBUF", error);
  return {};
}

bool VideoDevice::SourceHasChanged() noexcept {
  bool has_changed = false;
  for (int i = 0; i < kMaxBuffers; ++i) {
    v4l2_event event = {};
    if (const int error = system_->Ioctl(fd_.get(), VIDIOC_DQEVENT, &event); error != 0) {
      if (error != ENOENT && error != EAGAIN) failures_.Add("VIDIOC_DQEVENT", error);
      break;
    }
    has_changed |= event.type == V4L2_EVENT_SOURCE_CHANGE &&
                   (event.u.src_change.changes & V4L2_EVENT_SRC_CH_RESOLUTION) != 0;
  }
  return has_changed;
}

}  // namespace rsfm
