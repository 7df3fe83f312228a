// The daemon with a camera: images that are recorded, and what a disk, a power cut or a rig file
// that changes does to them.
#include <gmock/gmock.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <set>

#include "rsfm/base/rng.h"
#include "tests/drivers/paced_video.h"
#include "tests/onboard/simulated_mission.h"
#include "tools/onboard/daemon.h"

namespace rsfm {
namespace {

using ::testing::HasSubstr;

class CameraDaemonTest : public SimulatedMission {
 protected:
  // The rig with a camera of 10 Hz, and more.
  fs::path Rig(const std::string& onboard, const std::string& capture = "") const {
    const fs::path path = folder_.path() / "rig.yaml";
    fs::copy_file(Images() / "rig.yaml", path, fs::copy_options::overwrite_existing);
    std::ofstream(path, std::ios::app) << "capture: {frame_rate_hz: 10" << capture << "}\n"
                                       << "onboard: {" << onboard << "}\n";
    return path;
  }
  // Every image of the table is there, whole; what lies beside them is not listed, and no more than
  // the one that was being written.
  static void ExpectWholeImages(const Mission& mission) {
    auto decoder = JpegDecoder::Create();
    std::vector<std::uint8_t> grey(kWidth * kHeight);
    for (const ImageTime& image : mission.images) {
      const auto bytes = ReadWholeFile(mission.folder / "images" / image.image);
      ASSERT_TRUE(bytes) << ToString(bytes.error());
      EXPECT_TRUE(decoder->Decode(
          std::span(reinterpret_cast<const std::uint8_t*>(bytes->data()), bytes->size()), kWidth,
          kHeight, grey.data()))
          << image.image;
    }
  }
};

// Killed at random moments: every image that a published pose of more than a second ago speaks of
// is in the table and whole, and what there is of the mission is refined. RSFM_KILLS says how
// often.
TEST_F(CameraDaemonTest, AKilledMissionHasItsImages) {
  const char* runs_text = std::getenv("RSFM_KILLS");
  const int runs = runs_text != nullptr ? std::atoi(runs_text) : 3;
  const fs::path rig = Rig("min_disk_free_mb: 0");
  Rng rng(23);
  int num_refined = 0, num_compared = 0;
  for (int i = 0; i < runs; ++i) {
    const fs::path out = folder_.path() / ("killed" + std::to_string(i));
    const fs::path published = folder_.path() / ("published" + std::to_string(i));
    Process process({RSFM_CAMERA_DAEMON, rig.string(), Images().string(), out.string(),
                     "file://" + published.string() + "?mode=w", "100000"});
    const auto enough = static_cast<std::uintmax_t>(rng.Uniform(1.0, 1000.0));
    while (SizeOf(out / "images.csv") < enough && !process.HasEnded()) WaitAMillisecond();
    for (int k = static_cast<int>(rng.Uniform(0.0, 600.0)); k > 0; --k) WaitAMillisecond();
    process.Kill(SIGKILL);
    process.Wait();
    const auto mission = ReadMission(out);
    ASSERT_TRUE(mission) << ToString(mission.error());
    EXPECT_EQ(mission->log.num_damaged, 0);
    ExpectWholeImages(*mission);
    std::set<Utime> listed;
    for (const ImageTime& image : mission->images) listed.insert(image.utime);
    const auto poses = MessagesOf<pose_t>(EventsOf(published), "RSFM_POSE");
    for (const pose_t& pose : poses) {
      if (pose.utime > poses.back().utime - 1'000'000) break;
      ++num_compared;
      EXPECT_TRUE(listed.contains(pose.utime))
          << "run " << i << ": " << poses.back().utime - pose.utime << " us before the end";
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

// The mission with its images on a file system of 600 kB: images stop, the log stops, each says so,
// and poses go on to the last image.
TEST_F(CameraDaemonTest, AFullFileSystemEndsImagesAndLogAndNotThePoses) {
  constexpr int kFrames = 60;
  const fs::path small = folder_.path() / "small", published = folder_.path() / "published";
  fs::create_directories(small);
  const std::string in_namespace = "unshare -rm sh -c ";
  const std::string mount = "mount -t tmpfs -o size=600k tmpfs " + small.string();
  if (RunProgram(in_namespace + "'" + mount + "'").exit_code != 0)
    GTEST_SKIP() << "a file system may not be mounted here";
  const std::string daemon = std::string(RSFM_CAMERA_DAEMON) + " " +
                             Rig("min_disk_free_mb: 0").string() + " " + Images().string() + " " +
                             (small / "mission").string() + " file://" + published.string() +
                             "?mode=w " + std::to_string(kFrames);
  const auto result = RunProgram(in_namespace + "'" + mount + " && { \"$@\"; code=$?; cp -rP " +
                                 (small / "mission").string() + " " + Out().string() +
                                 "; exit $code; }' sh " + daemon);
  EXPECT_EQ(result.exit_code, 1) << result.err;
  EXPECT_THAT(result.err, HasSubstr("events are missing"));
  const auto events = EventsOf(published);
  const auto statuses = MessagesOf<status_t>(events, "RSFM_STATUS");
  ASSERT_FALSE(statuses.empty());
  const status_t& last = statuses.back();
  EXPECT_THAT(last.message, HasSubstr("log cannot be written"));
  EXPECT_THAT(last.message, HasSubstr("images are not recorded"));
  EXPECT_GT(last.log_errors, 0);
  EXPECT_GT(last.images_dropped, 0);
  EXPECT_GT(last.images_recorded, 0);
  EXPECT_EQ(static_cast<std::int64_t>(MessagesOf<pose_t>(events, "RSFM_POSE").size()),
            last.frames_received - last.frames_dropped);
  EXPECT_GE(last.frames_received, kFrames);
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission) << ToString(mission.error());
  EXPECT_EQ(mission->log.num_damaged, 0);
  EXPECT_GT(mission->poses.size(), 0u);
  ExpectWholeImages(*mission);
}

// What SIGHUP brings: exposure to the camera, images to the disk although none were asked for at
// the start, and none again.
TEST_F(CameraDaemonTest, AReloadedRigFileTakesEffect) {
  PacedVideo video;
  video.fake.formats = {{V4L2_PIX_FMT_GREY, kWidth, kHeight, 1, 1000.0}};
  video.fake.controls[V4L2_CID_EXPOSURE_ABSOLUTE] = {"Exposure Time, Absolute", 1, 1000, 10};
  std::atomic<int> exposure = 0;  // in 100 us
  video.fake.fill = [&](std::uint32_t sequence, std::uint8_t* data, std::size_t* bytes) {
    for (std::size_t i = 0; i < *bytes; ++i) data[i] = static_cast<std::uint8_t>(i * 7 + sequence);
    exposure = video.fake.controls[V4L2_CID_EXPOSURE_ABSOLUTE].value;
  };
  DaemonOptions options;
  options.rig_file = Rig("record_images: false, min_disk_free_mb: 0", ", exposure_us: 2000");
  options.mission = Out();
  options.lcm_url = "memq://";
  options.video = &video;
  auto daemon = Daemon::Create(options);
  ASSERT_TRUE(daemon) << ToString(daemon.error());
  int step = 0;
  std::int64_t frames_before = 0, frames_at_end = 0;
  const auto wait = [&](int) {
    WaitAMillisecond();
    const status_t status = (*daemon)->MakeStatus(MonotonicUs());
    EXPECT_EQ(status.message, "");
    if (step == 0 && status.frames_received >= 5 && exposure == 20) {
      EXPECT_EQ(status.images_recorded, 0);
      frames_before = status.frames_received;
      Rig("record_images: true, min_disk_free_mb: 0", ", exposure_us: 4000");
    } else if (step == 1 && status.images_recorded >= 3 && exposure == 40) {
      frames_at_end = status.frames_received;
      Rig("record_images: false, min_disk_free_mb: 0", ", exposure_us: 4000");
    } else if (step == 2 && status.frames_received >= frames_at_end + 20) {
      return Daemon::Command::kStop;
    } else {
      return Daemon::Command::kNone;
    }
    ++step;
    return Daemon::Command::kReload;
  };
  const auto status = (*daemon)->Run(wait, Notifier());
  EXPECT_TRUE(status) << ToString(status.error());
  const auto mission = ReadMission(Out());
  ASSERT_TRUE(mission) << ToString(mission.error());
  const auto recorded = static_cast<std::int64_t>(mission->images.size());
  EXPECT_GE(recorded, 3);
  EXPECT_LE(recorded, frames_at_end - frames_before + 3);
  ExpectWholeImages(*mission);
}

// What a service manager hears.
TEST_F(CameraDaemonTest, TheServiceManagerHearsOfItsLife) {
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, (folder_.path() / "notify").c_str(), sizeof address.sun_path - 1);
  const int fd = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
  ASSERT_EQ(::bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  ::setenv("NOTIFY_SOCKET", address.sun_path, 1);
  ::setenv("WATCHDOG_USEC", "60000000", 1);
  const Notifier notifier;
  ::unsetenv("NOTIFY_SOCKET");
  ::unsetenv("WATCHDOG_USEC");
  PacedVideo video;
  video.fake.formats = {{V4L2_PIX_FMT_GREY, kWidth, kHeight, 1, 1000.0}};
  DaemonOptions options;
  options.rig_file = Rig("min_disk_free_mb: 0");
  options.write_mission = false;
  options.lcm_url = "memq://";
  options.video = &video;
  auto daemon = Daemon::Create(options);
  ASSERT_TRUE(daemon) << ToString(daemon.error());
  std::vector<std::string> heard;
  const auto listen = [&] {
    char text[64];
    for (ssize_t n; (n = ::recv(fd, text, sizeof text, 0)) > 0;)
      heard.emplace_back(text, static_cast<std::size_t>(n));
  };
  bool has_reloaded = false;
  const auto status = (*daemon)->Run(
      [&](int) {
        WaitAMillisecond();
        listen();
        if (heard.size() < 2 || (*daemon)->MakeStatus(MonotonicUs()).frames_received < 3)
          return Daemon::Command::kNone;
        if (has_reloaded) return Daemon::Command::kStop;
        has_reloaded = true;
        return Daemon::Command::kReload;
      },
      notifier);
  EXPECT_TRUE(status);
  listen();
  ::close(fd);
  EXPECT_EQ(heard, (std::vector<std::string>{"READY=1", "WATCHDOG=1", "RELOADING=1", "READY=1",
                                             "STOPPING=1"}));
}

}  // namespace
}  // namespace rsfm
