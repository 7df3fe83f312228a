// The vehicle's daemon: camera to mapper to bus and mission.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "tools/onboard/system.h"
#include "tools/onboard/workers.h"

namespace rsfm {

struct DaemonOptions {
  std::filesystem::path rig_file;
  std::filesystem::path mission;  // empty: a new folder in onboard.missions_folder
  bool write_mission = true;
  std::string lcm_url;                          // empty: the rig's
  std::optional<std::filesystem::path> replay;  // a folder of images, or a mission
  std::optional<std::filesystem::path> nav;     // of a replay; else the folder's nav.csv
  VideoSystem* video = nullptr;                 // where the camera is; null: the kernel's
  ReplayOptions replay_options;
};

class Daemon {
 public:
  enum class Command : std::uint8_t { kNone, kStop, kReload };

  // Opens everything but the camera, which may come later. A mission that cannot be written because
  // of the disk is no error: poses matter more; the status says so.
  static IoExpected<std::unique_ptr<Daemon>> Create(const DaemonOptions& options);
  ~Daemon();

  // Starts the threads; until the source ends or `wait` says kStop. `wait` is asked for the next
  // command, and waits up to that long. Then everything is closed in order. kIo when the mission
  // was not written, or not whole.
  IoStatus Run(const std::function<Command(int timeout_ms)>& wait, const Notifier& notifier);

  const std::filesystem::path& mission() const { return mission_; }
  const Shared& shared() const { return *shared_; }
  // As of now; also what is published each second.
  status_t MakeStatus(std::int64_t now_us);
  // Why the mission is not written; empty: it is.
  const std::string& mission_problem() const { return mission_problem_; }
  // Why onboard.lock_memory could not be done; empty: it was, or was not asked for.
  const std::string& memory_problem() const { return memory_problem_; }

 private:
  Daemon() = default;
  IoStatus OpenSource();
  IoStatus OpenMission();
  void Start();
  void Finish();
  void Reload();
  void PublishStatus();
  std::string Problems(std::int64_t now_us);
  IoStatus HowItEnded() const;

  DaemonOptions options_;
  WorkerOptions worker_;
  std::unique_ptr<Shared> shared_;
  std::unique_ptr<LcmBus> bus_;
  std::unique_ptr<FrameSource> source_;
  std::unique_ptr<MapperFeed> feed_;
  std::unique_ptr<MissionWriter> writer_;
  std::unique_ptr<Recorder> recorder_;
  std::filesystem::path mission_;
  std::string mission_problem_, recorder_problem_, memory_problem_, reload_problem_;
  std::vector<std::uint8_t> encoded_;
  std::thread capture_, mapper_, bus_thread_, receive_, log_, record_;
  std::int64_t last_status_us_ = 0, last_frames_ = 0;
  double frame_rate_hz_ = 0.0;
};

}  // namespace rsfm
