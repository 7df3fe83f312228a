// What is wrong with a rig file; what the camera in it is like; whether refraction matters for it;
// what the on-board mapper will take.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace rsfm {

struct CheckOptions {
  std::string rig;
  std::string range;  // NEAR:FAR, m; empty: refraction is not judged
  std::string svg;    // file for the picture; empty: none
};

CLI::App* DeclareCheck(CLI::App& app, CheckOptions* options);
int RunCheck(const CheckOptions& options);

}  // namespace rsfm
