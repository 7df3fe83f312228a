// Encoded messages between threads, in fixed memory. Many may push, one pops.
//
// Pushing never waits for the consumer and never allocates: a message that does not fit is dropped
// and counted. What is large (a keyframe) leaves an eighth of the memory to what is small (a pose,
// a status), so that a slow bus or disk costs keyframes first.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string_view>

#include "rsfm/base/time.h"

namespace rsfm {

// On the monotonic clock; 0: nothing is timed.
struct MessageTimes {
  std::int64_t origin_us = 0;  // of what the message is about
  std::int64_t ready_us = 0;   // when what it says was known
};

struct QueuedMessage {
  std::string_view channel;
  Utime utime = 0;  // of receipt or publication
  MessageTimes times;
  std::span<const std::uint8_t> data;
};

class MessageQueue {
 public:
  static constexpr std::size_t kSmallBytes = 4096;

  // The only place that allocates.
  explicit MessageQueue(std::size_t capacity_bytes);

  // False, and counted, when there is no room or the queue is closed.
  bool Push(std::string_view channel, Utime utime, const MessageTimes& times,
            std::span<const std::uint8_t> data) noexcept;
  // The oldest message, in the queue's memory until Release(). Waits up to `timeout_ms`; false when
  // there is none, or at once when there is none and the queue is closed.
  bool Pop(int timeout_ms, QueuedMessage* message);
  // Gives the popped message's memory back. Call it once after each Pop() that gave one.
  void Release();
  // No more can be pushed; what is there can still be popped.
  void Close();

  bool is_closed() const;
  std::int64_t num_dropped() const;
  std::size_t capacity_bytes() const { return capacity_; }

 private:
  struct Header {
    std::uint32_t data_bytes;
    std::uint32_t channel_bytes;
    Utime utime;
    MessageTimes times;
  };
  static std::size_t RecordBytes(std::size_t channel_bytes, std::size_t data_bytes);
  std::size_t Tail() const;

  const std::size_t capacity_;
  const std::unique_ptr<std::uint8_t[]> memory_;
  mutable std::mutex mutex_;
  std::condition_variable has_message_;
  std::size_t head_ = 0;     // of the oldest message
  std::size_t used_ = 0;     // bytes from head_ on, round the end
  std::size_t wrap_at_ = 0;  // messages before this offset end here, and go on at 0; 0: no wrap
  std::size_t popped_bytes_ = 0;
  std::int64_t num_messages_ = 0;
  std::int64_t num_dropped_ = 0;
  bool is_closed_ = false;
};

}  // namespace rsfm
