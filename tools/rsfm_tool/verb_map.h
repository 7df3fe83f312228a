#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace rsfm {

struct MapOptions {
  std::string images;
  std::string rig;
  std::string out;
  std::string times;
  double fps = 0.0;
  std::string nav;
  std::string replay;
  std::string lcm_url = "memq://";
};

CLI::App* DeclareMap(CLI::App& app, MapOptions* options);
int RunMap(const MapOptions& options);

}  // namespace rsfm
