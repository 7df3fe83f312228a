// When an image was exposed, in UTC, from what the device says about its buffer.
#pragma once

#include <cstdint>

#include "rsfm/base/time.h"
#include "rsfm/io/onboard_options.h"

namespace rsfm {

enum class StampKind : std::uint8_t {
  kNone,   // no usable clock: the moment of arrival is taken for the end of the frame
  kStart,  // monotonic, start of exposure of the first row (V4L2_BUF_FLAG_TSTAMP_SRC_SOE)
  kEnd,    // monotonic, last pixel received
};

// UTC minus the monotonic clock. Frames are stamped by the second, navigation by the first; that
// difference moves as the system's clock is disciplined. Small changes are followed smoothly, so
// that images keep their spacing; a set clock is followed at once.
class ClockOffset {
 public:
  static constexpr std::int64_t kStepUs = 10'000;

  // One reading of UTC between two of the monotonic clock. A reading that took long says little: it
  // is followed only where the clock was set by more than it leaves open.
  void Track(std::int64_t monotonic_before_us, Utime utc, std::int64_t monotonic_after_us);
  Utime ToUtc(std::int64_t monotonic_us) const {
    return monotonic_us + static_cast<std::int64_t>(offset_us_);
  }
  bool is_known() const { return is_known_; }
  std::int64_t num_steps() const { return num_steps_; }
  std::int64_t last_step_us() const { return last_step_us_; }  // negative: set back

 private:
  static constexpr std::int64_t kMaxReadingUs = 1000;

  double offset_us_ = 0.0;  // 1.7e15: exact to a quarter of a microsecond
  bool is_known_ = false;
  std::int64_t num_steps_ = 0, last_step_us_ = 0;
};

// The moment in the middle of an image's exposure, of the middle row for a rolling shutter, on the
// clock of `stamp_us`. Global shutter: read-out follows exposure.
std::int64_t MidExposureUs(StampKind kind, std::int64_t stamp_us, double exposure_us,
                           const CaptureOptions& options);

// A stamp more than this after its arrival, or kOldestStampUs before it, is none. (vivid stamps up
// to a frame ahead; buffers wait while the reader is held up.)
inline constexpr std::int64_t kFurthestStampUs = 500'000;
inline constexpr std::int64_t kOldestStampUs = 10'000'000;
bool IsPlausibleStamp(std::int64_t stamp_us, std::int64_t arrival_us);

}  // namespace rsfm
