// A block of memory taken once, handed out in pieces, given back all at once: scratch space for one
// step.
#pragma once

#include <cstddef>
#include <memory>
#include <new>
#include <span>
#include <type_traits>

namespace rsfm {

class Arena {
 public:
  // The only place that allocates.
  explicit Arena(std::size_t bytes)
      : block_(std::make_unique<std::byte[]>(bytes)), capacity_(bytes) {}

  // `count` value-initialised elements, or an empty span when the block is used up (count 0 gives an empty span too).
  template <class T>
  std::span<T> TryAllocate(std::size_t count) {
    static_assert(std::is_trivially_destructible_v<T>, "Reset() runs no destructors");
    T* first = static_cast<T*>(TryTake(count, sizeof(T), alignof(T)));
    if (first == nullptr) return {};
    for (std::size_t i = 0; i < count; ++i) new (first + i) T();
    return {first, count};
  }
  // Everything handed out becomes invalid.
  void Reset() { used_ = 0; }

  std::size_t capacity() const { return capacity_; }
  std::size_t used() const { return used_; }
  std::size_t peak() const { return peak_; }  // the most ever in use, for the memory plan

 private:
  // nullptr when the block is used up.
  void* TryTake(std::size_t count, std::size_t size, std::size_t alignment) noexcept;

  std::unique_ptr<std::byte[]> block_;
  std::size_t capacity_ = 0;
  std::size_t used_ = 0;
  std::size_t peak_ = 0;
};

}  // namespace rsfm
