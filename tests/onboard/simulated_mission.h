// A small rendered mission, and programs that run on it and are killed.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <time.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/mission.h"
#include "rsfm_drivers/jpeg/jpeg.h"
#include "tests/support/run_program.h"
#include "tests/support/temporary_folder.h"

extern char** environ;

namespace rsfm {

namespace fs = std::filesystem;

inline constexpr int kWidth = 400, kHeight = 300;
inline constexpr char kScenario[] = R"(
seed: 11
rig:
  camera: {model: PINHOLE, width: 400, height: 300, params: [320, 320, 200, 150]}
  port: {type: flat, normal: [0, 0, 1], distance_m: 0.03, thickness_m: 0.02, index_air: 1.0, index_glass: 1.52, index_water: 1.336}
  body_from_camera:
    rotation_wxyz: [0.7071067811865476, 0, 0, 0.7071067811865476]
    translation_m: [0.40, 0.05, 0.15]
images: {rate_hz: 1.0, format: jpg, jpeg_quality: 95}
trajectory: {legs: 1, leg_length_m: 4.0, leg_spacing_m: 0.85, altitude_m: 1.6, speed_mps: 0.25, turns: strafe}
seafloor: {depth_m: 20.0}
)";

class SimulatedMission : public ::testing::Test {
 protected:
  // Rendered once for all tests of the suite, and made grey PGM: what every reader reads to the
  // same bytes.
  static void SetUpTestSuite() {
    shared_ = new TemporaryFolder;
    std::ofstream(shared_->path() / "scenario.yaml") << kScenario;
    const auto result = RunProgram(std::string(RSFM_TOOL) + " simulate " +
                                   (shared_->path() / "scenario.yaml").string() +
                                   " --images 12 --out " + (shared_->path() / "made").string());
    ASSERT_EQ(result.exit_code, 0) << result.err;
    const fs::path made = shared_->path() / "made";
    fs::create_directories(Images() / "images");
    fs::copy(made / "nav.csv", Images() / "nav.csv");
    fs::copy(made / "rig.yaml", Images() / "rig.yaml");
    auto times = ReadImageTimes(made / "images.csv");
    ASSERT_TRUE(times);
    auto decoder = JpegDecoder::Create();
    for (ImageTime& image : *times) {
      const auto bytes = ReadWholeFile(made / "images" / image.image);
      ASSERT_TRUE(bytes);
      std::vector<std::uint8_t> grey(kWidth * kHeight);
      ASSERT_TRUE(decoder->Decode(
          std::span(reinterpret_cast<const std::uint8_t*>(bytes->data()), bytes->size()), kWidth,
          kHeight, grey.data()));
      image.image = fs::path(image.image).stem().string() + ".pgm";
      std::ofstream file(Images() / "images" / image.image, std::ios::binary);
      file << "P5\n400 300\n255\n";
      file.write(reinterpret_cast<const char*>(grey.data()),
                 static_cast<std::streamsize>(grey.size()));
    }
    ASSERT_TRUE(WriteImageTimes(*times, Images() / "images.csv"));
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }

  static fs::path Images() { return shared_->path() / "grey"; }
  fs::path Out() const { return folder_.path() / "mission"; }

  static inline TemporaryFolder* shared_ = nullptr;
  TemporaryFolder folder_;
};

class Process {
 public:
  explicit Process(std::vector<std::string> arguments) {
    std::vector<char*> pointers;
    for (std::string& argument : arguments) pointers.push_back(argument.data());
    pointers.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
    EXPECT_EQ(::posix_spawn(&pid_, pointers[0], &actions, nullptr, pointers.data(), environ), 0);
    ::posix_spawn_file_actions_destroy(&actions);
  }
  ~Process() {
    if (!has_ended_) {
      ::kill(pid_, SIGKILL);
      Wait();
    }
  }
  bool HasEnded() {
    if (!has_ended_) has_ended_ = ::waitpid(pid_, &status_, WNOHANG) == pid_;
    return has_ended_;
  }
  int Wait() {
    if (!has_ended_) ::waitpid(pid_, &status_, 0);
    has_ended_ = true;
    return status_;
  }
  void Kill(int signal) { ::kill(pid_, signal); }

 private:
  pid_t pid_ = -1;
  int status_ = 0;
  bool has_ended_ = false;
};

inline std::uintmax_t SizeOf(const fs::path& path) {
  std::error_code error;
  const std::uintmax_t size = fs::file_size(path, error);
  return error ? 0 : size;
}

inline void WaitAMillisecond() {
  const timespec duration = {0, 1'000'000};
  ::nanosleep(&duration, nullptr);
}

// What a log holds, in its order, each event with the time at which it was written there.
inline std::vector<LogEvent> EventsOf(const fs::path& log) {
  std::vector<LogEvent> events;
  auto reader = EventLogReader::Open(log);
  EXPECT_TRUE(reader) << ToString(reader.error());
  LogEvent event;
  while (reader && reader->Next(&event).value_or(false)) events.push_back(event);
  return events;
}

template <class Message>
std::vector<Message> MessagesOf(const std::vector<LogEvent>& events, const std::string& channel) {
  std::vector<Message> messages;
  for (const LogEvent& event : events) {
    Message message;
    if (event.channel == channel && Decode(event.data, &message)) messages.push_back(message);
  }
  return messages;
}

}  // namespace rsfm
