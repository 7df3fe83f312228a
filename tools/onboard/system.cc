#include "tools/onboard/system.h"

#include <linux/capability.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/statvfs.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace rsfm {
namespace {

std::int64_t NowUs(clockid_t clock) {
  timespec now = {};
  ::clock_gettime(clock, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000 + now.tv_nsec / 1000;
}

// CAP_IPC_LOCK: no limit applies.
bool MayLockAnything() {
  __user_cap_header_struct header = {_LINUX_CAPABILITY_VERSION_3, 0};
  __user_cap_data_struct data[_LINUX_CAPABILITY_U32S_3] = {};
  return ::syscall(SYS_capget, &header, data) == 0 &&
         (data[0].effective & (1u << CAP_IPC_LOCK)) != 0;
}

}  // namespace

std::int64_t MonotonicUs() { return NowUs(CLOCK_MONOTONIC); }
Utime UtcNow() { return NowUs(CLOCK_REALTIME); }

Notifier::Notifier() {
  const char* address = std::getenv("NOTIFY_SOCKET");
  if (address == nullptr || (address[0] != '/' && address[0] != '@')) return;
  address_ = address;
  if (address_.size() >= sizeof(sockaddr_un::sun_path)) return;
  fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const char* watchdog = std::getenv("WATCHDOG_USEC");
  const char* pid = std::getenv("WATCHDOG_PID");
  if (watchdog != nullptr && (pid == nullptr || std::atol(pid) == ::getpid()))
    watchdog_us_ = std::atoll(watchdog);
}

Notifier::~Notifier() {
  if (fd_ >= 0) ::close(fd_);
}

bool Notifier::Send(const std::string& state) const {
  if (fd_ < 0) return address_.empty();
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, address_.data(), address_.size());
  if (address_[0] == '@') address.sun_path[0] = '\0';  // the abstract name space
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
  return ::sendto(fd_, state.data(), state.size(), MSG_NOSIGNAL,
                  reinterpret_cast<const sockaddr*>(&address),
                  size) == static_cast<ssize_t>(state.size());
}

std::string SetUpThread(const char* name, int priority, int cpu) {
  const pthread_t self = ::pthread_self();
  ::pthread_setname_np(self, name);
  std::string problem;
  if (cpu >= 0) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    if (cpu < CPU_SETSIZE) CPU_SET(static_cast<std::size_t>(cpu), &cpus);
    if (const int error = ::pthread_setaffinity_np(self, sizeof cpus, &cpus); error != 0)
      problem = std::string(name) + " is not bound to cpu " + std::to_string(cpu) + ": " +
                std::strerror(error);
  }
  if (priority > 0) {
    sched_param parameters = {};
    parameters.sched_priority = priority;
    if (const int error = ::pthread_setschedparam(self, SCHED_FIFO, &parameters); error != 0)
      problem += (problem.empty() ? "" : "; ") + std::string(name) +
                 " has no real-time priority: " + std::strerror(error);
  }
  return problem;
}

std::string LockMemory() {
  constexpr std::size_t kStackBytes = 2u << 20;
  rlimit limit = {};
  ::getrlimit(RLIMIT_MEMLOCK, &limit);
  // Below a limit the call may succeed, and an allocation during the mission fail.
  if (limit.rlim_cur != RLIM_INFINITY && !MayLockAnything())
    return "memory is not locked: the limit (RLIMIT_MEMLOCK) is " +
           std::to_string(limit.rlim_cur / 1024) +
           " KiB; give the unit LimitMEMLOCK=infinity, or the shell ulimit -l unlimited";
  pthread_attr_t attributes;
  ::pthread_attr_init(&attributes);
  ::pthread_attr_setstacksize(&attributes, kStackBytes);
  ::pthread_setattr_default_np(&attributes);
  ::pthread_attr_destroy(&attributes);
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0)
    return std::string("memory is not locked: mlockall: ") + std::strerror(errno);
  return {};
}

std::int64_t FreeDiskBytes(const std::filesystem::path& path) {
  struct statvfs info = {};
  if (::statvfs(path.c_str(), &info) != 0) return -1;
  return static_cast<std::int64_t>(info.f_bavail) * static_cast<std::int64_t>(info.f_frsize);
}

LatencyWindow::LatencyWindow(std::size_t capacity) : ring_(capacity) { sorted_.reserve(capacity); }

void LatencyWindow::Add(std::int64_t now_us, std::int64_t latency_us) {
  const std::scoped_lock lock(mutex_);
  ring_[next_] = {now_us, latency_us};
  next_ = (next_ + 1) % ring_.size();
  size_ = std::min(size_ + 1, ring_.size());
}

LatencyWindow::Percentiles LatencyWindow::Compute(std::int64_t now_us) const {
  const std::scoped_lock lock(mutex_);
  sorted_.clear();
  for (std::size_t i = 0; i < size_; ++i) {
    if (now_us - ring_[i].time_us <= kSpanUs) sorted_.push_back(ring_[i].latency_us);
  }
  if (sorted_.empty()) return {};
  std::sort(sorted_.begin(), sorted_.end());
  const auto at = [&](double part) {
    const auto rank = static_cast<std::size_t>(part * static_cast<double>(sorted_.size()));
    return 1e-3 * static_cast<double>(sorted_[std::min(rank, sorted_.size() - 1)]);
  };
  return {at(0.5), at(0.99), sorted_.size()};
}

}  // namespace rsfm
