// Points in the camera frame (lines `x y z`, metres) to pixels (lines `u v`, or `nan nan REASON`).
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace rsfm {

struct ProjectOptions {
  std::string camera;
};

CLI::App* DeclareProject(CLI::App& app, ProjectOptions* options);
int RunProject(const ProjectOptions& options);

}  // namespace rsfm
