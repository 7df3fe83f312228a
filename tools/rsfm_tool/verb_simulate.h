// rsfm_tool simulate SCENARIO.yaml --out MISSION
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>

namespace rsfm {

struct SimulateOptions {
  std::string scenario;
  std::string out;
  std::string mesh;
  std::string texture;
  std::string dem;
  int max_images = 0;          // 0: as the scenario says
  int threads = 0;             // 0: all cores
  std::uint64_t nav_seed = 0;  // 0: the scenario's seed
  bool no_images = false;
};

CLI::App* DeclareSimulate(CLI::App& app, SimulateOptions* options);
int RunSimulate(const SimulateOptions& options);

}  // namespace rsfm
