// rsfm_tool camera list|info|grab: cameras at the bench.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace rsfm {

struct CameraOptions {
  std::string action;  // "list", "info", "grab"
  std::string device;  // empty: the rig's, else /dev/video0
  std::string rig;     // its camera's size and its capture section
  std::string size;    // "1280x960"; empty: the rig's
  std::string format;
  std::string out;
  int count = 10;
  double rate_hz = -1.0;
  double exposure_us = -1.0;
  double gain = -1.0;
};

CLI::App* DeclareCamera(CLI::App& app, CameraOptions* options);
int RunCamera(const CameraOptions& options);

}  // namespace rsfm
