// A vector whose capacity is part of its type. Never touches the heap; a full vector refuses, it
// does not throw.
#pragma once

#include <array>
#include <cassert>
#include <cstddef>
#include <initializer_list>

namespace rsfm {

template <class T, std::size_t kCapacity>
class StaticVector {
 public:
  using value_type = T;
  using iterator = T*;
  using const_iterator = const T*;

  StaticVector() = default;
  // Precondition: values.size() <= kCapacity.
  StaticVector(std::initializer_list<T> values) {
    assert(values.size() <= kCapacity);
    for (const T& value : values) TryPushBack(value);
  }

  static constexpr std::size_t capacity() { return kCapacity; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  bool full() const { return size_ == kCapacity; }
  void clear() { size_ = 0; }

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
    if (size > kCapacity) return false;
    for (std::size_t i = size_; i < size; ++i) values_[i] = T{};
    size_ = size;
    return true;
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
  T* data() { return values_.data(); }
  const T* data() const { return values_.data(); }
  iterator begin() { return values_.data(); }
  iterator end() { return values_.data() + size_; }
  const_iterator begin() const { return values_.data(); }
  const_iterator end() const { return values_.data() + size_; }

 private:
  std::array<T, kCapacity> values_{};
  std::size_t size_ = 0;
};

}  // namespace rsfm
