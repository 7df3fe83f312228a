// Images, in any order, to the models that they give.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "tools/offline/navigation_fit.h"

namespace rsfm {

struct ReconstructOptions {
  std::string images;
  std::string camera;
  std::string out;
  std::string work;
  std::string nav;
  std::string times;
  bool refine_port = false;
  bool refine_lens = false;
  bool uwpinhole = false;
  MountOptions mount;
  bool guided = false;
  bool nav_scale_only = false;
  double first_baseline_m = 0.0;
  std::string features = "sift";
  int max_features = 3000;
  double contrast_limit = 0.0;
  int exhaustive_up_to = 150;
  int threads = 0;
  std::uint64_t seed = 1;
};

CLI::App* DeclareReconstruct(CLI::App& app, ReconstructOptions* options);
int RunReconstruct(const ReconstructOptions& options);

}  // namespace rsfm
