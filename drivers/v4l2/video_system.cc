#include "rsfm_drivers/v4l2/video_system.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <filesystem>

namespace rsfm {
namespace {

std::int64_t NowUs(clockid_t clock) {
  timespec now = {};
  ::clock_gettime(clock, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000 + now.tv_nsec / 1000;
}

class Kernel final : public VideoSystem {
 public:
  int Open(const char* path, int* fd) override {
    const int opened = ::open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    if (opened < 0) return errno;
    *fd = opened;
    return 0;
  }
  void Close(int fd) override { ::close(fd); }

  int Ioctl(int fd, unsigned long request, void* argument) override {
    while (::ioctl(fd, request, argument) != 0) {
      if (errno != EINTR) return errno;
    }
    return 0;
  }

  int Map(int fd, std::size_t bytes, std::int64_t offset, void** data) override {
    void* mapped =
        ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, static_cast<off_t>(offset));
    if (mapped == MAP_FAILED) return errno;
    *data = mapped;
    return 0;
  }
  void Unmap(void* data, std::size_t bytes) override { ::munmap(data, bytes); }

  int Poll(int fd, int timeout_ms, unsigned* events) override {
    pollfd request = {fd, POLLIN | POLLPRI, 0};
    const int count = ::poll(&request, 1, timeout_ms);
    if (count < 0 && errno != EINTR) return errno;
    *events = 0;
    if (count <= 0) return 0;
    if ((request.revents & POLLIN) != 0) *events |= kReadable;
    if ((request.revents & POLLPRI) != 0) *events |= kException;
    if ((request.revents & (POLLERR | POLLHUP | POLLNVAL)) != 0) *events |= kError;
    return 0;
  }

  void Wait(std::int64_t duration_us) override {
    const timespec duration = {static_cast<time_t>(duration_us / 1'000'000),
                               static_cast<long>(duration_us % 1'000'000 * 1000)};
    ::nanosleep(&duration, nullptr);  // shorter where a signal comes
  }
  std::int64_t MonotonicUs() override { return NowUs(CLOCK_MONOTONIC); }
  std::int64_t UtcUs() override { return NowUs(CLOCK_REALTIME); }

  std::vector<std::string> List() override {
    std::vector<std::pair<int, std::string>> found;
    std::error_code error;
    for (std::filesystem::directory_iterator entry("/dev", error), end; !error && entry != end;
         entry.increment(error)) {
      const std::string name = entry->path().filename().string();
      int number = 0;
      if (!name.starts_with("video")) continue;
      const auto [rest, problem] =
          std::from_chars(name.data() + 5, name.data() + name.size(), number);
      if (problem == std::errc() && rest == name.data() + name.size())
        found.push_back({number, entry->path().string()});
    }
    std::sort(found.begin(), found.end());
    std::vector<std::string> paths;
    for (auto& [number, path] : found) paths.push_back(std::move(path));
    return paths;
  }
};

}  // namespace

VideoSystem& KernelVideoSystem() {
  static Kernel kernel;
  return kernel;
}

}  // namespace rsfm
