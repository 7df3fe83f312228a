#include "tools/onboard/daemon.h"

#include <time.h>

#include <algorithm>
#include <cstdio>

#include "rsfm/base/resident_memory.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kStatusPeriodUs = 1'000'000;
constexpr int kCommandWaitMs = 100;
constexpr std::int64_t kDiskPatienceUs = 5'000'000;

std::string UtcName() {
  const std::time_t now = std::time(nullptr);
  std::tm utc = {};
  ::gmtime_r(&now, &utc);
  char name[32];
  std::strftime(name, sizeof name, "%Y%m%dT%H%M%SZ", &utc);
  return name;
}

// A folder that did not exist.
IoExpected<fs::path> NewFolder(const fs::path& wanted, bool may_rename) {
  std::error_code error;
  if (wanted.has_parent_path()) fs::create_directories(wanted.parent_path(), error);
  if (error) return Fail(FromErrno(error.value(), wanted.string(), "create the mission"));
  for (int i = 1; i < 1000; ++i) {
    const fs::path path = i == 1 ? wanted : fs::path(wanted.string() + "-" + std::to_string(i));
    if (fs::create_directory(path, error)) return path;
    if (error) return Fail(FromErrno(error.value(), path.string(), "create the mission"));
    if (!may_rename) break;
  }
  return Fail({Errc::kInvalidArgument, wanted.string(), "--out", "exists",
               "give a folder that does not exist yet"});
}

}  // namespace

Daemon::~Daemon() {
  if (shared_) Finish();
}

IoExpected<std::unique_ptr<Daemon>> Daemon::Create(const DaemonOptions& options) {
  std::unique_ptr<Daemon> daemon(new Daemon());
  daemon->options_ = options;
  auto rig = ReadRig(options.rig_file);
  if (!rig) return Fail(rig.error());
  daemon->worker_.rig = std::move(*rig);
  if (!options.lcm_url.empty()) daemon->worker_.rig.bus.lcm_url = options.lcm_url;
  if (auto s = daemon->OpenSource(); !s) return Fail(s.error());
  Rig& rig_now = daemon->worker_.rig;
  auto feed = MapperFeed::Create(rig_now, options.rig_file.string());
  if (!feed) return Fail(feed.error());
  daemon->feed_ = std::make_unique<MapperFeed>(std::move(*feed));
  LcmBusOptions bus;
  bus.url = rig_now.bus.lcm_url;
  auto opened = LcmBus::Create(bus);
  if (!opened) return Fail(opened.error());
  daemon->bus_ = std::move(*opened);
  daemon->shared_ = std::make_unique<Shared>(rig_now);
  if (auto s = daemon->OpenMission(); !s) {
    if (ExitCode(s.error()) != 1) return Fail(s.error());
    daemon->mission_problem_ = "the mission is not written: " + ToString(s.error());
  }
  if (rig_now.onboard.lock_memory) daemon->memory_problem_ = LockMemory();
  return daemon;
}

IoStatus Daemon::OpenSource() {
  Rig& rig = worker_.rig;
  if (!options_.replay) {
    source_ = std::make_unique<CameraSource>(
        options_.video != nullptr ? options_.video : &KernelVideoSystem(), rig.capture,
        rig.camera.width, rig.camera.height);
    return {};
  }
  auto list = ListImages(*options_.replay, std::nullopt, 1.0);
  if (!list) return Fail(list.error());
  std::vector<NavSample> nav;
  if (const auto path = options_.nav ? options_.nav : list->nav) {
    auto table = ReadNavTable(*path, list->images, rig.world.origin);
    if (!table) return Fail(table.error());
    nav = std::move(table->samples);
    AddNavInput(&rig.bus);
    if (!rig.world.origin) rig.world.origin = table->origin;
    worker_.nav_comes_from_file = true;
  }
  worker_.is_replay = true;
  worker_.loses_nothing = options_.replay_options.rate <= 0.0;
  source_ = std::make_unique<ReplaySource>(std::move(*list), std::move(nav), rig.camera.width,
                                           rig.camera.height, options_.replay_options);
  return {};
}

IoStatus Daemon::OpenMission() {
  if (!options_.write_mission) return {};
  Rig& rig = worker_.rig;
  const bool is_named = !options_.mission.empty();
  auto folder = NewFolder(
      is_named ? options_.mission : fs::path(rig.onboard.missions_folder) / UtcName(), !is_named);
  if (!folder) return Fail(folder.error());
  mission_ = *folder;
  auto writer = MissionWriter::Create(mission_, rig);
  if (!writer) return Fail(writer.error());
  if (worker_.is_replay) {
    const ImageList& list = static_cast<ReplaySource*>(source_.get())->list();
    if (auto s = writer->WriteImageTimes(list.images); !s) return s;
    if (auto s = writer->LinkImages(list.folder); !s) return s;
  } else {  // ready even where nothing is recorded yet: SIGHUP may ask for it
    auto recorder = Recorder::Create(mission_, rig.onboard, rig.camera.width, rig.camera.height);
    if (recorder) {
      recorder_ = std::move(*recorder);
      shared_->has_recorder = rig.onboard.record_images;
    } else {
      recorder_problem_ = "images are not recorded: " + ToString(recorder.error());
    }
  }
  writer_ = std::make_unique<MissionWriter>(std::move(*writer));
  shared_->has_log = true;
  return {};
}

void Daemon::Start() {
  Shared* shared = shared_.get();
  last_status_us_ = MonotonicUs();
  if (writer_) log_ = std::thread([this, shared] { RunLog(worker_, writer_.get(), shared); });
  if (recorder_) record_ = std::thread([this, shared] { RunRecorder(recorder_.get(), shared); });
  bus_thread_ = std::thread([this, shared] { RunBus(worker_, bus_.get(), shared); });
  if (!worker_.nav_comes_from_file && !worker_.rig.bus.inputs.empty())
    receive_ = std::thread([this, shared] { RunReceive(worker_, bus_.get(), shared); });
  mapper_ = std::thread([this, shared] { RunMapper(worker_, feed_.get(), shared); });
  capture_ = std::thread([this, shared] { RunCapture(worker_, source_.get(), shared); });
}

// From the source downstream: each thread ends when what feeds it has.
void Daemon::Finish() {
  shared_->stop = true;
  const auto join = [](std::thread* thread) {
    if (thread->joinable()) thread->join();
  };
  join(&capture_);
  join(&receive_);
  join(&record_);
  join(&mapper_);
  if (bus_thread_.joinable()) PublishStatus();
  shared_->bus.Close();
  shared_->log.Close();
  join(&bus_thread_);
  join(&log_);
}

std::string Daemon::Problems(std::int64_t now_us) {
  std::string text;
  const auto add = [&text](const std::string& problem) {
    if (!problem.empty()) text += (text.empty() ? "" : "; ") + problem;
  };
  add(mission_problem_);
  add(recorder_problem_);
  add(memory_problem_);
  if (const std::int64_t silence_us = shared_->DiskSilenceUs(now_us); silence_us > kDiskPatienceUs)
    add("the mission's disk has not answered for " + std::to_string(silence_us / 1'000'000) + " s");
  if (shared_->log_is_failing) add("the mission's log cannot be written");
  if (recorder_ && recorder_->problem() != nullptr) add(recorder_->problem());
  add(reload_problem_);
  const std::scoped_lock lock(shared_->mutex);
  add(shared_->source_problem);
  add(shared_->control_problem);
  add(shared_->receive_problem);
  add(shared_->thread_problems);
  return text;
}

status_t Daemon::MakeStatus(std::int64_t now_us) {
  status_t status;
  CaptureCounters source;
  std::optional<Geodetic> origin;
  {
    const std::scoped_lock lock(shared_->mutex);
    status = shared_->vision;
    source = shared_->source;
    origin = shared_->origin;
  }
  if (!worker_.is_replay) status.utime = UtcNow();  // else of the last image
  if (origin && !status.origin_is_known) {
    status.origin_is_known = true;
    status.origin_latitude_deg = origin->latitude_deg;
    status.origin_longitude_deg = origin->longitude_deg;
    status.origin_height_m = origin->height_m;
  }
  status.frames_received = source.frames;
  status.frames_missed = source.missed;
  status.frames_damaged += source.damaged + source.io_errors;  // and those that show nothing
  status.frames_late = source.late + shared_->frames_refused;
  status.frames_skipped = shared_->frames_skipped;
  status.frames_dropped =
      status.frames_missed + status.frames_damaged + status.frames_late + status.frames_skipped;
  status.camera_restarts = source.restarts;
  status.camera_failed_openings = source.failed_openings;
  status.camera_bad_stamps = source.bad_stamps;
  status.clock_steps = source.clock_steps;
  const auto reasons = NavReasons(&status);
  for (std::size_t i = 0; i < reasons.size(); ++i) {
    const std::int64_t count = shared_->nav_rejected[i];
    *reasons[i] += count;
    status.nav_rejected += count;
  }
  status.nav_unusable = shared_->nav_unusable;
  status.messages_malformed = shared_->malformed;
  status.messages_overrun = shared_->nav_overruns + shared_->receive_overruns +
                            shared_->bus.num_dropped() + shared_->log.num_dropped();
  status.publish_errors = shared_->publish_errors;
  status.log_errors = shared_->log_errors;
  status.images_recorded = recorder_ ? recorder_->num_recorded() : 0;
  status.images_dropped = shared_->images_not_queued + (recorder_ ? recorder_->num_failed() : 0);
  status.frame_rate_hz = frame_rate_hz_;
  const auto latency = shared_->latency.Compute(now_us);
  status.latency_p50_ms = latency.p50_ms;
  status.latency_p99_ms = latency.p99_ms;
  status.memory_bytes = ResidentBytes();
  status.disk_free_bytes = writer_ ? FreeDiskBytes(mission_) : -1;
  status.message = Problems(now_us);
  return status;
}

void Daemon::PublishStatus() {
  const std::int64_t now_us = MonotonicUs();
  const std::int64_t frames = shared_->frames_mapped;
  if (now_us > last_status_us_) {
    frame_rate_hz_ = 1e6 * static_cast<double>(frames - last_frames_) /
                     static_cast<double>(now_us - last_status_us_);
  }
  last_frames_ = frames;
  last_status_us_ = now_us;
  const status_t status = MakeStatus(now_us);
  if (status.utime == 0) return;  // a replay before its first image
  if (!Encode(status, &encoded_)) return;
  const std::string& channel = worker_.rig.bus.status_channel;
  shared_->bus.Push(channel, status.utime, {}, encoded_);
  if (shared_->has_log) shared_->log.Push(channel, status.utime, {}, encoded_);
}

void Daemon::Reload() {
  const auto rig = ReadRig(options_.rig_file);
  if (!rig) {
    reload_problem_ = "the rig file was not read again: " + ToString(rig.error());
    return;
  }
  reload_problem_.clear();
  if (recorder_) {
    recorder_->SetQuality(rig->onboard.jpeg_quality);
    recorder_->SetLimits(rig->onboard.image_quota_mb, rig->onboard.min_disk_free_mb);
    shared_->has_recorder = rig->onboard.record_images;
  }
  const std::scoped_lock lock(shared_->mutex);
  shared_->new_controls = rig->capture;
}

IoStatus Daemon::HowItEnded() const {
  if (!mission_problem_.empty())
    return Fail({Errc::kIo, mission_.string(), "", mission_problem_, "make room on the disk"});
  const std::int64_t num_dropped = shared_->log.num_dropped();
  if (shared_->log_is_whole && num_dropped == 0) return {};
  const std::int64_t num_lost = shared_->log_errors;
  return Fail({Errc::kIo, mission_.string(), std::string(kEventsFile),
               "could not be written whole: " + std::to_string(num_lost + num_dropped) +
                   " events are missing, " + std::to_string(num_dropped) +
                   " of them because the disk was too slow",
               num_lost > 0 ? "make room on the disk" : "give onboard.log_queue_mb more"});
}

IoStatus Daemon::Run(const std::function<Command(int timeout_ms)>& wait, const Notifier& notifier) {
  Start();
  notifier.Send("READY=1");
  const std::int64_t watchdog_us = notifier.watchdog_us();
  std::int64_t last_watchdog_us = 0;
  while (!shared_->source_has_ended) {
    const Command command = wait(kCommandWaitMs);
    if (command == Command::kStop) break;
    if (command == Command::kReload) {
      notifier.Send("RELOADING=1");
      Reload();
      notifier.Send("READY=1");
    }
    const std::int64_t now_us = MonotonicUs();
    if (now_us - last_status_us_ >= kStatusPeriodUs) {
      PublishStatus();
    }
    if (watchdog_us > 0 && now_us - last_watchdog_us >= watchdog_us / 4 &&
        shared_->IsAlive(now_us, watchdog_us)) {
      last_watchdog_us = now_us;
      notifier.Send("WATCHDOG=1");
    }
  }
  notifier.Send("STOPPING=1");
  Finish();
  return HowItEnded();
}

}  // namespace rsfm
