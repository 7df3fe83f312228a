// The system calls of video capture, so that tests can stand in for the kernel; and the one owner
// of a device's file descriptor.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace rsfm {

// Calls that may fail return 0 or the errno.
class VideoSystem {
 public:
  enum Event : unsigned { kReadable = 1u, kException = 2u, kError = 4u };

  virtual ~VideoSystem() = default;
  virtual int Open(const char* path, int* fd) = 0;  // non-blocking
  virtual void Close(int fd) = 0;
  virtual int Ioctl(int fd, unsigned long request, void* argument) = 0;  // again after EINTR
  virtual int Map(int fd, std::size_t bytes, std::int64_t offset, void** data) = 0;
  virtual void Unmap(void* data, std::size_t bytes) = 0;
  // *events is 0 after the time-out, or when a signal came.
  virtual int Poll(int fd, int timeout_ms, unsigned* events) = 0;
  virtual void Wait(std::int64_t duration_us) = 0;
  virtual std::int64_t MonotonicUs() = 0;
  virtual std::int64_t UtcUs() = 0;
  virtual std::vector<std::string> List() = 0;  // device nodes, in the order of their numbers
};

// The kernel's own. One for the process, without state.
VideoSystem& KernelVideoSystem();

// Owns a file descriptor: closed exactly once.
class UniqueFd {
 public:
  UniqueFd() = default;
  UniqueFd(VideoSystem* system, int fd) : system_(system), fd_(fd) {}
  UniqueFd(UniqueFd&& other) noexcept : system_(other.system_), fd_(std::exchange(other.fd_, -1)) {}
  UniqueFd& operator=(UniqueFd&& other) noexcept {
    if (this != &other) {
      Reset();
      system_ = other.system_;
      fd_ = std::exchange(other.fd_, -1);
    }
    return *this;
  }
  ~UniqueFd() { Reset(); }

  int get() const { return fd_; }
  void Reset() {
    if (fd_ >= 0) system_->Close(std::exchange(fd_, -1));
  }

 private:
  VideoSystem* system_ = nullptr;
  int fd_ = -1;
};

}  // namespace rsfm
