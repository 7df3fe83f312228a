// rsfm_tool report MODEL|MISSION --out FOLDER
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace rsfm {

struct ReportOptions {
  std::string input;
  std::string mission;
  std::string ground_truth;
  std::string align;  // empty: as fits
  std::string out;
};

CLI::App* DeclareReport(CLI::App& app, ReportOptions* options);
int RunReport(const ReportOptions& options);

}  // namespace rsfm
