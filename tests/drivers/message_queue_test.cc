#include "rsfm_drivers/lcm/message_queue.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <thread>
#include <vector>

#include "rsfm/base/rng.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

std::vector<std::uint8_t> Bytes(std::size_t size, int seed) {
  std::vector<std::uint8_t> bytes(size);
  for (std::size_t i = 0; i < size; ++i)
    bytes[i] = static_cast<std::uint8_t>(static_cast<int>(i) * 31 + seed);
  return bytes;
}

TEST(MessageQueueTest, WhatGoesInComesOutInOrder) {
  MessageQueue queue(1 << 16);
  QueuedMessage message;
  EXPECT_FALSE(queue.Pop(0, &message));
  EXPECT_TRUE(queue.Push("A", 1, {10, 15}, Bytes(5, 1)));
  EXPECT_TRUE(queue.Push("LONGER_CHANNEL", 2, {20, 25}, {}));
  ASSERT_TRUE(queue.Pop(0, &message));
  EXPECT_EQ(message.channel, "A");
  EXPECT_EQ(message.utime, 1);
  EXPECT_EQ(message.times.origin_us, 10);
  EXPECT_EQ(message.times.ready_us, 15);
  EXPECT_TRUE(std::ranges::equal(message.data, Bytes(5, 1)));
  queue.Release();
  ASSERT_TRUE(queue.Pop(0, &message));
  EXPECT_EQ(message.channel, "LONGER_CHANNEL");
  EXPECT_TRUE(message.data.empty());
  queue.Release();
  EXPECT_FALSE(queue.Pop(0, &message));
  EXPECT_EQ(queue.num_dropped(), 0);
}

// Random sizes, pushed and popped in random turns against a plain list: round the end many times.
TEST(MessageQueueTest, EveryMessageSurvivesTheEndOfTheMemory) {
  MessageQueue queue(40'000);
  Rng rng(5);
  std::vector<std::pair<std::size_t, int>> waiting;
  int number = 0;
  std::int64_t dropped = 0;
  QueuedMessage message;
  for (int i = 0; i < 20'000; ++i) {
    if (rng.Uniform(0.0, 1.0) < 0.55) {
      const auto size = static_cast<std::size_t>(rng.Uniform(0.0, 9000.0) * rng.Uniform(0.0, 1.0));
      if (queue.Push("C", number, {}, Bytes(size, number))) {
        waiting.push_back({size, number});
      } else {
        ++dropped;
      }
      ++number;
    } else if (queue.Pop(0, &message)) {
      ASSERT_FALSE(waiting.empty());
      ASSERT_EQ(message.utime, waiting.front().second);
      ASSERT_TRUE(
          std::ranges::equal(message.data, Bytes(waiting.front().first, waiting.front().second)));
      waiting.erase(waiting.begin());
      queue.Release();
    } else {
      ASSERT_TRUE(waiting.empty());
    }
  }
  EXPECT_GT(dropped, 10);
  EXPECT_EQ(queue.num_dropped(), dropped);
}

TEST(MessageQueueTest, LargeMessagesLeaveRoomForSmallOnes) {
  MessageQueue queue(1 << 17);
  const auto large = Bytes(20'000, 1), small = Bytes(500, 2);
  int num_large = 0, num_small = 0;
  while (queue.Push("KEYFRAME", 1, {}, large)) ++num_large;
  while (queue.Push("POSE", 1, {}, small)) ++num_small;
  EXPECT_GE(num_large, 4);
  EXPECT_GE(num_small, (1 << 17) / 8 / 600);
  // Longer than the whole queue: refused, not waited for.
  EXPECT_FALSE(queue.Push("HUGE", 1, {}, Bytes(1 << 18, 0)));
}

TEST(MessageQueueTest, PushAndPopDoNotAllocate) {
  MessageQueue queue(1 << 16);
  const auto bytes = Bytes(3000, 1);
  QueuedMessage message;
  MallocTrap trap;
  for (int i = 0; i < 200; ++i) {
    queue.Push("CHANNEL", i, {}, bytes);
    queue.Push("CHANNEL", i, {}, bytes);
    if (queue.Pop(0, &message)) queue.Release();
  }
  EXPECT_EQ(trap.count(), 0u);
  EXPECT_GT(queue.num_dropped(), 0);
}

TEST(MessageQueueTest, ManyProducersOneConsumer) {
  MessageQueue queue(1 << 20);
  constexpr int kThreads = 3, kEach = 5000;
  std::vector<std::thread> producers;
  for (int t = 0; t < kThreads; ++t) {
    producers.emplace_back([&queue, t] {
      const auto bytes = Bytes(40, t);
      for (int i = 0; i < kEach;)
        i += queue.Push(std::string(1, static_cast<char>('A' + t)), i, {}, bytes);
    });
  }
  int next[kThreads] = {};
  QueuedMessage message;
  for (int taken = 0; taken < kThreads * kEach; ++taken) {
    ASSERT_TRUE(queue.Pop(60'000, &message));
    const int t = message.channel[0] - 'A';
    ASSERT_EQ(message.utime, next[t]++);
    queue.Release();
  }
  for (std::thread& thread : producers) thread.join();
}

TEST(MessageQueueTest, ClosingWakesTheConsumerAndKeepsWhatIsThere) {
  MessageQueue queue(1 << 16);
  ASSERT_TRUE(queue.Push("A", 1, {}, Bytes(3, 1)));
  int popped = 0;
  std::thread consumer([&] {
    QueuedMessage message;
    while (queue.Pop(600'000, &message)) {
      ++popped;
      queue.Release();
    }
  });
  queue.Close();
  consumer.join();
  EXPECT_EQ(popped, 1);
  EXPECT_FALSE(queue.Push("A", 2, {}, Bytes(3, 1)));
  EXPECT_TRUE(queue.is_closed());
}

}  // namespace
}  // namespace rsfm
