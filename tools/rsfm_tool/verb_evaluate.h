// A reconstruction, or a mission's on-board trajectory, against its ground truth.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace rsfm {

struct EvaluateOptions {
  std::string model;
  std::string ground_truth;
  std::string align = "sim3";
  std::string nav;
  bool json = false;
};

CLI::App* DeclareEvaluate(CLI::App& app, EvaluateOptions* options);
int RunEvaluate(const EvaluateOptions& options);

}  // namespace rsfm
