// A camera that stays: grey images with their time, from a device that may fail, vanish and return.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rsfm_drivers/v4l2/call_failures.h"
#include "rsfm_drivers/v4l2/frame_clock.h"
#include "rsfm_drivers/v4l2/grey.h"
#include "rsfm_drivers/v4l2/video_device.h"

namespace rsfm {

struct CaptureCounters {
  std::int64_t frames = 0;       // handed out
  std::int64_t missed = 0;       // gaps in the device's sequence numbers, without the bad buffers
  std::int64_t damaged = 0;      // marked so by the device, too short, or no JPEG
  std::int64_t late = 0;         // not newer than the one before, by the same clock
  std::int64_t restarts = 0;     // openings after the first
  std::int64_t failed_openings = 0;
  std::int64_t io_errors = 0;    // EIO of a single buffer
  std::int64_t bad_stamps = 0;   // times that cannot be: the arrival's was taken
  std::int64_t clock_steps = 0;  // the system's clock was set
};

struct CapturedFrame {
  Utime utime = 0;                   // mid-exposure; increases, but where the clock was set back
  std::int64_t mid_exposure_us = 0;  // the same on the monotonic clock
  std::uint32_t sequence = 0;
};

class Capture {
 public:
  enum class Result : std::uint8_t {
    kFrame,
    kNothing,  // no frame within the time-out; the device is open
    kDown,     // there is no device now: last_problem() says why
  };
  // The device is opened again this long after it failed: at first, doubling, at most.
  static constexpr std::int64_t kFirstRetryUs = 100'000;
  static constexpr std::int64_t kLastRetryUs = 5'000'000;
  // So many EIO one after the other close the device.
  static constexpr int kMaxIoErrors = 5;

  // For images of that size. Opens nothing.
  Capture(VideoSystem* system, const CaptureOptions& options, int width, int height);

  // Opens the device now, for a caller who wants to hear of failures at once. Next() does so too.
  IoStatus Open();
  // Waits for the next image and writes it to `grey`, width * height bytes without padding: the one
  // pass over its pixels. Never waits much longer than `timeout_ms`. Does not allocate while the
  // device streams (libjpeg-turbo's own buffers apart).
  Result Next(int timeout_ms, std::uint8_t* grey, CapturedFrame* frame);

  // Takes exposure, gain and controls of `options` on the running stream, and keeps them. What else
  // differs is not taken. On failure the options are as they were, and so is the device as far as
  // it lets itself be set back. While there is no device they wait for it: where it then opens with
  // the controls before and not with these, these are dropped, and control_problem() says why.
  IoStatus ChangeControls(const CaptureOptions& options);

  const CaptureCounters& counters() const { return counters_; }
  const std::optional<Diagnostic>& last_problem() const { return last_problem_; }
  // Why controls that were changed while there was no device are not taken; until the next change.
  const std::optional<Diagnostic>& control_problem() const { return control_problem_; }
  // Calls that failed without stopping the camera, since the beginning.
  const CallFailures& failures() const { return failures_; }
  // What a log should have, line by line, and has not had from here: how the device was opened
  // where that is new, calls that failed (each kind once), clocks that were set. Without news it is
  // empty and does not allocate.
  std::vector<std::string> TakeNews();
  bool is_open() const { return device_ != nullptr; }
  const StreamFormat& format() const { return format_; }

 private:
  Result Failed(Diagnostic problem, std::int64_t now_us);
  Result Failed(const Error& error, std::int64_t now_us);
  void CloseDevice();
  IoExpected<VideoDevice> OpenDevice();
  Result Retry(int timeout_ms);
  Result Take(std::uint8_t* grey, CapturedFrame* frame);
  Result Nothing(std::int64_t now_us);
  bool Convert(const RawFrame& raw, std::uint8_t* grey);
  bool SetTime(const RawFrame& raw, std::int64_t arrival_us, CapturedFrame* frame);
  void CountGap(const RawFrame& raw);
  void TrackClock(std::int64_t now_us);
  std::int64_t WatchdogUs() const;

  VideoSystem* system_;
  CaptureOptions options_;
  int width_, height_;
  std::unique_ptr<VideoDevice> device_;
  std::optional<GreyConverter> converter_;
  StreamFormat format_;
  ClockOffset offset_;
  CaptureCounters counters_;
  std::optional<Diagnostic> last_problem_, control_problem_;
  std::optional<CaptureOptions> waiting_;  // with controls for the next opening
  CallFailures failures_;
  std::size_t num_failures_told_ = 0;
  std::int64_t num_steps_told_ = 0;
  std::string format_told_;
  bool has_format_to_tell_ = false;
  double exposure_us_ = 0.0;
  bool was_open_ = false;
  bool has_sequence_ = false;
  std::uint32_t last_sequence_ = 0;
  std::uint32_t num_bad_since_ = 0;  // buffers since then: a gap may be theirs
  Utime last_utime_ = INT64_MIN;
  int io_errors_in_a_row_ = 0;
  std::int64_t last_good_us_ = 0;   // monotonic, of the last whole frame or the opening
  std::int64_t last_track_us_ = 0;  // of the clocks
  std::int64_t retry_at_us_ = 0;
  std::int64_t retry_after_us_ = kFirstRetryUs;
};

}  // namespace rsfm
