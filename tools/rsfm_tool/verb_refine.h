// A mission, or a model, to the best model that its features and navigation give.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "tools/offline/navigation_fit.h"

namespace rsfm {

struct RefineOptions {
  std::string input;
  std::string out;
  std::string nav;
  bool refine_port = false;
  bool refine_lens = false;
  bool uwpinhole = false;
  MountOptions mount;
  bool guided = false;
  std::string loss = "cauchy";
  double loss_px = 1.0;
};

CLI::App* DeclareRefine(CLI::App& app, RefineOptions* options);
int RunRefine(const RefineOptions& options);

}  // namespace rsfm
