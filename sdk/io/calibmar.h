// The calibration file of calibmar, a calibration tool for underwater housings, for writing: rig.h
// reads it. [https://github.com/MDSKiel/calibmar, "Calibration Report": calibration.yaml]
#pragma once

#include <string>

#include "rsfm/io/diagnostic.h"
#include "rsfm/refraction/camera_config.h"

namespace rsfm {

// model, parameters, non_svp_model (FLATPORT, DOMEPORT, NONE), non_svp_parameters, width, height;
// numbers keep their full precision. kUnsupported for a port of several layers.
IoExpected<std::string> FormatCalibmar(const CameraConfig& camera);

}  // namespace rsfm
