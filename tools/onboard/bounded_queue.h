// A queue between two threads in fixed memory, with the drop policies of docs/onboard.md.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>

#include "rsfm/base/fixed_vector.h"

namespace rsfm {

template <class T>
class BoundedQueue {
 public:
  // The only place that allocates.
  explicit BoundedQueue(std::size_t capacity) : values_(capacity) {
    static_cast<void>(values_.TryResize(capacity));
  }

  // The newest counts: when full, the oldest falls out into *dropped and the result is true.
  bool PushDropOldest(const T& value, T* dropped) {
    bool has_dropped = false;
    {
      const std::scoped_lock lock(mutex_);
      if (size_ == values_.size()) {
        *dropped = values_[first_];
        first_ = (first_ + 1) % values_.size();
        --size_;
        has_dropped = true;
      }
      Put(value);
    }
    changed_.notify_all();
    return has_dropped;
  }
  // What waits counts: false, and nothing changes, when full.
  bool TryPush(const T& value) {
    {
      const std::scoped_lock lock(mutex_);
      if (size_ == values_.size()) return false;
      Put(value);
    }
    changed_.notify_all();
    return true;
  }
  // Everything counts: waits for room; false after the time-out.
  bool PushWait(const T& value, int timeout_ms) {
    {
      std::unique_lock lock(mutex_);
      if (!changed_.wait_for(lock, std::chrono::milliseconds(timeout_ms),
                             [&] { return size_ < values_.size(); })) {
        return false;
      }
      Put(value);
    }
    changed_.notify_all();
    return true;
  }
  // False after the time-out, or at once when the queue is empty and closed.
  bool Pop(int timeout_ms, T* value) {
    {
      std::unique_lock lock(mutex_);
      changed_.wait_for(lock, std::chrono::milliseconds(timeout_ms),
                        [&] { return size_ > 0 || is_closed_; });
      if (size_ == 0) return false;
      *value = values_[first_];
      first_ = (first_ + 1) % values_.size();
      --size_;
    }
    changed_.notify_all();
    return true;
  }
  // Nothing more is coming.
  void Close() {
    {
      const std::scoped_lock lock(mutex_);
      is_closed_ = true;
    }
    changed_.notify_all();
  }
  bool IsFull() const {
    const std::scoped_lock lock(mutex_);
    return size_ == values_.size();
  }
  bool IsEmpty() const {
    const std::scoped_lock lock(mutex_);
    return size_ == 0;
  }
  bool IsFinished() const {
    const std::scoped_lock lock(mutex_);
    return size_ == 0 && is_closed_;
  }

 private:
  void Put(const T& value) {
    values_[(first_ + size_) % values_.size()] = value;
    ++size_;
  }

  FixedVector<T> values_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t first_ = 0, size_ = 0;
  bool is_closed_ = false;
};

}  // namespace rsfm
