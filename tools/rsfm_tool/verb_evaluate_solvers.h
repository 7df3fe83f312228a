// The paper's numerical evaluation of the pose solvers, as tables and figures.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

namespace rsfm {

struct EvaluateSolversOptions {
  std::vector<std::string> figures = {"abs_pose", "rel_pose"};
  std::vector<std::string> ports = {"flat", "dome", "dome_centered"};
  std::vector<double> noise_px = {0.0, 0.2, 0.5, 0.8, 1.2, 1.5, 1.8, 2.0};
  int experiments = 1000;
  std::uint64_t seed = 1;
  int threads = 0;  // 0: all cores
  std::string out;
};

CLI::App* DeclareEvaluateSolvers(CLI::App& app, EvaluateSolversOptions* options);
int RunEvaluateSolvers(const EvaluateSolversOptions& options);

}  // namespace rsfm
