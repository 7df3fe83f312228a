// The last N time-stamped values, oldest first, in fixed memory.
#pragma once

#include <cassert>
#include <cstddef>
#include <memory>

#include "rsfm/base/time.h"

namespace rsfm {

// T has a member `Utime utime`.
template <class T>
class TimedRingBuffer {
 public:
  // The only place that allocates. Precondition: capacity > 0.
  explicit TimedRingBuffer(std::size_t capacity)
      : values_(std::make_unique<T[]>(capacity)), capacity_(capacity) {
    assert(capacity > 0);
  }

  std::size_t capacity() const { return capacity_; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  bool full() const { return size_ == capacity_; }
  void clear() { first_ = size_ = 0; }
  std::size_t bytes() const { return capacity_ * sizeof(T); }

  // Keeps time order: a late value is moved to its place; the oldest falls out of a full buffer.
  // False, and nothing changes, for a value older than everything in a full buffer.
  bool Insert(const T& value) {
    if (full()) {
      if (value.utime < At(0).utime) return false;
      first_ = (first_ + 1) % capacity_;
      --size_;
    }
    std::size_t i = size_++;
    for (; i > 0 && At(i - 1).utime > value.utime; --i) At(i) = At(i - 1);
    At(i) = value;
    return true;
  }
  // 0 is the oldest. Precondition: i < size().
  const T& operator[](std::size_t i) const {
    assert(i < size_);
    return values_[(first_ + i) % capacity_];
  }
  const T& front() const { return (*this)[0]; }
  const T& back() const { return (*this)[size_ - 1]; }

  // Index of the first value with utime >= the given one; size() when there is none. Binary search.
  std::size_t LowerBound(Utime utime) const {
    std::size_t low = 0, high = size_;
    while (low < high) {
      const std::size_t middle = (low + high) / 2;
      if ((*this)[middle].utime < utime) {
        low = middle + 1;
      } else {
        high = middle;
      }
    }
    return low;
  }

 private:
  T& At(std::size_t i) { return values_[(first_ + i) % capacity_]; }

  std::unique_ptr<T[]> values_;
  std::size_t capacity_ = 0;
  std::size_t first_ = 0;
  std::size_t size_ = 0;
};

}  // namespace rsfm
