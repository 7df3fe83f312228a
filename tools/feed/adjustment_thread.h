// The window's adjustment between two images, on a thread of its own: the pose is on the bus before
// it begins, and the next image's features are found while it runs.
#pragma once

#include <atomic>
#include <functional>
#include <semaphore>
#include <thread>

#include "rsfm/mapping/incremental_mapper.h"

namespace rsfm {

class AdjustmentThread {
 public:
  // The thread calls `set_up` first. `mapper` outlives this.
  AdjustmentThread(IncrementalMapper* mapper, std::function<void()> set_up);
  ~AdjustmentThread();
  AdjustmentThread(const AdjustmentThread&) = delete;
  AdjustmentThread& operator=(const AdjustmentThread&) = delete;

  // Of one thread, in turns: after IncrementalMapper::Step, and before the next.
  void Start() noexcept;
  void Wait() noexcept;  // until what was started has ended; at once where nothing was

 private:
  void Run();

  IncrementalMapper* mapper_;
  std::function<void()> set_up_;
  std::atomic<bool> stop_ = false;
  std::binary_semaphore wanted_{0}, done_{0};
  bool is_started_ = false;
  std::thread thread_;
};

}  // namespace rsfm
