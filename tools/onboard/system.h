// What the daemon wants of the system: its service manager, its threads, its figures.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <string>
#include <vector>

#include "rsfm/base/time.h"

namespace rsfm {

std::int64_t MonotonicUs();
Utime UtcNow();

// The service manager's protocol [sd_notify(3)]: a datagram to the socket that NOTIFY_SOCKET names.
// Without one, nothing is sent.
class Notifier {
 public:
  Notifier();
  ~Notifier();
  Notifier(const Notifier&) = delete;
  Notifier& operator=(const Notifier&) = delete;

  // "READY=1", "STATUS=...", lines. False when it could not be sent.
  bool Send(const std::string& state) const;
  // How long the manager waits for WATCHDOG=1; 0: it does not.
  std::int64_t watchdog_us() const { return watchdog_us_; }

 private:
  int fd_ = -1;
  std::string address_;
  std::int64_t watchdog_us_ = 0;
};

// Names the calling thread (15 characters) and, where asked for, gives it SCHED_FIFO's priority and
// a cpu of its own. What the system refuses, for a person; empty: nothing.
std::string SetUpThread(const char* name, int priority = 0, int cpu = -1);

// Keeps all pages of the process in memory, those that it has and those that it will have, the
// stacks of threads that start later included: these get 2 MiB each from here on. What the system
// refuses, and what to do about it, for a person; empty: nothing.
std::string LockMemory();

std::int64_t FreeDiskBytes(const std::filesystem::path&);  // -1: not known

// The latencies of the last minute.
class LatencyWindow {
 public:
  static constexpr std::int64_t kSpanUs = 60'000'000;
  explicit LatencyWindow(std::size_t capacity = 8192);

  void Add(std::int64_t now_us, std::int64_t latency_us);
  struct Percentiles {
    double p50_ms = 0.0, p99_ms = 0.0;
    std::size_t count = 0;
  };
  Percentiles Compute(std::int64_t now_us) const;

 private:
  struct Sample {
    std::int64_t time_us, latency_us;
  };
  mutable std::mutex mutex_;
  std::vector<Sample> ring_;
  mutable std::vector<std::int64_t> sorted_;
  std::size_t next_ = 0, size_ = 0;
};

}  // namespace rsfm
