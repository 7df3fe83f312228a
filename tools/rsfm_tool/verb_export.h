// A model or a mission's on-board result in the formats of other programs.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace rsfm {

struct ExportOptions {
  std::string input;
  std::string format;
  std::string out;
};

CLI::App* DeclareExport(CLI::App& app, ExportOptions* options);
int RunExport(const ExportOptions& options);

}  // namespace rsfm
