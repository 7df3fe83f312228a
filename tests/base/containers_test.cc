#include <gtest/gtest.h>

#include <vector>

#include "rsfm/base/arena.h"
#include "rsfm/base/fixed_vector.h"
#include "rsfm/base/ring_buffer.h"
#include "rsfm/base/slot_map.h"
#include "rsfm/base/static_vector.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

TEST(StaticVector, FillsRefusesAndKeepsOrder) {
  StaticVector<int, 3> v;
  EXPECT_TRUE(v.empty());
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(v.TryPushBack(i));
  EXPECT_FALSE(v.TryPushBack(3));
  EXPECT_EQ(std::vector<int>(v.begin(), v.end()), (std::vector<int>{0, 1, 2}));
  EXPECT_FALSE(v.TryResize(4));
  EXPECT_EQ(v.size(), 3u);
  v.pop_back();
  EXPECT_TRUE(v.TryResize(3));
  EXPECT_EQ(v.back(), 0);
}

TEST(FixedVector, AllocatesOnceAndRefusesWhenFull) {
  FixedVector<int> v(4);
  MallocTrap trap;
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(v.TryPushBack(i));
  EXPECT_FALSE(v.TryPushBack(9));
  v.SwapRemove(0);
  EXPECT_EQ(trap.count(), 0u);
  EXPECT_EQ(v.size(), 3u);
  EXPECT_EQ(v[0], 3);
  EXPECT_EQ(v.bytes(), 16u);
}

TEST(SlotMap, StaleHandlesFindNothing) {
  SlotMap<int> map(2);
  const SlotId a = *map.TryInsert(10);
  const SlotId b = *map.TryInsert(20);
  EXPECT_FALSE(map.TryInsert(30).has_value());
  EXPECT_TRUE(map.Erase(a));
  EXPECT_FALSE(map.Erase(a));
  EXPECT_EQ(map.Find(a), nullptr);
  const SlotId c = *map.TryInsert(30);
  EXPECT_EQ(c.index, a.index);
  EXPECT_EQ(map.Find(a), nullptr);
  EXPECT_EQ(*map.Find(c), 30);
  EXPECT_EQ(*map.Find(b), 20);
  EXPECT_EQ(map.Find(SlotId{}), nullptr);
}

TEST(SlotMap, EraseWhileVisitingAndReuseWithoutHeap) {
  SlotMap<int> map(100);
  MallocTrap trap;
  for (int round = 0; round < 5; ++round) {
    for (int i = 0; i < 100; ++i) ASSERT_TRUE(map.TryInsert(i).has_value());
    int sum = 0;
    map.ForEach([&](SlotId id, int& value) {
      sum += value;
      if (value % 2) map.Erase(id);
    });
    EXPECT_EQ(sum, 4950);
    EXPECT_EQ(map.size(), 50u);
    map.Clear();
    EXPECT_TRUE(map.empty());
  }
  EXPECT_EQ(trap.count(), 0u);
}

struct Stamped {
  Utime utime = 0;
  int value = 0;
};

TEST(TimedRingBuffer, KeepsTimeOrderWhateverTheOrderOfArrival) {
  TimedRingBuffer<Stamped> buffer(4);
  for (const Utime t : {10, 30, 20, 40}) EXPECT_TRUE(buffer.Insert({t, 0}));
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(buffer[i].utime, static_cast<Utime>(10 * (i + 1)));
  EXPECT_FALSE(buffer.Insert({5, 0}));  // older than all of a full buffer
  EXPECT_TRUE(buffer.Insert({35, 0}));  // 10 falls out
  EXPECT_EQ(buffer.front().utime, 20);
  EXPECT_EQ(buffer[2].utime, 35);
  EXPECT_EQ(buffer.LowerBound(30), 1u);
  EXPECT_EQ(buffer.LowerBound(31), 2u);
  EXPECT_EQ(buffer.LowerBound(41), 4u);
  EXPECT_EQ(buffer.LowerBound(0), 0u);
}

TEST(TimedRingBuffer, EqualTimesKeepTheOrderOfArrival) {
  TimedRingBuffer<Stamped> buffer(4);
  buffer.Insert({1, 1});
  buffer.Insert({1, 2});
  EXPECT_EQ(buffer[0].value, 1);
  EXPECT_EQ(buffer[1].value, 2);
}

TEST(Arena, AlignsRefusesAndRemembersItsPeak) {
  Arena arena(100);
  EXPECT_EQ(arena.TryAllocate<char>(3).size(), 3u);
  const auto doubles = arena.TryAllocate<double>(5);
  ASSERT_EQ(doubles.size(), 5u);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(doubles.data()) % alignof(double), 0u);
  EXPECT_TRUE(arena.TryAllocate<double>(1000).empty());
  std::size_t huge = ~std::size_t{0} / 4;  // its size in bytes wraps around
  asm volatile("" : "+r"(huge));        // and the compiler must not know
  EXPECT_TRUE(arena.TryAllocate<double>(huge).empty());
  const std::size_t used = arena.used();
  arena.Reset();
  EXPECT_EQ(arena.used(), 0u);
  EXPECT_EQ(arena.peak(), used);
}

}  // namespace
}  // namespace rsfm
