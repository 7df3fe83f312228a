// The mapper over a mission without end.
//
//   soak_bench [FRAMES]    a line each tenth: resident memory, latency of a step (default 200,000)
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "rsfm/base/resident_memory.h"
#include "tests/mapping/soak_flight.h"

int main(int argc, char** argv) {
  const int frames = std::max(10, argc > 1 ? std::atoi(argv[1]) : 200000);
  rsfm::SoakFlight flight;
  std::vector<double> steps_ms;
  steps_ms.reserve(static_cast<std::size_t>(frames / 10 + 1));
  int tracked = 0;
  for (int frame = 0; frame < frames; ++frame) {
    tracked += flight.Fly(frame).state == rsfm::MapperState::kTracking;
    steps_ms.push_back(flight.step_ms());
    if ((frame + 1) % (frames / 10) != 0) continue;
    std::sort(steps_ms.begin(), steps_ms.end());
    const std::size_t n = steps_ms.size();
    std::printf(
        "%7d frames  %.1f %% tracked  resident %.2f MiB  heap calls %zu  step p50 %.2f ms  "
        "p99 %.2f ms  longest %.2f ms  loops %d\n",
        frame + 1, 100.0 * tracked / (frame + 1),
        static_cast<double>(rsfm::ResidentBytes()) / (1 << 20), flight.heap_calls(),
        steps_ms[n / 2], steps_ms[n * 99 / 100], steps_ms.back(),
        flight.mapper().loops().num_closed());
    std::fflush(stdout);
    steps_ms.clear();
  }
  return flight.heap_calls() == 0 ? 0 : 1;
}
