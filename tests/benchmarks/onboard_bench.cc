// The daemon's own share: the camera's thread, what bus and log add to the mapper's time, and
// messages through the queue into a mission's log on the disk, against writing the same bytes in
// one go.
#include <benchmark/benchmark.h>
#include <time.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <thread>
#include <vector>

#include "tests/drivers/paced_video.h"
#include "tests/support/temporary_folder.h"
#include "tools/onboard/workers.h"

namespace rsfm {
namespace {

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Of the calling thread, user and system.
double ThreadCpuSeconds() {
  timespec time = {};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

double PlainSeconds(const std::vector<std::uint8_t>& message, int count) {
  const TemporaryFolder folder;
  const auto start = std::chrono::steady_clock::now();
  std::FILE* file = std::fopen((folder.path() / "plain").c_str(), "wb");
  for (int i = 0; i < count; ++i) std::fwrite(message.data(), 1, message.size(), file);
  std::fclose(file);
  return SecondsSince(start);
}

// Keyframes of 2000 SIFT features, as fast as they are taken; a pose after each.
void Log(benchmark::State& state) {
  constexpr int kCount = 400;
  const std::vector<std::uint8_t> keyframe(290'000, 7), pose(600, 8);
  WorkerOptions options;
  Rig& rig = options.rig;
  rig.camera.width = rig.camera.height = 64;
  double best = 1e9;
  std::int64_t dropped = 0, lost = 0;
  for (auto _ : state) {
    const TemporaryFolder folder;
    auto writer = MissionWriter::Create(folder.path(), rig);
    if (!writer) {
      state.SkipWithError("no mission");
      return;
    }
    Shared shared(rig);
    const auto start = std::chrono::steady_clock::now();
    std::thread log([&] { RunLog(options, &*writer, &shared); });
    for (int i = 0; i < kCount; ++i) {
      while (!shared.log.Push("RSFM_KEYFRAME", i, {}, keyframe)) std::this_thread::yield();
      while (!shared.log.Push("RSFM_POSE", i, {}, pose)) std::this_thread::yield();
    }
    shared.log.Close();
    log.join();
    best = std::min(best, SecondsSince(start));
    lost += shared.log_errors;
    dropped += shared.log_is_whole ? 0 : 1;
  }
  if (lost + dropped > 0) state.SkipWithError("events were lost");
  const double megabytes = 1e-6 * kCount * static_cast<double>(keyframe.size() + pose.size());
  const double plain = PlainSeconds(keyframe, kCount);
  state.counters["MB_per_second"] = megabytes / best;
  state.counters["MB_per_second_plain"] = megabytes / plain;
  state.counters["ratio"] = plain / best;
}

// From the mapper's last word on an image to the pose on the bus: 300 images at 30 Hz, each with
// its pose, every fifth with a keyframe of 2000 SIFT features before it, all of it written to a log
// at the same time. The times are the clock's: on a busy machine they are the scheduler's too.
void Bus(benchmark::State& state) {
  constexpr int kCount = 300;
  const std::vector<std::uint8_t> keyframe(290'000, 7), pose(600, 8);
  WorkerOptions options;
  options.rig.camera.width = options.rig.camera.height = 64;
  const std::string& pose_channel = options.rig.bus.pose_channel;
  LatencyWindow::Percentiles percentiles;
  double bus_seconds = 0.0, log_seconds = 0.0;
  for (auto _ : state) {
    const TemporaryFolder folder;
    auto writer = MissionWriter::Create(folder.path(), options.rig);
    auto bus = LcmBus::Create({.url = "udpm://239.255.76.67:7667?ttl=0"});
    if (!writer || !bus) {
      state.SkipWithError("no mission or no multicast");
      return;
    }
    Shared shared(options.rig);
    std::thread log([&] {
      RunLog(options, &*writer, &shared);
      log_seconds = ThreadCpuSeconds();
    });
    std::thread publish([&] {
      RunBus(options, bus->get(), &shared);
      bus_seconds = ThreadCpuSeconds();
    });
    for (int i = 0; i < kCount; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(33));
      const std::int64_t now_us = MonotonicUs();
      for (auto* queue : {&shared.bus, &shared.log}) {
        if (i % 5 == 0) queue->Push("RSFM_KEYFRAME", i, {}, keyframe);
        queue->Push(pose_channel, i, {now_us, now_us}, pose);
      }
    }
    shared.bus.Close();
    shared.log.Close();
    publish.join();
    log.join();
    percentiles = shared.bus_latency.Compute(MonotonicUs());
  }
  state.counters["p50_ms"] = percentiles.p50_ms;
  state.counters["p99_ms"] = percentiles.p99_ms;
  state.counters["bus_cpu_ms_per_image"] = 1e3 * bus_seconds / kCount;
  state.counters["log_cpu_ms_per_image"] = 1e3 * log_seconds / kCount;
}

// The camera's thread at 30 Hz, 1280 x 960, GREY, every image to the mapper's queue and to the
// recorder's: its processor time as a share of one core.
void CaptureThread(benchmark::State& state) {
  constexpr int kCount = 150, kWidth = 1280, kHeight = 960;
  double seconds = 0.0;
  std::int64_t lost = 0;
  for (auto _ : state) {
    PacedVideo video;
    video.fake.formats = {{V4L2_PIX_FMT_GREY, kWidth, kHeight, 1, 30.0}};
    video.fake.fill = [](std::uint32_t, std::uint8_t*, std::size_t*) {};
    WorkerOptions options;
    options.rig.camera.width = kWidth;
    options.rig.camera.height = kHeight;
    options.rig.capture.frame_rate_hz = 30.0;
    CameraSource source(&video, options.rig.capture, kWidth, kHeight);
    Shared shared(options.rig);
    shared.has_recorder = true;
    std::thread capture([&] {
      RunCapture(options, &source, &shared);
      seconds = ThreadCpuSeconds();
    });
    Frame* frame = nullptr;
    for (int i = 0; i < kCount;) {
      if (shared.record.Pop(100, &frame)) FramePool::Release(frame);
      if (!shared.frames.Pop(100, &frame)) continue;
      FramePool::Release(frame);
      ++i;
    }
    shared.stop = true;
    capture.join();
    lost = shared.frames_skipped + shared.images_not_queued;
  }
  state.counters["percent_of_a_core"] = 100.0 * seconds * 30.0 / kCount;
  state.counters["lost"] = static_cast<double>(lost);
}

BENCHMARK(CaptureThread)
    ->Name("Capture/thread_at_30_hz")
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);
BENCHMARK(Bus)->Name("Bus/mapped_to_published")->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(Log)->Name("Log/queue_to_disk")->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace rsfm
