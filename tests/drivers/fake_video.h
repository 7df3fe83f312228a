// A camera made of nothing: the system calls of one V4L2 device with a clock of its own, so that
// every fault can be had at will and no test waits.
#pragma once

#include <linux/videodev2.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <deque>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "rsfm_drivers/v4l2/video_system.h"

namespace rsfm {

class FakeVideo final : public VideoSystem {
 public:
  struct Format {
    std::uint32_t fourcc;
    int width, height;
    int bytes_per_pixel;  // 0: compressed
    double max_rate_hz;
    int padding = 0;  // of each row, bytes
    v4l2_field field = V4L2_FIELD_NONE;
  };
  struct Control {
    std::string name;
    std::int32_t minimum, maximum, value;
    std::uint32_t type = V4L2_CTRL_TYPE_INTEGER;
  };

  // The device.
  std::vector<Format> formats = {{V4L2_PIX_FMT_GREY, 8, 6, 1, 60.0}};
  std::map<std::uint32_t, Control> controls;
  std::uint32_t capabilities = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
  std::uint32_t stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_EOF;
  std::int64_t stamp_delay_us = 0;  // from the stamp to the arrival
  double rate_hz = 10.0;
  double highest_rate_hz = 1000.0;  // that is granted
  bool can_set_rate = true;
  std::function<void(std::uint32_t sequence, std::uint8_t* data, std::size_t* bytes)> fill =
      [](std::uint32_t sequence, std::uint8_t* data, std::size_t* bytes) {
        std::memset(data, static_cast<int>(sequence & 0xff), *bytes);
      };
  // Faults.
  bool is_present = true;
  bool is_silent = false;                 // streams, but gives no frames
  std::map<unsigned long, int> failing;   // ioctl request to errno, until taken out
  std::map<std::uint32_t, int> refusing;  // controls that cannot be set, to errno
  std::deque<int> dequeue_errors;         // errnos of the next dequeues
  bool errors_take_a_number = false;      // of the sequence
  bool bad_frames_have_no_number = false;
  std::uint32_t skip = 0;                 // sequence numbers left out before the next frame
  std::deque<std::uint32_t> frame_flags;  // of the next frames
  bool has_source_change = false;         // an event waits
  bool has_events = true;
  std::int64_t utc_minus_monotonic_us = 1'700'000'000'000'000;
  // What happened.
  std::int64_t now_us = 1'000'000;
  int num_opens = 0, num_open = 0, num_mapped = 0;
  std::int64_t waited_us = 0;
  bool is_streaming = false;
  v4l2_fract period = {1, 10};

  int Open(const char* path, int* fd) override {
    if (std::string(path) != "/dev/video0") return ENOENT;
    if (!is_present) return ENOENT;
    ++num_opens;
    ++num_open;
    is_streaming = false;
    queue_.clear();
    queue_.reserve(64);
    *fd = 100 + num_opens;
    return 0;
  }
  void Close(int) override {
    --num_open;
    is_streaming = false;
    queue_.clear();
  }
  int Map(int, std::size_t bytes, std::int64_t offset, void** data) override {
    if (const auto found = failing.find(kMap); found != failing.end()) return found->second;
    auto& memory = memory_[offset];
    memory.resize(bytes);
    *data = memory.data();
    ++num_mapped;
    return 0;
  }
  void Unmap(void*, std::size_t) override { --num_mapped; }
  // The clock goes on to the next frame, or to the end of the time-out.
  int Poll(int, int timeout_ms, unsigned* events) override {
    *events = 0;
    if (!is_present) {
      *events = kError;
      return 0;
    }
    if (has_source_change) *events |= kException;
    const std::int64_t end_us = now_us + 1000 * static_cast<std::int64_t>(timeout_ms);
    if (!is_streaming || is_silent || queue_.empty() || next_frame_us_ > end_us) {
      if (*events == 0) now_us = end_us;
      return 0;
    }
    now_us = std::max(now_us, next_frame_us_);
    *events |= kReadable;
    return 0;
  }
  void Wait(std::int64_t duration_us) override {
    now_us += duration_us;
    waited_us += duration_us;
  }
  std::int64_t MonotonicUs() override { return now_us; }
  std::int64_t UtcUs() override { return now_us + utc_minus_monotonic_us; }
  std::vector<std::string> List() override { return {"/dev/video0", "/dev/video7"}; }

  int Ioctl(int, unsigned long request, void* argument) override {
    if (!is_present) return ENODEV;
    if (const auto found = failing.find(request); found != failing.end()) return found->second;
    switch (request) {
      case VIDIOC_QUERYCAP:
        return QueryCap(static_cast<v4l2_capability*>(argument));
      case VIDIOC_ENUM_FMT:
        return EnumFormat(static_cast<v4l2_fmtdesc*>(argument));
      case VIDIOC_ENUM_FRAMESIZES:
        return EnumSize(static_cast<v4l2_frmsizeenum*>(argument));
      case VIDIOC_ENUM_FRAMEINTERVALS:
        return EnumInterval(static_cast<v4l2_frmivalenum*>(argument));
      case VIDIOC_TRY_FMT:
      case VIDIOC_S_FMT:
        return SetFormat(static_cast<v4l2_format*>(argument));
      case VIDIOC_G_PARM:
      case VIDIOC_S_PARM:
        return Parameters(request, static_cast<v4l2_streamparm*>(argument));
      case VIDIOC_QUERYCTRL:
        return QueryControl(static_cast<v4l2_queryctrl*>(argument));
      case VIDIOC_G_CTRL:
      case VIDIOC_S_CTRL:
        return AccessControl(request, static_cast<v4l2_control*>(argument));
      case VIDIOC_REQBUFS:
        return 0;
      case VIDIOC_QUERYBUF:
        return QueryBuffer(static_cast<v4l2_buffer*>(argument));
      case VIDIOC_QBUF:
        queue_.push_back(static_cast<v4l2_buffer*>(argument)->index);
        return 0;
      case VIDIOC_DQBUF:
        return Dequeue(static_cast<v4l2_buffer*>(argument));
      case VIDIOC_STREAMON:
        is_streaming = true;
        sequence_ = 0;
        next_frame_us_ = now_us + PeriodUs();
        return 0;
      case VIDIOC_STREAMOFF:
        is_streaming = false;
        return 0;
      case VIDIOC_SUBSCRIBE_EVENT:
        return has_events ? 0 : ENOTTY;
      case VIDIOC_DQEVENT:
        return TakeEvent(static_cast<v4l2_event*>(argument));
    }
    return ENOTTY;
  }

  static constexpr unsigned long kMap = 1;  // a key of `failing` for mmap

 private:
  static constexpr std::uint32_t kBufferSpacing = 1u << 20;

  std::int64_t PeriodUs() const { return static_cast<std::int64_t>(1e6 / rate_hz); }
  int QueryCap(v4l2_capability* c) const {
    std::strcpy(reinterpret_cast<char*>(c->card), "Fake camera");
    std::strcpy(reinterpret_cast<char*>(c->driver), "fake");
    std::strcpy(reinterpret_cast<char*>(c->bus_info), "nowhere");
    c->capabilities = capabilities | V4L2_CAP_DEVICE_CAPS;
    c->device_caps = capabilities;
    return 0;
  }
  int EnumFormat(v4l2_fmtdesc* d) const {
    if (d->index >= formats.size()) return EINVAL;
    d->pixelformat = formats[d->index].fourcc;
    return 0;
  }
  int EnumSize(v4l2_frmsizeenum* e) const {
    for (const Format& format : formats) {
      if (format.fourcc != e->pixel_format || e->index > 0) continue;
      e->type = V4L2_FRMSIZE_TYPE_DISCRETE;
      e->discrete = {static_cast<std::uint32_t>(format.width),
                     static_cast<std::uint32_t>(format.height)};
      return 0;
    }
    return EINVAL;
  }
  int EnumInterval(v4l2_frmivalenum* e) const {
    for (const Format& format : formats) {
      if (format.fourcc != e->pixel_format || e->index > 0) continue;
      e->type = V4L2_FRMIVAL_TYPE_DISCRETE;
      e->discrete = {1, static_cast<std::uint32_t>(format.max_rate_hz)};
      return 0;
    }
    return EINVAL;
  }
  // As drivers do: what cannot be had is replaced by what can.
  int SetFormat(v4l2_format* f) {
    const Format* chosen = &formats.front();
    for (const Format& format : formats) {
      if (format.fourcc == f->fmt.pix.pixelformat) chosen = &format;
    }
    f->fmt.pix.pixelformat = chosen->fourcc;
    f->fmt.pix.width = static_cast<std::uint32_t>(chosen->width);
    f->fmt.pix.height = static_cast<std::uint32_t>(chosen->height);
    f->fmt.pix.bytesperline =
        static_cast<std::uint32_t>(chosen->width * chosen->bytes_per_pixel + chosen->padding);
    f->fmt.pix.sizeimage = chosen->bytes_per_pixel > 0
                               ? f->fmt.pix.bytesperline * f->fmt.pix.height
                               : 4096u + f->fmt.pix.width * f->fmt.pix.height;
    f->fmt.pix.field = chosen->field;
    image_bytes_ = f->fmt.pix.sizeimage;
    return 0;
  }
  int Parameters(unsigned long request, v4l2_streamparm* p) {
    if (request == VIDIOC_S_PARM) {
      period = p->parm.capture.timeperframe;
      rate_hz = static_cast<double>(period.denominator) / period.numerator;
      if (rate_hz > highest_rate_hz) {
        rate_hz = highest_rate_hz;
        period = {1000, static_cast<std::uint32_t>(1000.0 * rate_hz)};
      }
    }
    p->parm.capture.capability = can_set_rate ? V4L2_CAP_TIMEPERFRAME : 0u;
    p->parm.capture.timeperframe = period;
    return 0;
  }
  int QueryControl(v4l2_queryctrl* q) const {
    const bool next = (q->id & V4L2_CTRL_FLAG_NEXT_CTRL) != 0;
    const std::uint32_t id = q->id & ~V4L2_CTRL_FLAG_NEXT_CTRL;
    const auto found = next ? controls.upper_bound(id) : controls.find(id);
    if (found == controls.end()) return EINVAL;
    *q = {};
    q->id = found->first;
    q->type = found->second.type;
    q->minimum = found->second.minimum;
    q->maximum = found->second.maximum;
    std::strncpy(reinterpret_cast<char*>(q->name), found->second.name.c_str(), sizeof q->name - 1);
    return 0;
  }
  int AccessControl(unsigned long request, v4l2_control* c) {
    const auto found = controls.find(c->id);
    if (found == controls.end()) return EINVAL;
    if (request == VIDIOC_G_CTRL) {
      c->value = found->second.value;
      return 0;
    }
    if (const auto refused = refusing.find(c->id); refused != refusing.end())
      return refused->second;
    const bool is_mask = found->second.type == V4L2_CTRL_TYPE_BITMASK;
    if (!is_mask && (c->value < found->second.minimum || c->value > found->second.maximum))
      return ERANGE;
    found->second.value = c->value;
    return 0;
  }
  int QueryBuffer(v4l2_buffer* b) const {
    b->length = static_cast<std::uint32_t>(image_bytes_);
    b->m.offset = b->index * kBufferSpacing;
    return 0;
  }
  int Dequeue(v4l2_buffer* b) {
    if (!dequeue_errors.empty()) {
      const int error = dequeue_errors.front();
      dequeue_errors.pop_front();
      sequence_ += errors_take_a_number ? 1u : 0u;
      next_frame_us_ = now_us + PeriodUs();
      return error;
    }
    if (queue_.empty() || is_silent || now_us < next_frame_us_) return EAGAIN;
    b->index = queue_.front();
    queue_.erase(queue_.begin());
    sequence_ += std::exchange(skip, 0u);
    b->sequence = sequence_++;
    std::size_t bytes = image_bytes_;
    fill(b->sequence, memory_[b->index * kBufferSpacing].data(), &bytes);
    b->bytesused = static_cast<std::uint32_t>(bytes);
    b->flags = stamp_flags;
    if (!frame_flags.empty()) {
      b->flags |= frame_flags.front();
      frame_flags.pop_front();
    }
    if (bad_frames_have_no_number && (b->flags & V4L2_BUF_FLAG_ERROR) != 0) b->sequence = 0;
    const std::int64_t stamp_us = now_us - stamp_delay_us;
    b->timestamp.tv_sec = stamp_us / 1'000'000;
    b->timestamp.tv_usec = stamp_us % 1'000'000;
    next_frame_us_ = now_us + PeriodUs();
    return 0;
  }
  int TakeEvent(v4l2_event* e) {
    if (!has_source_change) return ENOENT;
    has_source_change = false;
    e->type = V4L2_EVENT_SOURCE_CHANGE;
    e->u.src_change.changes = V4L2_EVENT_SRC_CH_RESOLUTION;
    return 0;
  }

  std::map<std::int64_t, std::vector<std::uint8_t>> memory_;
  std::vector<std::uint32_t> queue_;  // does not allocate while it streams
  std::size_t image_bytes_ = 0;
  std::uint32_t sequence_ = 0;
  std::int64_t next_frame_us_ = 0;
};

}  // namespace rsfm
