// A scenario to a mission folder: rig.yaml, events.lcm, nav.csv, images.csv, images/,
// ground_truth/.
#pragma once

#include <filesystem>
#include <functional>

#include "tools/simulator/scenario.h"

namespace rsfm::simulator {

struct SimulationHooks {
  int num_threads = 2;
  std::function<void(int done, int total)> progress;  // from any thread, one call at a time
  std::function<bool()> is_interrupted;               // from any thread
};

struct SimulationReport {
  int num_images = 0;
  int num_nav_samples = 0;
  double path_length_m = 0.0;
  double rendering_s = 0.0;  // wall time, images written included
  bool interrupted = false;  // then nothing was written
};

// Written aside and renamed; an earlier mission in its place is replaced, anything else is not. The
// files' bytes depend on the scenario alone, not on the number of threads.
IoExpected<SimulationReport> Simulate(const Scenario& scenario, const std::filesystem::path& out,
                                      const SimulationHooks& hooks);

}  // namespace rsfm::simulator
