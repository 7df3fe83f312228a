// COLMAP's cameras.txt and cameras.bin, and cameras.txt with colmap_underwater's columns: behind
// the lens parameters the port's name (FLATPORT, DOMEPORT) and its eight parameters.
#pragma once

#include <string>
#include <vector>

#include "rsfm/io/diagnostic.h"
#include "rsfm/io/model.h"

namespace rsfm {

IoExpected<std::vector<ModelCamera>> ParseColmapCamerasText(const std::string& text,
                                                            const std::string& name);
IoExpected<std::vector<ModelCamera>> ParseColmapCamerasBinary(const std::string& bytes,
                                                              const std::string& name);
std::string FormatColmapCamerasText(const std::vector<ModelCamera>& cameras, bool with_port);
std::string FormatColmapCamerasBinary(const std::vector<ModelCamera>& cameras);

}  // namespace rsfm
