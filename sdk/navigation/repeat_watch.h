// Tells a sensor that has stopped, while its driver goes on sending the last value, from one that
// measures. A measurement's noise changes its last bits; how often values repeat all the same
// (a coarse resolution, a slow sensor on a fast bus) differs from sensor to sensor and is learned.
#pragma once

#include <cmath>

#include "rsfm/base/linear.h"
#include "rsfm/base/time.h"

namespace rsfm {

class RepeatWatch {
 public:
  // A run of equal values less probable than this is no chance.
  static constexpr double kMaxProbability = 1e-9;

  // The sensor's next value; unused components are 0. False: it is one of a run of values the same
  // to the last bit that this sensor, by how often its values have repeated before, would not send.
  // The first value that differs is taken again. One of the same time is the same message once more
  // and does not count.
  //
  // Each value repeats the one before with an unknown probability, beta distributed a priori with
  // (1, 1): after e repeats in n pairs the next repeats with (e + 1) / (n + 2), Laplace's rule of
  // succession. The product over a run is the run's probability. A sensor that has never sent
  // anything else is never refused: n repeats and no change have a probability of 1 / (n + 1).
  bool Take(Utime utime, const Vec4& value) noexcept {
    if (has_last_ && utime == last_utime_) return IsChance();
    const bool repeats = has_last_ && value == last_;
    if (repeats) {
      log_probability_ += std::log((num_repeats_ + 1.0) / (num_pairs_ + 2.0));
      num_repeats_ += 1.0;
    } else {
      log_probability_ = 0.0;
    }
    if (has_last_) num_pairs_ += 1.0;
    last_ = value;
    last_utime_ = utime;
    has_last_ = true;
    return IsChance();
  }

 private:
  bool IsChance() const { return log_probability_ >= std::log(kMaxProbability); }

  Vec4 last_ = Vec4::Zero();
  Utime last_utime_ = 0;
  bool has_last_ = false;
  double num_pairs_ = 0.0, num_repeats_ = 0.0;  // counts, exact up to 2^53
  double log_probability_ = 0.0;                // of the run that the last value belongs to
};

}  // namespace rsfm
