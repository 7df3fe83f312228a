#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <type_traits>
#include <utility>

#include "rsfm/io/event_log.h"

namespace rsfm {
namespace {

constexpr std::size_t kBufferBytes = std::size_t{1} << 20;  // a full buffer is flushed at once
constexpr std::size_t kEventsPerFlush = 16384;

template <class T>
void AppendBigEndian(std::string* bytes, T value) {
  const auto bits = static_cast<std::make_unsigned_t<T>>(value);
  for (std::size_t i = sizeof(T); i-- > 0;) {
    bytes->push_back(static_cast<char>(bits >> (8 * i) & 0xff));
  }
}

}  // namespace

EventLogWriter::EventLogWriter(std::filesystem::path path, int fd,
                               const EventLogWriterOptions& options)
    : path_(std::move(path)), options_(options), fd_(fd) {
  buffer_.reserve(2 * kBufferBytes);
  buffered_ends_.reserve(kEventsPerFlush);
}

EventLogWriter::EventLogWriter(EventLogWriter&& other) noexcept
    : path_(std::move(other.path_)),
      options_(other.options_),
      buffer_(std::exchange(other.buffer_, std::string())),
      buffered_ends_(std::exchange(other.buffered_ends_, {})),
      size_on_disk_(other.size_on_disk_),
      next_number_(other.next_number_),
      num_lost_(other.num_lost_),
      oldest_buffered_us_(other.oldest_buffered_us_),
      fd_(std::exchange(other.fd_, -1)) {}

EventLogWriter::~EventLogWriter() {
  if (fd_ >= 0) static_cast<void>(Close());
}

IoExpected<EventLogWriter> EventLogWriter::Create(const std::filesystem::path& path,
                                                  const EventLogWriterOptions& options) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd < 0) return Fail(FromErrno(errno, path.string(), "create the event log"));
  return EventLogWriter(path, fd, options);
}

std::int64_t EventLogWriter::NowUs() const {
  if (options_.now_us != nullptr) return options_.now_us();
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

IoStatus EventLogWriter::Append(std::string_view channel, Utime utime, const void* data,
                                std::size_t size) {
  if (channel.empty() || channel.size() > kMaxChannelBytes || size > kMaxEventBytes) {
    return Fail({Errc::kInvalidArgument, path_.string(), std::string(channel),
                 "is no event: a channel has 1 to 63 characters, an event at most 256 MiB", ""});
  }
  if (fd_ < 0) return Fail(FromErrno(EBADF, path_.string(), "write to the event log"));
  if (buffered_ends_.empty()) oldest_buffered_us_ = NowUs();
  AppendBigEndian(&buffer_, kEventLogSync);
  AppendBigEndian(&buffer_, next_number_);
  AppendBigEndian(&buffer_, utime);
  AppendBigEndian(&buffer_, static_cast<std::int32_t>(channel.size()));
  AppendBigEndian(&buffer_, static_cast<std::int32_t>(size));
  buffer_.append(channel);
  buffer_.append(static_cast<const char*>(data), size);
  ++next_number_;
  buffered_ends_.push_back(buffer_.size());
  return buffer_.size() >= kBufferBytes ? Flush() : FlushIfDue();
}

IoStatus EventLogWriter::FlushIfDue() {
  if (buffered_ends_.empty() || NowUs() - oldest_buffered_us_ < options_.flush_period_us) return {};
  return Flush();
}

IoStatus EventLogWriter::FailAfter(std::size_t bytes_written, int error) {
  const auto whole = std::upper_bound(buffered_ends_.begin(), buffered_ends_.end(), bytes_written);
  if (whole != buffered_ends_.begin()) size_on_disk_ += static_cast<std::int64_t>(*(whole - 1));
  num_lost_ += buffered_ends_.end() - whole;
  buffered_ends_.clear();
  buffer_.clear();
  // Where this fails too, the reader finds one cut event and goes on behind it; so do we.
  if (::ftruncate(fd_, size_on_disk_) == 0) {
    ::lseek(fd_, size_on_disk_, SEEK_SET);
  } else if (const off_t end = ::lseek(fd_, 0, SEEK_CUR); end >= 0) {
    size_on_disk_ = end;
  }
  return Fail(FromErrno(error, path_.string(), "write to the event log"));
}

IoStatus EventLogWriter::Flush() {
  if (fd_ < 0) return Fail(FromErrno(EBADF, path_.string(), "write to the event log"));
  std::size_t done = 0;
  while (done < buffer_.size()) {
    const ssize_t n = ::write(fd_, buffer_.data() + done, buffer_.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return FailAfter(done, errno);
    done += static_cast<std::size_t>(n);
  }
  size_on_disk_ += static_cast<std::int64_t>(buffer_.size());
  buffer_.clear();
  buffered_ends_.clear();
  if (options_.sync_to_disk && done > 0 && ::fdatasync(fd_) != 0 && errno != EINVAL) {
    return Fail(FromErrno(errno, path_.string(), "force the event log to the disk"));
  }
  return {};
}

IoStatus EventLogWriter::Close() {
  IoStatus status = Flush();
  if (fd_ >= 0) {
    const int fd = std::exchange(fd_, -1);
    const bool is_synced = ::fsync(fd) == 0 || errno == EINVAL;
    const int sync_error = errno;
    const bool is_closed = ::close(fd) == 0;
    if (status && !is_synced) {
      status = Fail(FromErrno(sync_error, path_.string(), "force the event log to the disk"));
    }
    if (status && !is_closed) {
      status = Fail(FromErrno(errno, path_.string(), "close the event log"));
    }
  }
  return status;
}

}  // namespace rsfm
