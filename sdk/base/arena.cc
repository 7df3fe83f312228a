#include "rsfm/base/arena.h"

#include <cstdint>

namespace rsfm {

void* Arena::TryTake(std::size_t count, std::size_t size, std::size_t alignment) noexcept {
  const auto base = reinterpret_cast<std::uintptr_t>(block_.get());
  const std::size_t start = ((base + used_ + alignment - 1) / alignment) * alignment - base;
  if (start > capacity_ || count > (capacity_ - start) / size) return nullptr;
  used_ = start + count * size;
  if (used_ > peak_) peak_ = used_;
  return block_.get() + start;
}

}  // namespace rsfm
