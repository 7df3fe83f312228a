// What the daemon's threads share: frames, queues and figures. Drop policies: docs/onboard.md.
#pragma once

#include <array>
#include <atomic>
#include <mutex>
#include <optional>
#include <string>

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
        log(static_cast<std::size_t>(rig.onboard.log_queue_mb) << 20) {
    const std::int64_t now_us = MonotonicUs();
    for (auto& beat : beats) beat = now_us;
  }

  FramePool pool;
  BoundedQueue<Frame*> frames;   // capture to mapper
  BoundedQueue<Frame*> record;   // capture to recorder
  BoundedQueue<NavArrival> nav;  // bus (or the replayed table) to mapper
  MessageQueue bus, log;
  LatencyWindow latency;      // mid-exposure to the published pose
  LatencyWindow bus_latency;  // the mapper's end to the published pose
  std::atomic<std::int64_t> bus_latency_origin = 0;

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

  void Beat(Worker worker) { beats[static_cast<std::size_t>(worker)] = MonotonicUs(); }

  std::mutex mutex;  // of what follows
  CaptureCounters source;
  std::string source_problem;
  status_t vision{};  // what the mapper knows of a status
  bool world_is_ned = false, scale_is_metric = false, has_world = false;
  std::optional<Geodetic> origin;  // of the first fix
  std::optional<CaptureOptions> new_controls;
  std::string control_problem;
  std::string thread_problems;

  void AddThreadProblem(const std::string& problem) {
    if (problem.empty()) return;
    const std::scoped_lock lock(mutex);
    thread_problems += (thread_problems.empty() ? "" : "; ") + problem;
  }
};

}  // namespace rsfm
