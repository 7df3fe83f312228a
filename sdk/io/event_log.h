// LCM event logs: what lcm-logger writes and lcm-logplayer, lcm-spy and lcm-logplayer-gui read.
//
// An event is a 28-byte big-endian header (sync word 0xEDA1DA01, int64 event number, int64 receive
// time [us], int32 channel length, int32 data length), the channel, the data.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "rsfm/base/time.h"
#include "rsfm/io/diagnostic.h"

namespace rsfm {

inline constexpr std::uint32_t kEventLogSync = 0xEDA1DA01u;
inline constexpr std::size_t kEventHeaderBytes = 28;
inline constexpr std::size_t kMaxChannelBytes = 63;                  // LCM_MAX_CHANNEL_NAME_LENGTH
inline constexpr std::size_t kMaxEventBytes = std::size_t{1} << 28;  // more is taken for damage

struct LogEvent {
  std::int64_t number = 0;
  Utime utime = 0;  // of receipt; not always monotonic
  std::string channel;
  std::vector<std::uint8_t> data;
};

struct EventLogWriterOptions {
  // What is older than this is handed to the disk at the next Append() or FlushIfDue().
  std::int64_t flush_period_us = 500'000;
  bool sync_to_disk = true;  // fdatasync with each flush: survives power loss, not only a crash
  std::int64_t (*now_us)() = nullptr;  // monotonic clock; null: steady_clock. For tests.
};

class EventLogWriter {
 public:
  static IoExpected<EventLogWriter> Create(const std::filesystem::path& path,
                                           const EventLogWriterOptions& options = {});
  EventLogWriter(EventLogWriter&& other) noexcept;
  EventLogWriter& operator=(EventLogWriter&&) = delete;
  ~EventLogWriter();  // flushes; an error then is lost: call Close()

  // Buffers the event, and flushes what is due. On failure (ENOSPC, ...) the file is cut back to
  // the last whole event it holds, the events not yet in it are counted in num_lost(), and later
  // appends try again.
  IoStatus Append(std::string_view channel, Utime utime, const void* data, std::size_t size);

  // For the owner's timer, at least every half second: so that a bus gone silent loses nothing.
  IoStatus FlushIfDue();
  IoStatus Flush();
  // Flushes, forces to the disk, closes. Further calls fail.
  IoStatus Close();

  // Events in the file, and those that could not be put there.
  std::int64_t num_written() const { return next_number_ - num_buffered() - num_lost_; }
  std::int64_t num_lost() const { return num_lost_; }

 private:
  EventLogWriter(std::filesystem::path path, int fd, const EventLogWriterOptions& options);
  std::int64_t num_buffered() const { return static_cast<std::int64_t>(buffered_ends_.size()); }
  std::int64_t NowUs() const;
  IoStatus FailAfter(std::size_t bytes_written, int error);

  std::filesystem::path path_;
  EventLogWriterOptions options_;
  std::string buffer_;
  std::vector<std::size_t> buffered_ends_;  // where each buffered event ends in buffer_
  std::int64_t size_on_disk_ = 0;
  std::int64_t next_number_ = 0;
  std::int64_t num_lost_ = 0;
  std::int64_t oldest_buffered_us_ = 0;
  int fd_ = -1;
};

struct EventLogStatistics {
  struct Channel {
    std::int64_t num_events = 0;
    std::int64_t num_bytes = 0;
  };
  std::int64_t num_events = 0;
  std::int64_t num_damaged = 0;    // gaps that were skipped to find the next whole event
  std::int64_t damaged_bytes = 0;  // in those gaps
  std::int64_t cut_bytes = 0;      // of an event that the end of the file cuts off; 0: none
  Utime first_utime = 0;
  Utime last_utime = 0;  // smallest and largest receive time
  std::map<std::string, Channel> channels;
};

// Reads events in file order. Damage is skipped: reading goes on at the next whole event.
class EventLogReader {
 public:
  static IoExpected<EventLogReader> Open(const std::filesystem::path& path);
  EventLogReader(EventLogReader&& other) noexcept;
  EventLogReader& operator=(EventLogReader&&) = delete;
  ~EventLogReader();

  // False at the end. kIo when the disk fails.
  IoExpected<bool> Next(LogEvent* event);

  const EventLogStatistics& statistics() const { return statistics_; }
  std::int64_t file_bytes() const { return file_bytes_; }

 private:
  struct Header {
    std::int64_t number = 0;
    std::int64_t utime = 0;
    std::size_t channel_bytes = 0;
    std::size_t data_bytes = 0;
    std::size_t EventBytes() const { return kEventHeaderBytes + channel_bytes + data_bytes; }
  };

  EventLogReader(std::filesystem::path path, int fd, std::int64_t file_bytes);
  // `size` bytes at `offset`, or null beyond the end or on a read error (error_ is set then).
  const std::uint8_t* Get(std::int64_t offset, std::size_t size);
  bool HasSync(std::int64_t offset);
  // The header at `offset` if all it says is possible, whatever follows.
  bool ParseHeader(std::int64_t offset, bool needs_sync, Header* header);
  // The first possible event that is whole within the file, at or after `offset` and before `end`;
  // -1: none.
  std::int64_t FindEvent(std::int64_t offset, std::int64_t end);
  // Where reading goes on when the event at offset_ is not whole; sets offset_ and the statistics.
  void SkipDamage();
  void Count(const LogEvent& event);

  std::filesystem::path path_;
  EventLogStatistics statistics_;
  std::vector<std::uint8_t> window_;
  std::int64_t window_offset_ = 0;
  std::int64_t offset_ = 0;
  std::int64_t file_bytes_ = 0;
  int error_ = 0;
  int fd_ = -1;
};

}  // namespace rsfm
