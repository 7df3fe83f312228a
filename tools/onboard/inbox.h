// Navigation from the bus to the mapper's queue.
#pragma once

#include <algorithm>
#include <vector>

#include "rsfm_drivers/lcm/bus.h"
#include "tools/onboard/shared.h"

namespace rsfm {

// What came from the bus, to the mapper, which logs what it takes. In fixed memory; a sensor that
// floods its channel loses its own newest samples, counted in nav_overruns, and nobody else's.
class Inbox {
 public:
  Inbox(const std::vector<BusInput>& inputs, Shared* shared) : inputs_(inputs), shared_(shared) {}

  void Take(const NavMessage& message) {
    if (message.sample == nullptr) {
      LogUnusable(message);
      return;
    }
    std::atomic<int>& waiting = shared_->nav_waiting[message.input];
    if (waiting >= shared_->nav_share) {
      ++shared_->nav_overruns;
      return;
    }
    arrival_.has_sample = true;
    arrival_.sample = *message.sample;
    arrival_.input = static_cast<std::uint16_t>(message.input);
    arrival_.received_utime = message.received_utime;
    arrival_.size = 0;
    if (message.data.size() <= arrival_.data.size()) {
      arrival_.size = static_cast<std::uint16_t>(message.data.size());
      std::copy(message.data.begin(), message.data.end(), arrival_.data.begin());
    } else {
      Log(message);
    }
    ++waiting;
    if (NavArrival dropped; shared_->nav.PushDropOldest(arrival_, &dropped)) {
      --shared_->nav_waiting[dropped.input];
      ++shared_->nav_overruns;
    }
  }

 private:
  static constexpr int kUnusablePerSecond = 20;

  // Some, for those who look for the cause; a flood does not fill the log.
  void LogUnusable(const NavMessage& message) {
    const std::int64_t second = MonotonicUs() / 1'000'000;
    if (second != second_) num_in_second_ = 0;
    second_ = second;
    if (++num_in_second_ <= kUnusablePerSecond) Log(message);
  }
  void Log(const NavMessage& message) {
    if (!shared_->has_log) return;
    shared_->log.Push(inputs_[message.input].channel, message.received_utime, {}, message.data);
  }

  const std::vector<BusInput>& inputs_;
  Shared* shared_;
  NavArrival arrival_;
  std::int64_t second_ = 0;
  int num_in_second_ = 0;
};

}  // namespace rsfm
