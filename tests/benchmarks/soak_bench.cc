// The mapper over a mission without end.
//
//   soak_bench [FRAMES]    a line each tenth: resident memory, latency of a step (default 200,000);
//                          fails where the heap is called, or memory grows by more than 1 % from
//                          the second tenth on. Latency is the reader's to judge: machines are
//                          shared.
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
  std::vector<double> resident_mib, p99_ms;  // of the tenths
  for (int frame = 0; frame < frames; ++frame) {
    tracked += flight.Fly(frame).state == rsfm::MapperState::kTracking;
    steps_ms.push_back(flight.step_ms());
    if ((frame + 1) % (frames / 10) != 0) continue;
    std::sort(steps_ms.begin(), steps_ms.end());
    const std::size_t n = steps_ms.size();
    resident_mib.push_back(static_cast<double>(rsfm::ResidentBytes()) / (1 << 20));
    p99_ms.push_back(steps_ms[n * 99 / 100]);
    std::printf(
        "%7d frames  %.1f %% tracked  resident %.2f MiB  heap calls %zu  step p50 %.2f ms  "
        "p99 %.2f ms  longest %.2f ms  loops %d\n",
        frame + 1, 100.0 * tracked / (frame + 1), resident_mib.back(), flight.heap_calls(),
        steps_ms[n / 2], p99_ms.back(), steps_ms.back(), flight.mapper().loops().num_closed());
    std::fflush(stdout);
    steps_ms.clear();
  }
  const double growth = resident_mib.back() / resident_mib[1] - 1.0;
  std::printf("resident %+.2f %% since the second tenth, p99 %+.1f %% since the first\n",
              100.0 * growth, 100.0 * (p99_ms.back() / p99_ms.front() - 1.0));
  return flight.heap_calls() == 0 && growth <= 0.01 ? 0 : 1;
}
