// rsfm_onboard as it runs on the vehicle, with a simulated mission in the camera's place.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <set>

#include "rsfm/base/rng.h"
#include "tests/onboard/simulated_mission.h"
#include "tools/map/map_images.h"
#include "tools/onboard/daemon.h"

namespace rsfm {
namespace {

using ::testing::HasSubstr;

class DaemonTest : public SimulatedMission {
 protected:
  std::string Command(const std::string& more) const {
    return std::string(RSFM_ONBOARD) + " " + (Images() / "rig.yaml").string() +
           " --lcm-url memq:// --replay " + Images().string() + " " + more;
  }
};

// One mapper, two feeds: the daemon and `rsfm_tool map` say the same, bit for bit.
TEST_F(DaemonTest, AReplayIsWhatTheDeskMaps) {
  const auto result = RunProgram(Command("--rate 0 --out " + Out().string()));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("12 images"));
  MapRequest request;
  request.images = Images();
  request.rig = Images() / "rig.yaml";
  request.out = folder_.path() / "desk";
  const auto mapped = MapImages(request);
  ASSERT_TRUE(mapped) << ToString(mapped.error());
  const auto flown = ReadMission(Out()), desk = ReadMission(request.out);
  ASSERT_TRUE(flown) << ToString(flown.error());
  ASSERT_TRUE(desk) << ToString(desk.error());
  ASSERT_EQ(flown->poses.size(), 12u);
  ASSERT_EQ(desk->poses.size(), 12u);
  int num_tracking = 0;
  for (std::size_t i = 0; i < flown->poses.size(); ++i) {
    std::vector<std::uint8_t> a, b;
    ASSERT_TRUE(Encode(flown->poses[i], &a) && Encode(desk->poses[i], &b));
    EXPECT_EQ(a, b) << i;
    num_tracking += flown->poses[i].state == pose_t::STATE_TRACKING ? 1 : 0;
  }
  EXPECT_GT(num_tracking, 8);
  ASSERT_EQ(flown->keyframes.size(), desk->keyframes.size());
  for (std::size_t i = 0; i < flown->keyframes.size(); ++i) {
    std::vector<std::uint8_t> a, b;
    ASSERT_TRUE(Encode(flown->keyframes[i], &a) && Encode(desk->keyframes[i], &b));
    EXPECT_EQ(a, b) << i;
  }
  EXPECT_EQ(flown->nav.size(), desk->nav.size());
  EXPECT_EQ(flown->landmarks.size(), desk->landmarks.size());
  EXPECT_EQ(flown->rig.world.frame, desk->rig.world.frame);
  EXPECT_EQ(flown->images.size(), 12u);
  ASSERT_FALSE(flown->statuses.empty());
  const status_t& last = flown->statuses.back();
  EXPECT_EQ(last.frames_received, 12);
  EXPECT_EQ(last.frames_dropped, 0);
  EXPECT_EQ(last.messages_overrun, 0);
  EXPECT_EQ(last.log_errors, 0);
  EXPECT_EQ(last.message, "");
  EXPECT_GT(last.latency_p50_ms, 0.0);
  EXPECT_GT(last.memory_bytes, 0);
  // The desk refines what the vehicle brought home.
  const auto refined = RunProgram(std::string(RSFM_TOOL) + " refine " + Out().string() + " --out " +
                                  (folder_.path() / "model").string());
  EXPECT_EQ(refined.exit_code, 0) << refined.err;
}

// Navigation from a bus, images at their own rate: whatever came when, and whatever was dropped,
// the log of the flight replays to the same bytes.
TEST_F(DaemonTest, AFlightReplaysByteForByte) {
  MapRequest request;
  request.images = Images();
  request.rig = Images() / "rig.yaml";
  request.out = folder_.path() / "desk";
  ASSERT_TRUE(MapImages(request));
  const fs::path folder = folder_.path() / "camera";  // that knows nothing of navigation
  fs::copy(Images(), folder, fs::copy_options::recursive);
  fs::remove(folder / "nav.csv");
  const auto flown = RunProgram(std::string(RSFM_ONBOARD) + " " + (folder / "rig.yaml").string() +
                                " --replay " + folder.string() + " --rate 8 --lcm-url 'file://" +
                                (request.out / "events.lcm").string() + "?mode=r&speed=8' --out " +
                                Out().string());
  ASSERT_EQ(flown.exit_code, 0) << flown.err;
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission) << ToString(mission.error());
  EXPECT_GT(mission->nav.size(), 20u);
  EXPECT_GT(mission->poses.size(), 4u);
  const auto again = RunProgram(std::string(RSFM_TOOL) + " map --replay " + Out().string());
  EXPECT_EQ(again.exit_code, 0) << again.out << again.err;
  EXPECT_THAT(again.out, HasSubstr(std::to_string(mission->poses.size()) + " poses"));
}

// Ten thousand messages a second on every channel that the daemon listens to: rubbish, cut ones,
// other types, and a depth again and again. Poses are those without it; of the navigation nothing
// arrives that was not sent, and what is missing was counted.
TEST_F(DaemonTest, AFloodOnEveryChannelLeavesPosesAndNavigationRight) {
  constexpr int kSpeed = 4, kFloodHz = 10'000;
  MapRequest request;
  request.images = Images();
  request.rig = Images() / "rig.yaml";
  request.out = folder_.path() / "desk";
  ASSERT_TRUE(MapImages(request));
  const auto desk = ReadMission(request.out);
  ASSERT_TRUE(desk);
  std::vector<std::pair<std::string, std::vector<std::uint8_t>>> sent;
  const fs::path flooded = folder_.path() / "flooded.lcm";
  {
    auto log = EventLogWriter::Create(flooded, {.sync_to_disk = false});
    ASSERT_TRUE(log);
    Rng rng(5);
    Utime last = 0;
    std::vector<std::uint8_t> depth;
    for (const LogEvent& event : EventsOf(request.out / "events.lcm")) {
      if (event.channel.starts_with("RSFM_POSE") || event.channel.starts_with("RSFM_STATUS") ||
          event.channel.starts_with("RSFM_KEYFRAME") || event.channel.starts_with("RSFM_LANDMARKS"))
        continue;
      const Utime utime = event.utime;
      for (; last > 0 && last < utime; last += kSpeed * 1'000'000 / kFloodHz) {
        for (const BusInput& input : desk->rig.bus.inputs) {
          std::vector<std::uint8_t> bytes = event.data;
          const std::uint32_t kind = rng.Index(3);
          if (kind == 0) bytes.pop_back();
          if (kind == 1) bytes.assign(40, static_cast<std::uint8_t>(rng.Index(256)));
          if (kind == 2 && input.channel == "RSFM_DEPTH") bytes = depth;
          if (kind == 2 && input.channel == event.channel) bytes[3] ^= 1;  // its fingerprint
          ASSERT_TRUE(log->Append(input.channel, last, bytes.data(), bytes.size()));
        }
      }
      last = std::max(last, utime);
      if (event.channel == "RSFM_DEPTH") depth = event.data;
      sent.emplace_back(event.channel, event.data);
      ASSERT_TRUE(log->Append(event.channel, utime, event.data.data(), event.data.size()));
    }
    ASSERT_TRUE(log->Close());
  }
  const fs::path folder = folder_.path() / "camera";  // that knows nothing of navigation
  fs::copy(Images(), folder, fs::copy_options::recursive);
  fs::remove(folder / "nav.csv");
  const auto flown = RunProgram(
      std::string(RSFM_ONBOARD) + " " + (folder / "rig.yaml").string() + " --replay " +
      folder.string() + " --rate " + std::to_string(kSpeed) + " --lcm-url 'file://" +
      flooded.string() + "?mode=r&speed=" + std::to_string(kSpeed) + "' --out " + Out().string());
  ASSERT_EQ(flown.exit_code, 0) << flown.err;
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission) << ToString(mission.error());
  ASSERT_FALSE(mission->statuses.empty());
  const status_t& last = mission->statuses.back();
  EXPECT_GT(last.messages_malformed, 10'000);
  std::set<std::pair<std::string, std::vector<std::uint8_t>>> heard;
  for (const LogEvent& event : EventsOf(Out() / "events.lcm"))
    heard.emplace(event.channel, event.data);
  // The flight ends with the last image, whatever is on its way by then.
  while (!sent.empty() && !heard.contains(sent.back())) sent.pop_back();
  EXPECT_GT(sent.size(), 100u);
  for (const auto& message : sent)
    EXPECT_TRUE(heard.contains(message) || last.messages_overrun > 0) << message.first;
  int num_compared = 0;
  for (const pose_t& pose : mission->poses) {
    for (const pose_t& truth : desk->poses) {
      if (truth.utime != pose.utime || truth.frame_id != pose.frame_id ||
          truth.state != pose_t::STATE_TRACKING || pose.state != pose_t::STATE_TRACKING)
        continue;
      ++num_compared;
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(pose.position_m[k], truth.position_m[k], 0.1);
    }
  }
  EXPECT_GT(num_compared, 1);
}

// A pose of an image that was not kept: named, and nothing is compared with the wrong one.
TEST_F(DaemonTest, AFlightWithoutItsImagesSaysSo) {
  ASSERT_EQ(RunProgram(Command("--rate 0 --out " + Out().string())).exit_code, 0);
  auto times = ReadImageTimes(Out() / "images.csv");
  ASSERT_TRUE(times);
  times->erase(times->begin() + 5);
  ASSERT_TRUE(WriteImageTimes(*times, Out() / "images.csv"));
  const auto again = RunProgram(std::string(RSFM_TOOL) + " map --replay " + Out().string());
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_THAT(again.out, HasSubstr("5 poses the same; then event"));
  EXPECT_THAT(again.err, HasSubstr("its image is not among the mission's"));
}

TEST_F(DaemonTest, DamagedImagesAreCountedAndTheRestIsMapped) {
  const fs::path copy = folder_.path() / "copy";
  fs::copy(Images(), copy, fs::copy_options::recursive);
  const auto times = ReadImageTimes(copy / "images.csv");
  fs::resize_file(copy / "images" / (*times)[3].image, 1000);
  std::ofstream(copy / "images" / (*times)[7].image) << "not an image";
  const auto result = RunProgram(std::string(RSFM_ONBOARD) + " " + (copy / "rig.yaml").string() +
                                 " --lcm-url memq:// --rate 0 --replay " + copy.string() +
                                 " --out " + Out().string());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission) << ToString(mission.error());
  EXPECT_EQ(mission->poses.size(), 10u);
  EXPECT_EQ(mission->statuses.back().frames_damaged, 2);
  EXPECT_EQ(mission->statuses.back().frames_dropped, 2);
}

// Files may not grow beyond 100 kB: to the program a full disk. The log stops; the mapping does
// not.
TEST_F(DaemonTest, AFullDiskCostsTheLogAndNotThePoses) {
  const auto result = RunProgram("ulimit -f 100; " + Command("--rate 0 --out " + Out().string()));
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr("12 images"));
  EXPECT_THAT(result.err, HasSubstr("events are missing"));
  EXPECT_EQ(result.err.find(" 0 placed"), std::string::npos) << result.err;
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission) << ToString(mission.error());
  EXPECT_EQ(mission->log.num_damaged, 0);
}

TEST_F(DaemonTest, AMissionFolderThatIsThereIsNotTouched) {
  fs::create_directories(Out());
  const auto result = RunProgram(Command("--rate 0 --out " + Out().string()));
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_THAT(result.err, HasSubstr("exists"));
  EXPECT_TRUE(fs::is_empty(Out()));
}

TEST_F(DaemonTest, WrongRequestsSayWhatIsWrong) {
  const std::string program = RSFM_ONBOARD;
  const std::string rig = (Images() / "rig.yaml").string();
  const std::pair<std::string, std::string> cases[] = {
      {program, "RIG.yaml: is missing"},
      {program + " /no/such/rig.yaml", "/no/such/rig.yaml"},
      {program + " " + rig + " --speed 3", "--speed"},
      {program + " " + rig + " --rate 1", "--replay only"},
      {program + " " + rig + " --replay " + Images().string() + " --rate fast", "--rate"},
      {program + " " + rig + " --replay /no/such/folder", "is not a folder"},
      {program + " " + rig + " --replay", "lacks its value"},
      {program + " " + rig + " --lcm-url nothing:// --no-mission", "nothing://"},
      {program + " " + rig + " --no-mission --out /tmp/x", "contradicts"}};
  for (const auto& [command, message] : cases) {
    const auto result = RunProgram(command);
    EXPECT_EQ(result.exit_code, 2) << command;
    EXPECT_THAT(result.err, HasSubstr(message)) << command;
  }
  EXPECT_EQ(RunProgram(program + " --help").exit_code, 0);
  EXPECT_EQ(RunProgram(program + " --version").exit_code, 0);
}

// Killed up to 0.6 s after the log has grown to a random size. What was in the file is in the
// mission; everything published more than a second before the last publication (the bus is a file
// here) is in it, too; and what there is of it is refined. RSFM_KILLS says how often.
TEST_F(DaemonTest, AKilledMissionOpens) {
  const char* runs_text = std::getenv("RSFM_KILLS");
  const int runs = runs_text != nullptr ? std::atoi(runs_text) : 4;
  int num_refined = 0, num_compared = 0;
  Rng rng(17);
  for (int i = 0; i < runs; ++i) {
    const fs::path out = folder_.path() / ("killed" + std::to_string(i));
    const auto enough = static_cast<std::uintmax_t>(rng.Uniform(1000.0, 1'500'000.0));
    const fs::path published = folder_.path() / ("published" + std::to_string(i));
    Process process({RSFM_ONBOARD, (Images() / "rig.yaml").string(), "--lcm-url",
                     "file://" + published.string() + "?mode=w", "--replay", Images().string(),
                     "--rate", "4", "--out", out.string()});
    std::uintmax_t size = 0;
    while (size < enough && !process.HasEnded()) {
      WaitAMillisecond();
      size = SizeOf(out / "events.lcm");
    }
    for (int k = static_cast<int>(rng.Uniform(0.0, 600.0)); k > 0; --k) WaitAMillisecond();
    process.Kill(SIGKILL);
    process.Wait();
    const auto mission = ReadMission(out);
    ASSERT_TRUE(mission) << ToString(mission.error());
    EXPECT_EQ(mission->log.num_damaged, 0);
    std::int64_t bytes = mission->log.cut_bytes;
    for (const auto& [name, channel] : mission->log.channels) {
      bytes += channel.num_bytes +
               channel.num_events * static_cast<std::int64_t>(kEventHeaderBytes + name.size());
    }
    EXPECT_GE(bytes, static_cast<std::int64_t>(size));
    EXPECT_EQ(mission->images.size(), 12u);
    std::set<std::pair<std::string, std::vector<std::uint8_t>>> logged;
    for (const LogEvent& event : EventsOf(out / "events.lcm"))
      logged.emplace(event.channel, event.data);
    const auto events = EventsOf(published);
    for (const LogEvent& event : events) {
      if (event.utime > events.back().utime - 1'000'000) break;
      ++num_compared;
      EXPECT_TRUE(logged.contains({event.channel, event.data}))
          << "run " << i << ": " << event.channel << " " << events.back().utime - event.utime
          << " us before the end";
    }
    if (mission->keyframes.size() < 4) continue;
    ++num_refined;
    const auto refined = RunProgram(std::string(RSFM_TOOL) + " refine " + out.string() + " --out " +
                                    out.string() + "_model");
    EXPECT_EQ(refined.exit_code, 0) << refined.err;
  }
  EXPECT_GT(num_refined, 0);
  EXPECT_GT(num_compared, 0);
}

// The mission on a file system of 150 kB that is full after a few images.
TEST_F(DaemonTest, AFullFileSystemEndsTheLogAndNotThePoses) {
  const fs::path small = folder_.path() / "small", published = folder_.path() / "published";
  fs::create_directories(small);
  const std::string in_namespace = "unshare -rm sh -c ";
  const std::string mount = "mount -t tmpfs -o size=150k tmpfs " + small.string();
  if (RunProgram(in_namespace + "'" + mount + "'").exit_code != 0)
    GTEST_SKIP() << "a file system may not be mounted here";
  const std::string onboard = std::string(RSFM_ONBOARD) + " " + (Images() / "rig.yaml").string() +
                              " --lcm-url file://" + published.string() + "?mode=w --replay " +
                              Images().string() + " --rate 0 --out " + (small / "mission").string();
  const auto result = RunProgram(in_namespace + "'" + mount + " && { \"$@\"; code=$?; cp -rP " +
                                 (small / "mission").string() + " " + Out().string() +
                                 "; exit $code; }' sh " + onboard);
  EXPECT_EQ(result.exit_code, 1) << result.err;
  EXPECT_THAT(result.err, HasSubstr("events are missing"));
  const auto events = EventsOf(published);
  EXPECT_EQ(MessagesOf<pose_t>(events, "RSFM_POSE").size(), 12u);
  const auto statuses = MessagesOf<status_t>(events, "RSFM_STATUS");
  ASSERT_FALSE(statuses.empty());
  EXPECT_THAT(statuses.back().message, HasSubstr("log cannot be written"));
  EXPECT_GT(statuses.back().log_errors, 0);
  EXPECT_LT(statuses.back().disk_free_bytes, 100'000);
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission) << ToString(mission.error());
  EXPECT_EQ(mission->log.num_damaged, 0);
  EXPECT_GT(mission->poses.size(), 0u);
  // The keyframes, a third of the disk each, are what finds no room; poses between them may.
  EXPECT_LT(mission->keyframes.size(), MessagesOf<keyframe_t>(events, "RSFM_KEYFRAME").size());
}

TEST_F(DaemonTest, SigtermClosesTheMission) {
  Process process({RSFM_ONBOARD, (Images() / "rig.yaml").string(), "--lcm-url", "memq://",
                   "--replay", Images().string(), "--rate", "1", "--out", Out().string()});
  while (SizeOf(Out() / "events.lcm") == 0 && !process.HasEnded()) WaitAMillisecond();
  process.Kill(SIGHUP);  // the rig file is as it was: nothing changes
  process.Kill(SIGTERM);
  const int status = process.Wait();
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission) << ToString(mission.error());
  EXPECT_EQ(mission->log.cut_bytes, 0);
  EXPECT_LT(mission->poses.size(), 12u);
  ASSERT_FALSE(mission->statuses.empty());
}

// A camera that is not there: the daemon goes on, and says so each second.
TEST_F(DaemonTest, WithoutACameraItWaitsAndSaysSo) {
  const fs::path rig = folder_.path() / "rig.yaml";
  fs::copy(Images() / "rig.yaml", rig);
  std::ofstream(rig, std::ios::app) << "capture:\n  device: /dev/video-that-is-not\n";
  DaemonOptions options;
  options.rig_file = rig;
  options.mission = Out();
  options.lcm_url = "memq://";
  auto daemon = Daemon::Create(options);
  ASSERT_TRUE(daemon) << ToString(daemon.error());
  int calls = 0;
  const auto status = (*daemon)->Run(
      [&](int) {
        WaitAMillisecond();
        if (++calls == 5) {  // SIGHUP with a file that has become wrong
          std::ofstream(rig, std::ios::app) << "nonsense: 1\n";
          return Daemon::Command::kReload;
        }
        const bool is_known =
            (*daemon)->MakeStatus(MonotonicUs()).message.find("video-that-is-not") !=
            std::string::npos;
        return is_known && calls > 5 ? Daemon::Command::kStop : Daemon::Command::kNone;
      },
      Notifier());
  EXPECT_TRUE(status);
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission) << ToString(mission.error());
  ASSERT_FALSE(mission->statuses.empty());
  EXPECT_EQ(mission->statuses.back().frames_received, 0);
  EXPECT_THAT(mission->statuses.back().message, HasSubstr("cannot open the camera"));
  EXPECT_THAT(mission->statuses.back().message, HasSubstr("nonsense"));
  EXPECT_EQ(mission->images.size(), 0u);
}

}  // namespace
}  // namespace rsfm
