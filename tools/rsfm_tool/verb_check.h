// What is wrong with a rig file; what the camera in it is like; what the on-board mapper will take.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace rsfm {

struct CheckOptions {
  std::string rig;
};

CLI::App* DeclareCheck(CLI::App& app, CheckOptions* options);
int RunCheck(const CheckOptions& options);

}  // namespace rsfm
