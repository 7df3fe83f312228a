// Pixels (lines `u v`) to rays in water (lines `ox oy oz dx dy dz`: origin on the port's outer
// surface, unit direction; or six `nan` and a reason).
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace rsfm {

struct BackprojectOptions {
  std::string camera;
};

CLI::App* DeclareBackproject(CLI::App& app, BackprojectOptions* options);
int RunBackproject(const BackprojectOptions& options);

}  // namespace rsfm
