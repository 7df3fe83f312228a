// One opened camera that streams. What goes wrong is named by its ioctl and errno.
//
// Ownership: the device owns its descriptor and the mappings of its pool of buffers. A dequeued
// frame points into such a mapping: it is the caller's until Requeue() with its index, and gone
// with the device. Every frame must be given back, or the device runs out of buffers.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "rsfm/base/static_vector.h"
#include "rsfm/io/diagnostic.h"
#include "rsfm_drivers/v4l2/call_failures.h"
#include "rsfm_drivers/v4l2/format_choice.h"
#include "rsfm_drivers/v4l2/frame_clock.h"
#include "rsfm_drivers/v4l2/video_system.h"

namespace rsfm {

struct RawFrame {
  std::span<const std::uint8_t> data;
  std::uint32_t index = 0;     // of the buffer: for Requeue()
  std::uint32_t sequence = 0;  // of the device; gaps are frames that were lost
  StampKind stamp_kind = StampKind::kNone;
  std::int64_t stamp_us = 0;  // monotonic
  bool is_damaged = false;    // the device says so (V4L2_BUF_FLAG_ERROR)
};

struct ControlInfo {
  std::uint32_t id = 0;
  std::string name;  // lower case with underscores: "exposure_time_absolute"
  std::int64_t minimum = 0, maximum = 0, step = 0, default_value = 0, value = 0;
  bool is_writable = false;  // now: false while something automatic holds it, too
};

// All plain number controls of a device. Empty where it lists none; a list that breaks off and a
// value that cannot be read add to `failures`.
std::vector<ControlInfo> ListControls(VideoSystem* system, int fd, CallFailures* failures);

class VideoDevice {
 public:
  static constexpr int kMaxBuffers = 32;

  // Opens, sets format, rate and controls, maps the pool and starts the stream: a device that
  // exists streams.
  static IoExpected<VideoDevice> Open(VideoSystem* system, const CaptureOptions& options, int width,
                                      int height);
  VideoDevice(VideoDevice&& other) noexcept;
  VideoDevice& operator=(VideoDevice&& other) = delete;
  ~VideoDevice();

  // kIo with `where` the ioctl and `detail` the errno; EAGAIN: no frame is there. Never allocates.
  Status Dequeue(RawFrame* frame) noexcept;
  Status Requeue(std::uint32_t index) noexcept;
  // Takes all events that wait; true when one says that the source's format has changed.
  bool SourceHasChanged() noexcept;

  // Exposure, gain and the rest again, on a running stream. What was asked for must be granted, or
  // it is an error; an automatic that cannot be switched on is a failed call.
  IoStatus SetControls(const CaptureOptions& options);
  // As the device has it now, or had it when it could last be read; 0 where it has no such control.
  double ExposureUs() noexcept;

  // Ends the stream and gives the memory back: what the destructor does. No frame is left then.
  void Stop() noexcept;
  // Calls that failed and stopped nothing, since they were last taken from here.
  CallFailures* failures() { return &failures_; }

  int fd() const { return fd_.get(); }
  const StreamFormat& format() const { return format_; }

 private:
  struct Buffer {
    void* data = nullptr;
    std::size_t bytes = 0;
  };
  struct SwitchCalls;

  VideoDevice(VideoSystem* system, UniqueFd fd, std::string path)
      : system_(system), fd_(std::move(fd)), path_(std::move(path)) {}
  IoStatus Check();
  IoStatus MapBuffers(int count);
  IoStatus Start();
  // The call that failed, or nothing: it is switched, or there is no such control.
  std::optional<CallFailure> Switch(const SwitchCalls& calls, std::int32_t value) noexcept;
  IoStatus Report(const std::optional<CallFailure>& failure);
  IoStatus MustSwitch(const SwitchCalls& calls, std::int32_t value, const char* field);
  IoStatus SetExposure(double exposure_us);
  IoStatus SetGain(double gain);
  IoStatus Set(std::uint32_t id, std::int64_t value, const std::string& field);

  VideoSystem* system_;
  UniqueFd fd_;
  std::string path_;
  StreamFormat format_;
  StaticVector<Buffer, kMaxBuffers> buffers_;
  bool is_streaming_ = false;
  bool has_exposure_ = true;  // until the device says otherwise
  double exposure_us_ = 0.0;  // when it was last read or set
  CallFailures failures_;
};

}  // namespace rsfm
