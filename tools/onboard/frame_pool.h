// Images in fixed memory, shared by the mapper and the recorder.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "rsfm/base/time.h"

namespace rsfm {

struct Frame {
  std::vector<std::uint8_t> grey;      // rows without padding
  Utime utime = 0;                     // mid-exposure
  std::int64_t origin_us = 0;          // the same on the monotonic clock
  std::int64_t nav_until = INT64_MAX;  // navigation samples that belong before this image
  std::string image;  // its name below the mission's images; empty: it is not recorded
  std::atomic<int> users = 0;
};

class FramePool {
 public:
  // The only place that allocates.
  FramePool(int count, std::size_t bytes_each) : frames_(static_cast<std::size_t>(count)) {
    for (auto& frame : frames_) {
      frame = std::make_unique<Frame>();
      frame->grey.resize(bytes_each);
      frame->image.reserve(kMaxName);
    }
  }
  static constexpr std::size_t kMaxName = 63;

  // A frame nobody uses, with one user now; null when there is none.
  Frame* Acquire() {
    for (auto& frame : frames_) {
      int nobody = 0;
      if (frame->users.compare_exchange_strong(nobody, 1)) return frame.get();
    }
    return nullptr;
  }
  static void Retain(Frame* frame) { ++frame->users; }
  static void Release(Frame* frame) { --frame->users; }

 private:
  std::vector<std::unique_ptr<Frame>> frames_;
};

}  // namespace rsfm
