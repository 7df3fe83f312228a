// What the daemon's threads share: frames, queues and figures. Drop policies: docs/onboard.md.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "rsfm/io/messages.h"
#include "rsfm/io/rig.h"
#include "rsfm/navigation/nav_buffer.h"
#include "rsfm_drivers/lcm/message_queue.h"
#include "rsfm_drivers/v4l2/capture.h"
#include "tools/onboard/bounded_queue.h"
#include "tools/onboard/frame_pool.h"
#include "tools/onboard/memory_plan.h"
#include "tools/onboard/nav_arrival.h"
#include "tools/onboard/system.h"

namespace rsfm {

enum class Worker : std::uint8_t { kCapture, kMapper, kBus, kReceive, kLog, kRecord };
inline constexpr int kNumWorkers = 6;

struct Shared {
  explicit Shared(const Rig& rig)
      : pool(NumFrames(rig.onboard), static_cast<std::size_t>(rig.camera.width) *
                                         static_cast<std::size_t>(rig.camera.height)),
        frames(static_cast<std::size_t>(rig.onboard.frame_queue)),
        record(static_cast<std::size_t>(rig.onboard.record_queue)),
        nav(static_cast<std::size_t>(rig.onboard.nav_queue)),
        bus(static_cast<std::size_t>(rig.onboard.bus_queue_mb) << 20),
        log(static_cast<std::size_t>(rig.onboard.log_queue_mb) << 20),
        nav_waiting(rig.bus.inputs.size()),
        nav_share(std::max(
            1, rig.onboard.nav_queue / std::max(1, static_cast<int>(rig.bus.inputs.size())))) {
    for (auto& beat : beats) beat = kResting;
  }

  FramePool pool;
  BoundedQueue<Frame*> frames;   // capture to mapper
  BoundedQueue<Frame*> record;   // capture to recorder
  BoundedQueue<NavArrival> nav;  // bus (or the replayed table) to mapper
  MessageQueue bus, log;
  // Samples of each of rig.bus.inputs in `nav`, and how many may be: a sensor that floods its
  // channel costs its own samples and nobody else's.
  std::vector<std::atomic<int>> nav_waiting;
  const int nav_share;
  LatencyWindow latency;      // mid-exposure to the published pose
  LatencyWindow bus_latency;  // the mapper's end to the published pose

  std::atomic<bool> stop = false;
  std::atomic<bool> source_has_ended = false;
  std::atomic<bool> has_log = false, has_recorder = false;
  std::atomic<std::int64_t> frames_skipped = 0;  // the mapper was busy
  std::atomic<std::int64_t> frames_refused = 0;  // by front end or mapper
  std::atomic<std::int64_t> frames_mapped = 0;
  std::atomic<std::int64_t> images_not_queued = 0;
  std::atomic<std::int64_t> nav_overruns = 0;
  std::atomic<std::int64_t> nav_unusable = 0;  // nothing usable in the message
  std::array<std::atomic<std::int64_t>, kNumNavRejects> nav_rejected{};  // by the converter: fields
  std::atomic<std::int64_t> malformed = 0, publish_errors = 0, receive_overruns = 0;
  std::atomic<std::int64_t> log_errors = 0;
  std::atomic<bool> log_is_failing = false;                  // now
  std::atomic<bool> log_is_whole = true;                     // known at the end
  std::array<std::atomic<std::int64_t>, kNumWorkers> beats;  // monotonic: each thread is alive
  static constexpr std::int64_t kResting = INT64_MAX;        // not begun, or ended

  void Beat(Worker worker) { Allow(worker, 0); }
  // The thread is about to wait for something that may take so long.
  void Allow(Worker worker, std::int64_t duration_us) {
    beats[static_cast<std::size_t>(worker)] = MonotonicUs() + duration_us;
  }
  void Rest(Worker worker) { beats[static_cast<std::size_t>(worker)] = kResting; }
  // How long ago the thread went round its loop, beyond what it was allowed.
  std::int64_t SilenceUs(Worker worker, std::int64_t now_us) const {
    const std::int64_t beat_us = beats[static_cast<std::size_t>(worker)];
    return beat_us == kResting ? 0 : std::max<std::int64_t>(0, now_us - beat_us);
  }
  // Every thread that poses depend on has been round its loop not longer ago than that. Those that
  // write to the disk are not among them: a disk that hangs costs the mission, not the poses.
  bool IsAlive(std::int64_t now_us, std::int64_t limit_us) const {
    for (const Worker worker : {Worker::kCapture, Worker::kMapper, Worker::kBus, Worker::kReceive})
      if (SilenceUs(worker, now_us) > limit_us) return false;
    return true;
  }
  std::int64_t DiskSilenceUs(std::int64_t now_us) const {
    return std::max(SilenceUs(Worker::kLog, now_us), SilenceUs(Worker::kRecord, now_us));
  }

  mutable std::mutex mutex;  // of what follows
  CaptureCounters source;
  std::string source_problem;
  status_t vision{};  // what the mapper knows of a status
  bool world_is_ned = false, scale_is_metric = false, has_world = false;
  std::optional<Geodetic> origin;  // of the first fix
  std::optional<CaptureOptions> new_controls;
  std::string control_problem;
  std::string receive_problem;  // why no navigation is heard
  std::string thread_problems;

  void AddThreadProblem(const std::string& problem) {
    if (problem.empty()) return;
    const std::scoped_lock lock(mutex);
    thread_problems += (thread_problems.empty() ? "" : "; ") + problem;
  }
};

}  // namespace rsfm
