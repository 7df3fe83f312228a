// COLMAP's cameras.txt and cameras.bin, and both with the port of colmap_underwater behind the lens
// parameters: in text its name (FLATPORT, DOMEPORT) and eight parameters, in binary an int32 (0
// FLATPORT, 1 DOMEPORT, -1 none) and eight doubles. Binary files with and without ports are told
// apart by which of the two readings fits the whole file.
//
// Errors name camera, field and line or byte.
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
std::string FormatColmapCamerasBinary(const std::vector<ModelCamera>& cameras, bool with_port);

}  // namespace rsfm
