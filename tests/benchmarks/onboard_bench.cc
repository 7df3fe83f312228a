// The daemon's own share: messages through the queue into a mission's log on the disk, against
// writing the same bytes in one go.
#include <benchmark/benchmark.h>

#include <chrono>
#include <cstdio>
#include <thread>
#include <vector>

#include "tests/support/temporary_folder.h"
#include "tools/onboard/workers.h"

namespace rsfm {
namespace {

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
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
  Rig rig;
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
    std::thread log([&] { RunLog(&*writer, &shared); });
    for (int i = 0; i < kCount; ++i) {
      while (!shared.log.Push("RSFM_KEYFRAME", i, 0, keyframe)) std::this_thread::yield();
      while (!shared.log.Push("RSFM_POSE", i, 0, pose)) std::this_thread::yield();
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

BENCHMARK(Log)->Name("Log/queue_to_disk")->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace rsfm
