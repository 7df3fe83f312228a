#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <type_traits>
#include <utility>

#include "rsfm/io/event_log.h"

namespace rsfm {
namespace {

constexpr std::size_t kWindowBytes = std::size_t{1} << 20;
constexpr std::size_t kSyncBytes = 4;
constexpr std::array<std::uint8_t, kSyncBytes> kSync = {0xED, 0xA1, 0xDA, 0x01};

template <class T>
T BigEndian(const std::uint8_t* bytes) {
  std::make_unsigned_t<T> value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    value = static_cast<std::make_unsigned_t<T>>(value << 8 | bytes[i]);
  }
  return static_cast<T>(value);
}

}  // namespace

EventLogReader::EventLogReader(std::filesystem::path path, int fd, std::int64_t file_bytes)
    : path_(std::move(path)), file_bytes_(file_bytes), fd_(fd) {}

EventLogReader::EventLogReader(EventLogReader&& other) noexcept
    : path_(std::move(other.path_)),
      statistics_(std::move(other.statistics_)),
      window_(std::move(other.window_)),
      window_offset_(other.window_offset_),
      offset_(other.offset_),
      file_bytes_(other.file_bytes_),
      error_(other.error_),
      fd_(std::exchange(other.fd_, -1)) {}

EventLogReader::~EventLogReader() {
  if (fd_ >= 0) ::close(fd_);
}

IoExpected<EventLogReader> EventLogReader::Open(const std::filesystem::path& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return Fail(FromErrno(errno, path.string(), "open the event log"));
  struct stat info = {};
  if (::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
    const int error = S_ISDIR(info.st_mode) ? EISDIR : EINVAL;
    ::close(fd);
    return Fail(FromErrno(error, path.string(), "read it as an event log"));
  }
  return EventLogReader(path, fd, info.st_size);
}

const std::uint8_t* EventLogReader::Get(std::int64_t offset, std::size_t size) {
  if (offset + static_cast<std::int64_t>(size) > file_bytes_) return nullptr;
  const std::int64_t window_end = window_offset_ + static_cast<std::int64_t>(window_.size());
  if (offset >= window_offset_ && offset + static_cast<std::int64_t>(size) <= window_end) {
    return window_.data() + (offset - window_offset_);
  }
  const auto rest = static_cast<std::size_t>(file_bytes_ - offset);
  window_.resize(std::min(rest, std::max(size, kWindowBytes)));
  window_offset_ = offset;
  std::size_t done = 0;
  while (done < window_.size()) {
    const ssize_t n = ::pread(fd_, window_.data() + done, window_.size() - done,
                              offset + static_cast<std::int64_t>(done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) error_ = errno;
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
  }
  if (done < window_.size()) {  // the file became shorter while it was read, or the disk failed
    window_.resize(done);
    file_bytes_ = offset + static_cast<std::int64_t>(done);
  }
  return done >= size ? window_.data() : nullptr;
}

bool EventLogReader::HasSync(std::int64_t offset) {
  const std::uint8_t* bytes = Get(offset, kSyncBytes);
  return bytes != nullptr && std::memcmp(bytes, kSync.data(), kSyncBytes) == 0;
}

bool EventLogReader::ParseHeader(std::int64_t offset, bool needs_sync, Header* header) {
  if (needs_sync && !HasSync(offset)) return false;
  const std::uint8_t* bytes = Get(offset, kEventHeaderBytes);
  if (bytes == nullptr) return false;
  const auto channel_bytes = BigEndian<std::int32_t>(bytes + 20);
  const auto data_bytes = BigEndian<std::int32_t>(bytes + 24);
  if (channel_bytes < 1 || channel_bytes > static_cast<std::int32_t>(kMaxChannelBytes) ||
      data_bytes < 0 || data_bytes > static_cast<std::int32_t>(kMaxEventBytes)) {
    return false;
  }
  header->number = BigEndian<std::int64_t>(bytes + 4);
  header->utime = BigEndian<std::int64_t>(bytes + 12);
  header->channel_bytes = static_cast<std::size_t>(channel_bytes);
  header->data_bytes = static_cast<std::size_t>(data_bytes);
  const std::uint8_t* channel =
      Get(offset + static_cast<std::int64_t>(kEventHeaderBytes), header->channel_bytes);
  if (channel == nullptr) return true;  // cut off within the channel: all that is there is possible
  return std::all_of(channel, channel + header->channel_bytes,
                     [](std::uint8_t c) { return c >= 0x20 && c < 0x7f; });
}

std::int64_t EventLogReader::FindEvent(std::int64_t offset, std::int64_t end) {
  while (offset < end) {
    const auto left = static_cast<std::size_t>(
        std::min<std::int64_t>(file_bytes_ - offset, static_cast<std::int64_t>(kWindowBytes)));
    const std::uint8_t* bytes = left > 0 ? Get(offset, left) : nullptr;
    if (bytes == nullptr) return -1;
    const void* hit = std::memchr(bytes, kSync[0], left);
    if (hit == nullptr) {
      offset += static_cast<std::int64_t>(left);
      continue;
    }
    offset += static_cast<const std::uint8_t*>(hit) - bytes;
    Header header;
    if (offset < end && ParseHeader(offset, true, &header) &&
        offset + static_cast<std::int64_t>(header.EventBytes()) <= file_bytes_) {
      return offset;
    }
    ++offset;
  }
  return -1;
}

void EventLogReader::SkipDamage() {
  const std::int64_t next = FindEvent(offset_ + 1, file_bytes_);
  const std::int64_t end = next < 0 ? file_bytes_ : next;
  Header header;
  const std::int64_t left = file_bytes_ - offset_;
  const std::size_t sync_left = std::min<std::size_t>(kSyncBytes, static_cast<std::size_t>(left));
  const std::uint8_t* bytes = Get(offset_, sync_left);
  const bool starts_like_an_event =
      bytes != nullptr && std::memcmp(bytes, kSync.data(), sync_left) == 0 &&
      (left < static_cast<std::int64_t>(kEventHeaderBytes) || ParseHeader(offset_, true, &header));
  if (next < 0 && starts_like_an_event) {
    statistics_.cut_bytes = left;
  } else {
    ++statistics_.num_damaged;
    statistics_.damaged_bytes += end - offset_;
  }
  offset_ = end;
}

void EventLogReader::Count(const LogEvent& event) {
  EventLogStatistics& s = statistics_;
  s.first_utime = s.num_events == 0 ? event.utime : std::min(s.first_utime, event.utime);
  s.last_utime = s.num_events == 0 ? event.utime : std::max(s.last_utime, event.utime);
  ++s.num_events;
  EventLogStatistics::Channel& channel = s.channels[event.channel];
  ++channel.num_events;
  channel.num_bytes += static_cast<std::int64_t>(event.data.size());
}

IoExpected<bool> EventLogReader::Next(LogEvent* event) {
  while (offset_ < file_bytes_ && error_ == 0) {
    Header header;
    const bool is_possible = ParseHeader(offset_, true, &header);
    const std::int64_t end = offset_ + static_cast<std::int64_t>(header.EventBytes());
    if (!is_possible || end > file_bytes_) {
      SkipDamage();
      continue;
    }
    // A length that was damaged leads away from the next event: then that one lies inside.
    Header next;
    const bool is_followed = file_bytes_ - end < static_cast<std::int64_t>(kEventHeaderBytes) ||
                             HasSync(end) || ParseHeader(end, false, &next);
    if (!is_followed && FindEvent(offset_ + 1, end) >= 0) {
      SkipDamage();
      continue;
    }
    const std::uint8_t* bytes = Get(offset_, header.EventBytes());
    if (bytes == nullptr) continue;  // became shorter, or failed: the loop's conditions tell
    event->number = header.number;
    event->utime = header.utime;
    const std::uint8_t* channel = bytes + kEventHeaderBytes;
    event->channel.assign(reinterpret_cast<const char*>(channel), header.channel_bytes);
    const std::uint8_t* data = channel + header.channel_bytes;
    event->data.assign(data, data + header.data_bytes);
    offset_ = end;
    Count(*event);
    return true;
  }
  if (error_ != 0) return Fail(FromErrno(error_, path_.string(), "read the event log"));
  return false;
}

}  // namespace rsfm
