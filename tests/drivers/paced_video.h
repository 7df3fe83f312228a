// The fake camera at its real pace.
#pragma once

#include <sys/syscall.h>
#include <unistd.h>

#include <string>
#include <vector>

#include "tests/drivers/fake_video.h"

namespace rsfm {

// With a call into the kernel wherever a device would be called. What a driver does in that call,
// and the interrupt, are not in it.
class PacedVideo final : public VideoSystem {
 public:
  FakeVideo fake;

  int Open(const char* path, int* fd) override { return fake.Open(path, fd); }
  void Close(int fd) override { fake.Close(fd); }
  int Ioctl(int fd, unsigned long request, void* argument) override {
    ::syscall(SYS_getppid);
    return fake.Ioctl(fd, request, argument);
  }
  int Map(int fd, std::size_t bytes, std::int64_t offset, void** data) override {
    return fake.Map(fd, bytes, offset, data);
  }
  void Unmap(void* data, std::size_t bytes) override { fake.Unmap(data, bytes); }
  int Poll(int fd, int timeout_ms, unsigned* events) override {
    const std::int64_t before_us = fake.now_us;
    const int error = fake.Poll(fd, timeout_ms, events);
    KernelVideoSystem().Wait(fake.now_us - before_us);
    return error;
  }
  void Wait(std::int64_t duration_us) override {
    fake.Wait(duration_us);
    KernelVideoSystem().Wait(duration_us);
  }
  std::int64_t MonotonicUs() override { return fake.MonotonicUs(); }
  std::int64_t UtcUs() override { return fake.UtcUs(); }
  std::vector<std::string> List() override { return fake.List(); }
};

}  // namespace rsfm
