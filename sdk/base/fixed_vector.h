// A vector whose capacity is set once, at construction (the only moment it allocates). A full
// vector refuses.
#pragma once

#include <cassert>
#include <cstddef>
#include <memory>
#include <span>

namespace rsfm {

template <class T>
class FixedVector {
 public:
  using value_type = T;
  using iterator = T*;
  using const_iterator = const T*;

  FixedVector() = default;
  explicit FixedVector(std::size_t capacity)
      : values_(std::make_unique<T[]>(capacity)), capacity_(capacity) {}

  std::size_t capacity() const { return capacity_; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  bool full() const { return size_ == capacity_; }
  void clear() { size_ = 0; }
  // Bytes on the heap, for the memory plan.
  std::size_t bytes() const { return capacity_ * sizeof(T); }

  // False, and nothing changes, when full.
  bool TryPushBack(const T& value) {
    if (full()) return false;
    values_[size_++] = value;
    return true;
  }
  // Precondition: not empty.
  void pop_back() {
    assert(!empty());
    --size_;
  }
  // False, and nothing changes, beyond the capacity. New elements are value-initialised.
  bool TryResize(std::size_t size) {
    if (size > capacity_) return false;
    for (std::size_t i = size_; i < size; ++i) values_[i] = T{};
    size_ = size;
    return true;
  }
  // The same, but new elements hold any value: for buffers that are written before they are read.
  bool TryResizeForOverwrite(std::size_t size) {
    if (size > capacity_) return false;
    size_ = size;
    return true;
  }
  // Moves the last element into place i: O(1), order is not kept.
  void SwapRemove(std::size_t i) {
    assert(i < size_);
    values_[i] = values_[size_ - 1];
    --size_;
  }

  T& operator[](std::size_t i) {
    assert(i < size_);
    return values_[i];
  }
  const T& operator[](std::size_t i) const {
    assert(i < size_);
    return values_[i];
  }
  T& back() { return (*this)[size_ - 1]; }
  const T& back() const { return (*this)[size_ - 1]; }
  T* data() { return values_.get(); }
  const T* data() const { return values_.get(); }
  iterator begin() { return values_.get(); }
  iterator end() { return values_.get() + size_; }
  const_iterator begin() const { return values_.get(); }
  const_iterator end() const { return values_.get() + size_; }
  std::span<T> span() { return {values_.get(), size_}; }
  std::span<const T> span() const { return {values_.get(), size_}; }

 private:
  std::unique_ptr<T[]> values_;
  std::size_t capacity_ = 0;
  std::size_t size_ = 0;
};

}  // namespace rsfm
