#include "rsfm_drivers/v4l2/capture.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <limits>

namespace rsfm {
namespace {

constexpr std::int64_t kTrackPeriodUs = 1'000'000;
constexpr std::int64_t kErrorPauseUs = 1000;  // poll reports an error at once, again and again

}  // namespace

Capture::Capture(VideoSystem* system, const CaptureOptions& options, int width, int height)
    : system_(system), options_(options), width_(width), height_(height) {}

std::int64_t Capture::WatchdogUs() const {
  if (options_.watchdog_s > 0.0) return std::llround(1e6 * options_.watchdog_s);
  const double period_us = format_.frame_rate_hz > 0.0 ? 1e6 / format_.frame_rate_hz : 0.0;
  return std::max<std::int64_t>(1'000'000, std::llround(10.0 * period_us));
}

// Exposure and the distance of the clocks, once a second: both drift slowly, and a control of a USB
// camera costs a transfer.
void Capture::TrackClock(std::int64_t now_us) {
  if (offset_.is_known() && now_us - last_track_us_ < kTrackPeriodUs) return;
  last_track_us_ = now_us;
  std::int64_t best_before = 0, best_after = std::numeric_limits<std::int64_t>::max();
  Utime best_utc = 0;
  for (int i = 0; i < 3; ++i) {
    const std::int64_t before = system_->MonotonicUs();
    const Utime utc = system_->UtcUs();
    const std::int64_t after = system_->MonotonicUs();
    if (after - before >= best_after - best_before) continue;
    best_before = before;
    best_after = after;
    best_utc = utc;
  }
  offset_.Track(best_before, best_utc, best_after);
  // Times increase from one set clock to the next; what a set clock means is the mapper's to judge.
  if (counters_.clock_steps != offset_.num_steps()) last_utime_ = INT64_MIN;
  counters_.clock_steps = offset_.num_steps();
  exposure_us_ = device_->ExposureUs();
  failures_.Take(device_->failures());
}

// With the controls that wait; where only they are in the way, without.
IoExpected<VideoDevice> Capture::OpenDevice() {
  if (!waiting_) return VideoDevice::Open(system_, options_, width_, height_);
  auto device = VideoDevice::Open(system_, *waiting_, width_, height_);
  if (device) {
    options_ = std::move(*waiting_);
    waiting_.reset();
    return device;
  }
  auto as_before = VideoDevice::Open(system_, options_, width_, height_);
  if (!as_before) return device;
  control_problem_ = std::move(device.error());
  waiting_.reset();
  return as_before;
}

IoStatus Capture::Open() {
  if (device_) return {};
  auto device = OpenDevice();
  const std::int64_t now_us = system_->MonotonicUs();
  retry_at_us_ = now_us + retry_after_us_;
  retry_after_us_ = std::min(2 * retry_after_us_, kLastRetryUs);
  if (!device) {
    ++counters_.failed_openings;
    last_problem_ = device.error();
    return Fail(device.error());
  }
  auto converter = GreyConverter::Create(device->format().raw);
  if (!converter) {
    ++counters_.failed_openings;
    last_problem_ = Diagnostic{Errc::kIo, options_.device, converter.error().where,
                               "of the stream is not one that can be read", ""};
    return Fail(*last_problem_);
  }
  format_ = device->format();
  converter_ = std::move(*converter);
  device_ = std::make_unique<VideoDevice>(std::move(*device));
  counters_.restarts += was_open_ ? 1 : 0;
  was_open_ = true;
  has_format_to_tell_ = true;
  has_sequence_ = false;
  num_bad_since_ = 0;
  io_errors_in_a_row_ = 0;
  last_good_us_ = now_us;
  last_track_us_ = now_us - kTrackPeriodUs;
  TrackClock(now_us);
  return {};
}

void Capture::CloseDevice() {
  device_->Stop();
  failures_.Take(device_->failures());
  device_.reset();
}

Capture::Result Capture::Failed(Diagnostic problem, std::int64_t now_us) {
  CloseDevice();
  last_problem_ = std::move(problem);
  retry_at_us_ = now_us + retry_after_us_;
  retry_after_us_ = std::min(2 * retry_after_us_, kLastRetryUs);
  return Result::kDown;
}

Capture::Result Capture::Failed(const Error& error, std::int64_t now_us) {
  return Failed(FromErrno(error.detail, options_.device, std::string("do ") + error.where), now_us);
}

Capture::Result Capture::Retry(int timeout_ms) {
  const std::int64_t left_us = retry_at_us_ - system_->MonotonicUs();
  const std::int64_t timeout_us = static_cast<std::int64_t>(timeout_ms) * 1000;
  if (left_us > 0) system_->Wait(std::min(left_us, timeout_us));
  if (left_us > timeout_us) return Result::kDown;
  return Open() ? Result::kNothing : Result::kDown;
}

Capture::Result Capture::Nothing(std::int64_t now_us) {
  if (now_us - last_good_us_ < WatchdogUs()) return Result::kNothing;
  return Failed(
      {Errc::kIo, options_.device, "",
       "has given no whole frame for " + std::to_string((now_us - last_good_us_) / 1000) + " ms",
       "see its cable and power; with an external trigger, set capture.watchdog_s"},
      now_us);
}

Capture::Result Capture::Next(int timeout_ms, std::uint8_t* grey, CapturedFrame* frame) {
  if (!device_) return Retry(timeout_ms);
  unsigned events = 0;
  if (const int error = system_->Poll(device_->fd(), timeout_ms, &events); error != 0)
    return Failed(Error{Errc::kIo, "poll", error}, system_->MonotonicUs());
  if ((events & VideoSystem::kException) != 0) {
    const bool has_changed = device_->SourceHasChanged();
    failures_.Take(device_->failures());
    if (has_changed) {
      return Failed(
          {Errc::kIo, options_.device, "", "has changed its format", "it is opened again"},
          system_->MonotonicUs());
    }
  }
  if ((events & (VideoSystem::kReadable | VideoSystem::kError)) == 0) {
    // An event that could not be taken: poll would report it again at once.
    if (events != 0) system_->Wait(kErrorPauseUs);
    return Nothing(system_->MonotonicUs());
  }
  const Result result = Take(grey, frame);
  // An error that brought no frame: poll would report it again at once.
  if (result == Result::kNothing && (events & VideoSystem::kError) != 0)
    system_->Wait(kErrorPauseUs);
  return result;
}

bool Capture::Convert(const RawFrame& raw, std::uint8_t* grey) {
  return !raw.is_damaged && converter_->Convert(raw.data, grey).has_value();
}

// A bad buffer is counted by itself, and its number, if it has one, cannot be relied on.
void Capture::CountGap(const RawFrame& raw) {
  if (raw.is_damaged) {
    ++num_bad_since_;
    return;
  }
  // Devices that do not count repeat a number; a step back is a new start.
  const std::uint32_t gap = raw.sequence - last_sequence_ - 1;
  if (has_sequence_ && gap < 0x80000000u) counters_.missed += gap - std::min(gap, num_bad_since_);
  has_sequence_ = true;
  last_sequence_ = raw.sequence;
  num_bad_since_ = 0;
}

bool Capture::SetTime(const RawFrame& raw, std::int64_t arrival_us, CapturedFrame* frame) {
  TrackClock(arrival_us);
  StampKind kind = raw.stamp_kind;
  std::int64_t stamp_us = raw.stamp_us;
  if (kind != StampKind::kNone && !IsPlausibleStamp(stamp_us, arrival_us)) {
    ++counters_.bad_stamps;
    kind = StampKind::kNone;
  }
  if (kind == StampKind::kNone) stamp_us = arrival_us;
  const std::int64_t middle_us = MidExposureUs(kind, stamp_us, exposure_us_, options_);
  const Utime utime = offset_.ToUtc(middle_us);
  if (utime <= last_utime_) {
    ++counters_.late;
    return false;
  }
  last_utime_ = utime;
  *frame = {utime, middle_us, raw.sequence};
  return true;
}

Capture::Result Capture::Take(std::uint8_t* grey, CapturedFrame* frame) {
  RawFrame raw;
  const Status status = device_->Dequeue(&raw);
  const std::int64_t now_us = system_->MonotonicUs();
  if (!status) {
    if (status.error().detail == EAGAIN) return Nothing(now_us);
    if (status.error().detail != EIO) return Failed(status.error(), now_us);
    ++counters_.io_errors;
    ++num_bad_since_;
    return ++io_errors_in_a_row_ < kMaxIoErrors ? Nothing(now_us) : Failed(status.error(), now_us);
  }
  io_errors_in_a_row_ = 0;
  CountGap(raw);
  const bool is_whole = Convert(raw, grey);
  if (const Status requeued = device_->Requeue(raw.index); !requeued)
    return Failed(requeued.error(), now_us);
  if (!is_whole) {
    ++counters_.damaged;
    return Nothing(now_us);
  }
  last_good_us_ = now_us;
  retry_after_us_ = kFirstRetryUs;
  last_problem_.reset();
  if (!SetTime(raw, now_us, frame)) return Result::kNothing;
  ++counters_.frames;
  return Result::kFrame;
}

IoStatus Capture::ChangeControls(const CaptureOptions& options) {
  CaptureOptions changed = options_;
  changed.exposure_us = options.exposure_us;
  changed.gain = options.gain;
  changed.controls = options.controls;
  control_problem_.reset();
  waiting_.reset();
  if (!device_) {
    waiting_ = std::move(changed);
    retry_at_us_ = 0;  // they may be what it takes
    return {};
  }
  IoStatus status = device_->SetControls(changed);
  if (status) {
    options_ = std::move(changed);
  } else if (const auto s = device_->SetControls(options_); !s) {
    status.error().problem += "; those before could not be set again: " + ToString(s.error());
    waiting_ = std::move(changed);  // for the next opening: it has vanished, most likely
  }
  exposure_us_ = device_->ExposureUs();
  failures_.Take(device_->failures());
  return status;
}

std::vector<std::string> Capture::TakeNews() {
  std::vector<std::string> news;
  if (has_format_to_tell_) {
    has_format_to_tell_ = false;
    std::string text = options_.device + ": " + ToString(format_);
    if (text != format_told_) news.push_back(text);
    format_told_ = std::move(text);
  }
  for (; num_failures_told_ < failures_.size(); ++num_failures_told_)
    news.push_back(options_.device + ": " + ToString(failures_[num_failures_told_]));
  if (num_steps_told_ != counters_.clock_steps) {
    num_steps_told_ = counters_.clock_steps;
    char text[80];
    std::snprintf(text, sizeof text, "the system's clock was set by %+.3f s: images follow it",
                  1e-6 * static_cast<double>(offset_.last_step_us()));
    news.emplace_back(text);
  }
  return news;
}

}  // namespace rsfm
