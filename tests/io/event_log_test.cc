// LCM event logs: the standard's own reader understands ours and the other way round; damage costs
// the damaged events and nothing else; a full disk is reported.
#include "rsfm/io/event_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <unistd.h>

#include <lcm/lcm-cpp.hpp>

#include "rsfm/base/rng.h"
#include "rsfm/io/atomic_output.h"
#include "tests/support/temporary_folder.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::int64_t g_clock_us = 0;
std::int64_t FakeClock() { return g_clock_us; }

// Event i has i + 1 bytes of value i; returns where each begins, and the end.
std::vector<std::size_t> WriteEvents(const fs::path& path, int count) {
  auto log = EventLogWriter::Create(path);
  EXPECT_TRUE(log);
  std::vector<std::size_t> offsets = {0};
  for (int i = 0; i < count; ++i) {
    const std::vector<std::uint8_t> data(static_cast<std::size_t>(i) + 1,
                                         static_cast<std::uint8_t>(i));
    EXPECT_TRUE(log->Append("CHANNEL", 1000 + i, data.data(), data.size()));
    offsets.push_back(offsets.back() + kEventHeaderBytes + 7 + data.size());
  }
  EXPECT_TRUE(log->Close());
  return offsets;
}

struct ReadBack {
  std::vector<int> events;  // by the value of their bytes
  EventLogStatistics statistics;
};

ReadBack ReadEvents(const fs::path& path) {
  ReadBack result;
  auto log = EventLogReader::Open(path);
  EXPECT_TRUE(log);
  LogEvent event;
  for (int i = 0; i < 10000; ++i) {
    const auto has_event = log->Next(&event);
    EXPECT_TRUE(has_event);
    if (!has_event || !*has_event) break;
    result.events.push_back(event.data.empty() ? -1 : event.data[0]);
  }
  result.statistics = log->statistics();
  return result;
}

std::vector<int> Without(int count, std::initializer_list<int> lost) {
  std::vector<int> events;
  for (int i = 0; i < count; ++i) {
    if (std::find(lost.begin(), lost.end(), i) == lost.end()) events.push_back(i);
  }
  return events;
}

class EventLogTest : public ::testing::Test {
 protected:
  TemporaryFolder folder_;
  fs::path path_ = folder_.path() / "events.lcm";

  std::string Bytes() { return *ReadWholeFile(path_); }
  void SetBytes(const std::string& bytes) { ASSERT_TRUE(WriteFileAtomically(path_, bytes)); }
};

TEST_F(EventLogTest, WhatIsWrittenIsRead) {
  WriteEvents(path_, 20);
  const ReadBack back = ReadEvents(path_);
  EXPECT_EQ(back.events, Without(20, {}));
  EXPECT_EQ(back.statistics.num_events, 20);
  EXPECT_EQ(back.statistics.num_damaged, 0);
  EXPECT_EQ(back.statistics.cut_bytes, 0);
  EXPECT_EQ(back.statistics.first_utime, 1000);
  EXPECT_EQ(back.statistics.last_utime, 1019);
  ASSERT_EQ(back.statistics.channels.count("CHANNEL"), 1u);
  EXPECT_EQ(back.statistics.channels.at("CHANNEL").num_bytes, 210);
}

TEST_F(EventLogTest, LcmReadsOurs) {
  WriteEvents(path_, 5);
  lcm::LogFile log(path_.string(), "r");
  ASSERT_TRUE(log.good());
  for (int i = 0; i < 5; ++i) {
    const lcm::LogEvent* event = log.readNextEvent();
    ASSERT_NE(event, nullptr);
    EXPECT_EQ(event->eventnum, i);
    EXPECT_EQ(event->timestamp, 1000 + i);
    EXPECT_EQ(event->channel, "CHANNEL");
    EXPECT_EQ(event->datalen, i + 1);
  }
  EXPECT_EQ(log.readNextEvent(), nullptr);
}

TEST_F(EventLogTest, WeReadLcms) {
  {
    lcm::LogFile log(path_.string(), "w");
    std::array<std::uint8_t, 3> data = {7, 7, 7};
    lcm::LogEvent event = {};
    event.timestamp = 1234567890123456;
    event.channel = "A";
    event.datalen = 3;
    event.data = data.data();
    ASSERT_EQ(log.writeEvent(&event), 0);
  }
  auto log = EventLogReader::Open(path_);
  ASSERT_TRUE(log);
  LogEvent event;
  ASSERT_TRUE(*log->Next(&event));
  EXPECT_EQ(event.utime, 1234567890123456);
  EXPECT_EQ(event.channel, "A");
  EXPECT_EQ(event.data, (std::vector<std::uint8_t>{7, 7, 7}));
  EXPECT_FALSE(*log->Next(&event));
}

TEST_F(EventLogTest, CutAtAnyByteLosesOnlyTheCutEvent) {
  const auto offsets = WriteEvents(path_, 6);
  const std::string bytes = Bytes();
  for (std::size_t cut = 0; cut <= bytes.size(); ++cut) {
    SetBytes(bytes.substr(0, cut));
    const ReadBack back = ReadEvents(path_);
    int whole = 0;
    while (offsets[static_cast<std::size_t>(whole) + 1] <= cut && whole + 1 < 6) ++whole;
    if (cut == bytes.size()) whole = 6;
    EXPECT_EQ(back.events, Without(whole, {})) << cut;
    EXPECT_EQ(back.statistics.cut_bytes,
              static_cast<std::int64_t>(cut - offsets[static_cast<std::size_t>(whole)]))
        << cut;
    EXPECT_EQ(back.statistics.num_damaged, 0) << cut;
  }
}

TEST_F(EventLogTest, ADamagedHeaderCostsOnlyItsEvent) {
  const auto offsets = WriteEvents(path_, 8);
  const std::string good = Bytes();
  const struct {
    std::size_t byte;
    char value;
    const char* what;
  } cases[] = {{0, 0, "sync word"},
               {20, 0x7f, "channel length, huge"},
               {23, 0, "channel length, 0"},
               {24, 0x7f, "data length, beyond the file"},
               {27, 60, "data length, into the next events"}};
  for (const auto& c : cases) {
    std::string bytes = good;
    bytes[offsets[3] + c.byte] = c.value;
    SetBytes(bytes);
    const ReadBack back = ReadEvents(path_);
    EXPECT_EQ(back.events, Without(8, {3})) << c.what;
    EXPECT_EQ(back.statistics.num_damaged, 1) << c.what;
    EXPECT_EQ(back.statistics.damaged_bytes, static_cast<std::int64_t>(offsets[4] - offsets[3]))
        << c.what;
    EXPECT_EQ(back.statistics.cut_bytes, 0) << c.what;
  }
}

TEST_F(EventLogTest, AMissingPieceInTheMiddleCostsTheEventsItTouches) {
  const auto offsets = WriteEvents(path_, 10);
  std::string bytes = Bytes();
  bytes.erase(offsets[4] + 10, offsets[6] + 5 - offsets[4] - 10);
  SetBytes(bytes);
  EXPECT_EQ(ReadEvents(path_).events, Without(10, {4, 5, 6}));
}

TEST_F(EventLogTest, RandomDamageNeverHangsAndKeepsMostEvents) {
  WriteEvents(path_, 100);
  const std::string good = Bytes();
  Rng rng(7);
  for (int trial = 0; trial < 200; ++trial) {
    std::string bytes = good;
    for (int k = 0; k < 5; ++k) {
      bytes[rng.Index(static_cast<std::uint32_t>(bytes.size()))] =
          static_cast<char>(rng.Index(256));
    }
    SetBytes(bytes);
    EXPECT_GE(ReadEvents(path_).events.size(), 95u);
  }
}

TEST_F(EventLogTest, FlushesWhatIsOlderThanThePeriod) {
  g_clock_us = 0;
  EventLogWriterOptions options;
  options.now_us = FakeClock;
  auto log = EventLogWriter::Create(path_, options);
  ASSERT_TRUE(log);
  ASSERT_TRUE(log->Append("C", 1, "x", 1));
  EXPECT_EQ(fs::file_size(path_), 0u);
  g_clock_us = options.flush_period_us - 1;
  ASSERT_TRUE(log->FlushIfDue());
  EXPECT_EQ(fs::file_size(path_), 0u);
  EXPECT_EQ(log->num_written(), 0);
  g_clock_us = options.flush_period_us;
  ASSERT_TRUE(log->FlushIfDue());
  EXPECT_EQ(fs::file_size(path_), kEventHeaderBytes + 2);
  EXPECT_EQ(log->num_written(), 1);
}

TEST_F(EventLogTest, RefusesWhatIsNoEvent) {
  auto log = EventLogWriter::Create(path_);
  ASSERT_TRUE(log);
  EXPECT_FALSE(log->Append("", 1, "x", 1));
  EXPECT_FALSE(log->Append(std::string(64, 'c'), 1, "x", 1));
  ASSERT_TRUE(log->Close());
  EXPECT_FALSE(log->Append("C", 1, "x", 1));
}

TEST_F(EventLogTest, AFullDiskIsReportedAndTheLogStaysWhole) {
  if (::geteuid() != 0 || ::mount("tmpfs", folder_.path().c_str(), "tmpfs", 0, "size=64k") != 0) {
    GTEST_SKIP() << "a small tmpfs cannot be mounted here";
  }
  {
    EventLogWriterOptions options;
    options.flush_period_us = 0;
    auto log = EventLogWriter::Create(path_, options);
    ASSERT_TRUE(log);
    const std::string data(10000, 'd');
    int failures = 0;
    std::string message;
    for (int i = 0; i < 20; ++i) {
      const IoStatus status = log->Append("C", i, data.data(), data.size());
      if (status) continue;
      ++failures;
      message = ToString(status.error());
      EXPECT_EQ(ExitCode(status.error()), 1);
    }
    EXPECT_GT(failures, 0);
    EXPECT_THAT(message, HasSubstr("events.lcm"));
    EXPECT_THAT(message, HasSubstr("No space left"));
    EXPECT_THAT(message, HasSubstr("free space"));
    EXPECT_EQ(log->num_lost(), failures);
    EXPECT_EQ(log->num_written(), 20 - failures);
    EXPECT_TRUE(log->Close());
    const ReadBack back = ReadEvents(path_);
    EXPECT_EQ(static_cast<int>(back.events.size()), 20 - failures);
    EXPECT_EQ(back.statistics.cut_bytes, 0);
    EXPECT_EQ(back.statistics.num_damaged, 0);

    // Atomic outputs on the same full disk: an error, and nothing in place.
    const IoStatus status =
        WriteFileAtomically(folder_.path() / "model.ply", std::string(100000, 'x'));
    ASSERT_FALSE(status);
    EXPECT_THAT(ToString(status.error()), HasSubstr("No space left"));
    EXPECT_FALSE(fs::exists(folder_.path() / "model.ply"));
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), {}), 1);
  }
  EXPECT_EQ(::umount2(folder_.path().c_str(), MNT_DETACH), 0);
}

}  // namespace
}  // namespace rsfm
