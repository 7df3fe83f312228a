#include <gtest/gtest.h>

#include <thread>

#include "tests/support/malloc_trap.h"
#include "tools/onboard/bounded_queue.h"
#include "tools/onboard/frame_pool.h"

namespace rsfm {
namespace {

TEST(BoundedQueueTest, TheOldestFallsOut) {
  BoundedQueue<int> queue(2);
  int dropped = -1, value = -1;
  EXPECT_FALSE(queue.PushDropOldest(1, &dropped));
  EXPECT_FALSE(queue.PushDropOldest(2, &dropped));
  EXPECT_TRUE(queue.IsFull());
  EXPECT_TRUE(queue.PushDropOldest(3, &dropped));
  EXPECT_EQ(dropped, 1);
  EXPECT_TRUE(queue.Pop(0, &value));
  EXPECT_EQ(value, 2);
  EXPECT_TRUE(queue.Pop(0, &value));
  EXPECT_EQ(value, 3);
  EXPECT_FALSE(queue.Pop(0, &value));
  EXPECT_TRUE(queue.IsEmpty());
}

TEST(BoundedQueueTest, WhatWaitsStaysAndTheNewestIsRefused) {
  BoundedQueue<int> queue(1);
  int value = -1;
  EXPECT_TRUE(queue.TryPush(1));
  EXPECT_FALSE(queue.TryPush(2));
  EXPECT_FALSE(queue.PushWait(3, 0));
  EXPECT_TRUE(queue.Pop(0, &value));
  EXPECT_EQ(value, 1);
  EXPECT_TRUE(queue.PushWait(4, 0));
}

TEST(BoundedQueueTest, NothingIsLostBetweenThreadsThatWait) {
  BoundedQueue<int> queue(3);
  constexpr int kCount = 20'000;
  std::thread producer([&queue] {
    for (int i = 0; i < kCount; ++i) {
      while (!queue.PushWait(i, 1000)) {
      }
    }
    queue.Close();
  });
  int expected = 0, value = -1;
  while (!queue.IsFinished()) {
    if (!queue.Pop(1000, &value)) continue;
    ASSERT_EQ(value, expected++);
  }
  producer.join();
  EXPECT_EQ(expected, kCount);
}

TEST(BoundedQueueTest, DoesNotAllocate) {
  BoundedQueue<int> queue(4);
  MallocTrap trap;
  int value = 0, dropped = 0;
  for (int i = 0; i < 100; ++i) {
    queue.PushDropOldest(i, &dropped);
    queue.TryPush(i);
    queue.Pop(0, &value);
  }
  EXPECT_EQ(trap.count(), 0u);
}

TEST(FramePoolTest, AFrameComesBackWhenItsLastUserLetsGo) {
  FramePool pool(2, 16);
  MallocTrap trap;
  Frame* a = pool.Acquire();
  Frame* b = pool.Acquire();
  ASSERT_NE(a, nullptr);
  ASSERT_NE(b, nullptr);
  EXPECT_NE(a, b);
  EXPECT_EQ(pool.Acquire(), nullptr);
  FramePool::Retain(a);
  FramePool::Release(a);
  EXPECT_EQ(pool.Acquire(), nullptr);
  FramePool::Release(a);
  EXPECT_EQ(pool.Acquire(), a);
  EXPECT_EQ(trap.count(), 0u);
}

}  // namespace
}  // namespace rsfm
