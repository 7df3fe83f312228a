// One opened camera that streams. What goes wrong is named by its ioctl and errno.
//
// Ownership: the device owns its descriptor and the mappings of its pool of buffers. A dequeued
// frame points into such a mapping: it is the caller's until Requeue() with its index, and gone
// with the device. Every frame must be given back, or the device runs out of buffers.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rsfm/base/static_vector.h"
#include "rsfm/io/diagnostic.h"
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

// All plain number controls of a device. Empty where it lists none.
std::vector<ControlInfo> ListControls(VideoSystem* system, int fd);

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

  // Exposure, gain and the rest again, on a running stream.
  IoStatus SetControls(const CaptureOptions& options);
  // As the device has it now; 0 where it does not say.
  double ExposureUs() noexcept;

  int fd() const { return fd_.get(); }
  const StreamFormat& format() const { return format_; }

 private:
  struct Buffer {
    void* data = nullptr;
    std::size_t bytes = 0;
  };

  VideoDevice(VideoSystem* system, UniqueFd fd, std::string path)
      : system_(system), fd_(std::move(fd)), path_(std::move(path)) {}
  IoStatus Check();
  IoStatus MapBuffers(int count);
  IoStatus Start();
  void Stop() noexcept;
  IoStatus SetExposure(double exposure_us);
  IoStatus SetGain(double gain);
  IoStatus Set(std::uint32_t id, std::int64_t value, const std::string& field);

  VideoSystem* system_;
  UniqueFd fd_;
  std::string path_;
  StreamFormat format_;
  StaticVector<Buffer, kMaxBuffers> buffers_;
  bool is_streaming_ = false;
  bool has_exposure_ = true;  // until an ioctl says otherwise
};

}  // namespace rsfm
