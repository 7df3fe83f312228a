#include "rsfm_drivers/lcm/message_queue.h"

#include <algorithm>
#include <chrono>
#include <cstring>

namespace rsfm {

MessageQueue::MessageQueue(std::size_t capacity_bytes)
    : capacity_(std::max<std::size_t>(capacity_bytes, 2 * kSmallBytes) / 8 * 8),
      memory_(std::make_unique<std::uint8_t[]>(capacity_)) {}

std::size_t MessageQueue::RecordBytes(std::size_t channel_bytes, std::size_t data_bytes) {
  return (sizeof(Header) + channel_bytes + data_bytes + 7) / 8 * 8;
}

// Where the next record would begin: a record lies in one piece.
std::size_t MessageQueue::Tail() const {
  return wrap_at_ > 0 ? used_ - (wrap_at_ - head_) : head_ + used_;
}

bool MessageQueue::Push(std::string_view channel, Utime utime, const MessageTimes& times,
                        std::span<const std::uint8_t> data) noexcept {
  const std::size_t bytes = RecordBytes(channel.size(), data.size());
  {
    const std::scoped_lock lock(mutex_);
    const std::size_t reserve = bytes > kSmallBytes ? capacity_ / 8 : 0;
    if (used_ == 0) head_ = wrap_at_ = 0;
    std::size_t tail = Tail();
    const bool must_wrap = wrap_at_ == 0 && tail + bytes > capacity_;
    const std::size_t room = wrap_at_ > 0 ? head_ - tail : must_wrap ? head_ : capacity_ - tail;
    if (is_closed_ || bytes > room || used_ + bytes + reserve > capacity_) {
      ++num_dropped_;
      return false;
    }
    if (must_wrap) {
      wrap_at_ = tail;
      tail = 0;
    }
    const Header header = {static_cast<std::uint32_t>(data.size()),
                           static_cast<std::uint32_t>(channel.size()), utime, times};
    std::uint8_t* to = memory_.get() + tail;
    std::memcpy(to, &header, sizeof header);
    std::memcpy(to + sizeof header, channel.data(), channel.size());
    if (!data.empty()) std::memcpy(to + sizeof header + channel.size(), data.data(), data.size());
    used_ += bytes;
    ++num_messages_;
  }
  has_message_.notify_one();
  return true;
}

bool MessageQueue::Pop(int timeout_ms, QueuedMessage* message) {
  std::unique_lock lock(mutex_);
  has_message_.wait_for(lock, std::chrono::milliseconds(timeout_ms),
                        [&] { return num_messages_ > 0 || is_closed_; });
  if (num_messages_ == 0) return false;
  if (wrap_at_ > 0 && head_ == wrap_at_) head_ = wrap_at_ = 0;
  Header header;
  const std::uint8_t* from = memory_.get() + head_;
  std::memcpy(&header, from, sizeof header);
  message->channel = {reinterpret_cast<const char*>(from + sizeof header), header.channel_bytes};
  message->utime = header.utime;
  message->times = header.times;
  message->data = {from + sizeof header + header.channel_bytes, header.data_bytes};
  popped_bytes_ = RecordBytes(header.channel_bytes, header.data_bytes);
  return true;
}

void MessageQueue::Release() {
  const std::scoped_lock lock(mutex_);
  head_ += popped_bytes_;
  used_ -= popped_bytes_;
  popped_bytes_ = 0;
  --num_messages_;
}

void MessageQueue::Close() {
  {
    const std::scoped_lock lock(mutex_);
    is_closed_ = true;
  }
  has_message_.notify_all();
}

bool MessageQueue::is_closed() const {
  const std::scoped_lock lock(mutex_);
  return is_closed_;
}

std::int64_t MessageQueue::num_dropped() const {
  const std::scoped_lock lock(mutex_);
  return num_dropped_;
}

}  // namespace rsfm
