#include "rsfm_drivers/v4l2/frame_clock.h"

#include <cmath>

namespace rsfm {

void ClockOffset::Track(std::int64_t monotonic_before_us, Utime utc,
                        std::int64_t monotonic_after_us) {
  const std::int64_t middle = monotonic_before_us + (monotonic_after_us - monotonic_before_us) / 2;
  const auto measured = static_cast<double>(utc - middle);
  const std::int64_t reading_us = monotonic_after_us - monotonic_before_us;
  const double change = measured - offset_us_;
  if (!is_known_ || std::abs(change) > static_cast<double>(kStepUs + reading_us / 2)) {
    if (is_known_) {
      ++num_steps_;
      last_step_us_ = std::llround(change);
    }
    offset_us_ = measured;
    is_known_ = true;
    return;
  }
  if (reading_us <= kMaxReadingUs) offset_us_ += change / 8.0;
}

std::int64_t MidExposureUs(StampKind kind, std::int64_t stamp_us, double exposure_us,
                           const CaptureOptions& options) {
  const double half = 0.5 * exposure_us, readout = options.readout_us;
  double to_middle = 0.0;
  if (kind == StampKind::kStart) {
    to_middle = options.rolling_shutter ? half + 0.5 * readout : half;
  } else {
    to_middle = options.rolling_shutter ? -half - 0.5 * readout : -half - readout;
  }
  return stamp_us + std::llround(to_middle + options.time_offset_us);
}

bool IsPlausibleStamp(std::int64_t stamp_us, std::int64_t arrival_us) {
  return stamp_us > 0 && stamp_us - arrival_us <= kFurthestStampUs &&
         arrival_us - stamp_us <= kOldestStampUs;
}

}  // namespace rsfm
