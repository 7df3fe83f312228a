// Elements with stable handles in fixed memory. A handle outlives its element safely: a generation
// count tells a reused slot from the element the handle was made for.
#pragma once

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>

namespace rsfm {

struct SlotId {
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;
  std::uint32_t index = kNone;
  std::uint32_t generation = 0;

  bool valid() const { return index != kNone; }
  friend bool operator==(const SlotId&, const SlotId&) = default;
};

template <class T>
class SlotMap {
 public:
  // The only place that allocates.
  explicit SlotMap(std::size_t capacity)
      : slots_(std::make_unique<Slot[]>(capacity)), capacity_(capacity) {
    for (std::size_t i = 0; i < capacity; ++i)
      slots_[i].next_free = static_cast<std::uint32_t>(i + 1);
  }

  std::size_t capacity() const { return capacity_; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  bool full() const { return size_ == capacity_; }
  std::size_t bytes() const { return capacity_ * sizeof(Slot); }

  // nullopt, and nothing changes, when full.
  std::optional<SlotId> TryInsert(const T& value) {
    if (full()) return std::nullopt;
    const std::uint32_t index = first_free_;
    Slot& slot = slots_[index];
    first_free_ = slot.next_free;
    slot.value = value;
    slot.used = true;
    ++size_;
    return SlotId{index, slot.generation};
  }
  // False when the handle is stale or none.
  bool Erase(SlotId id) {
    if (!Contains(id)) return false;
    Slot& slot = slots_[id.index];
    slot.used = false;
    ++slot.generation;
    slot.next_free = first_free_;
    first_free_ = id.index;
    --size_;
    return true;
  }
  bool Contains(SlotId id) const {
    return id.index < capacity_ && slots_[id.index].used &&
           slots_[id.index].generation == id.generation;
  }
  // nullptr when the handle is stale or none.
  T* Find(SlotId id) { return Contains(id) ? &slots_[id.index].value : nullptr; }
  const T* Find(SlotId id) const { return Contains(id) ? &slots_[id.index].value : nullptr; }

  // f(SlotId, T&) for every element, in slot order: the same order on every run. f may erase the
  // element it is given.
  template <class F>
  void ForEach(F&& f) {
    for (std::uint32_t i = 0; i < capacity_; ++i) {
      if (slots_[i].used) f(SlotId{i, slots_[i].generation}, slots_[i].value);
    }
  }
  template <class F>
  void ForEach(F&& f) const {
    for (std::uint32_t i = 0; i < capacity_; ++i) {
      if (slots_[i].used)
        f(SlotId{i, slots_[i].generation}, static_cast<const T&>(slots_[i].value));
    }
  }
  void Clear() {
    for (std::uint32_t i = 0; i < capacity_; ++i) Erase({i, slots_[i].generation});
  }

 private:
  struct Slot {
    T value{};
    std::uint32_t generation = 0;
    std::uint32_t next_free = 0;
    bool used = false;
  };
  std::unique_ptr<Slot[]> slots_;
  std::size_t capacity_ = 0;
  std::size_t size_ = 0;
  std::uint32_t first_free_ = 0;
};

}  // namespace rsfm
