#include "tools/onboard/system.h"

#include <gtest/gtest.h>
#include <linux/capability.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdio>
#include <cstring>
#include <fstream>
#include <string>

#include "rsfm/base/resident_memory.h"
#include "tests/support/malloc_trap.h"
#include "tests/support/temporary_folder.h"

namespace rsfm {
namespace {

TEST(LatencyWindowTest, PercentilesOfTheLastMinute) {
  LatencyWindow window(1000);
  EXPECT_EQ(window.Compute(0).count, 0u);
  for (int i = 1; i <= 100; ++i) window.Add(1'000'000, 1000 * i);
  const auto all = window.Compute(2'000'000);
  EXPECT_EQ(all.count, 100u);
  EXPECT_EQ(all.p50_ms, 51.0);
  EXPECT_EQ(all.p99_ms, 100.0);
  window.Add(70'000'000, 5000);
  const auto later = window.Compute(70'000'000);
  EXPECT_EQ(later.count, 1u);
  EXPECT_EQ(later.p99_ms, 5.0);
}

TEST(LatencyWindowTest, TheOldestGiveWayAndNothingAllocates) {
  LatencyWindow window(10);
  MallocTrap trap;
  for (int i = 0; i < 25; ++i) window.Add(i, i < 15 ? 1'000'000 : 2000);
  const auto result = window.Compute(30);
  EXPECT_EQ(trap.count(), 0u);
  EXPECT_EQ(result.count, 10u);
  EXPECT_EQ(result.p99_ms, 2.0);
}

// In a process of its own: what is locked stays so. 0: as LockMemory says.
[[noreturn]] void Lock(bool with_limit) {
  if (with_limit) {
    const rlimit limit = {65536, 65536};
    if (::setrlimit(RLIMIT_MEMLOCK, &limit) != 0) ::_exit(3);
    if (::getuid() == 0 && ::setresuid(65534, 65534, 65534) != 0) ::_exit(4);
  }
  const std::string problem = LockMemory();
  long long locked_kib = 0;
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    std::sscanf(line.c_str(), "VmLck: %lld", &locked_kib);
  std::fprintf(stderr, "%s; %s", locked_kib > 0 ? "locked" : "not locked", problem.c_str());
  ::_exit(problem.empty() == (locked_kib > 0) ? 0 : 1);
}

TEST(LockMemoryTest, ALimitIsNamedWithWhatToDo) {
  EXPECT_EXIT(Lock(true), ::testing::ExitedWithCode(0),
              "not locked; memory is not locked: the limit .RLIMIT_MEMLOCK. is 64 KiB; give the "
              "unit LimitMEMLOCK=infinity");
}

TEST(LockMemoryTest, WithoutALimitEverythingIsLocked) {
  if (!MallocTrap::IsActive()) GTEST_SKIP() << "a sanitizer's shadow memory cannot be locked";
  rlimit limit = {};
  ASSERT_EQ(::getrlimit(RLIMIT_MEMLOCK, &limit), 0);
  const bool has_capability = ::geteuid() == 0 && ::prctl(PR_CAPBSET_READ, CAP_IPC_LOCK) == 1;
  if (limit.rlim_cur != RLIM_INFINITY && !has_capability)
    GTEST_SKIP() << "this user may not lock memory";
  EXPECT_EXIT(Lock(false), ::testing::ExitedWithCode(0), "^locked; $");
}

class NotifierTest : public ::testing::Test {
 protected:
  ~NotifierTest() override {
    ::unsetenv("NOTIFY_SOCKET");
    ::unsetenv("WATCHDOG_USEC");
    ::unsetenv("WATCHDOG_PID");
  }
};

TEST_F(NotifierTest, SendsDatagramsToTheManager) {
  const TemporaryFolder folder;
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, (folder.path() / "notify").c_str(), sizeof address.sun_path - 1);
  const int fd = ::socket(AF_UNIX, SOCK_DGRAM, 0);
  ASSERT_EQ(::bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  ::setenv("NOTIFY_SOCKET", address.sun_path, 1);
  ::setenv("WATCHDOG_USEC", "3000000", 1);
  const Notifier notifier;
  EXPECT_EQ(notifier.watchdog_us(), 3'000'000);
  EXPECT_TRUE(notifier.Send("READY=1"));
  EXPECT_TRUE(notifier.Send("WATCHDOG=1"));
  char text[64] = {};
  EXPECT_EQ(::recv(fd, text, sizeof text, 0), 7);
  EXPECT_STREQ(text, "READY=1");
  ::close(fd);
  EXPECT_FALSE(notifier.Send("STOPPING=1"));  // the manager has gone
}

TEST_F(NotifierTest, WithoutAManagerNothingIsSent) {
  ::unsetenv("NOTIFY_SOCKET");
  const Notifier notifier;
  EXPECT_EQ(notifier.watchdog_us(), 0);
  EXPECT_TRUE(notifier.Send("READY=1"));
}

TEST_F(NotifierTest, AWatchdogMeantForAnotherProcessIsNotOurs) {
  ::setenv("NOTIFY_SOCKET", "@nobody", 1);
  ::setenv("WATCHDOG_USEC", "3000000", 1);
  ::setenv("WATCHDOG_PID", "1", 1);
  EXPECT_EQ(Notifier().watchdog_us(), 0);
}

TEST(ThreadTest, WhatTheSystemRefusesIsNamed) {
  EXPECT_EQ(SetUpThread("rsfm-test"), "");
  EXPECT_NE(SetUpThread("rsfm-test", 0, 1023).find("rsfm-test is not bound to cpu 1023"),
            std::string::npos);
}

TEST(SystemTest, Figures) {
  EXPECT_GT(ResidentBytes(), 1'000'000);
  EXPECT_GT(FreeDiskBytes("/tmp"), 0);
  EXPECT_EQ(FreeDiskBytes("/no/such/folder"), -1);
}

}  // namespace
}  // namespace rsfm
