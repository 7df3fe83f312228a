// What is in a mission, a model or an event log.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace rsfm {

struct InfoOptions {
  std::string path;
};

CLI::App* DeclareInfo(CLI::App& app, InfoOptions* options);
int RunInfo(const InfoOptions& options);

}  // namespace rsfm
