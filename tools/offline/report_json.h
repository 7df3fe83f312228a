// What every report.json says of cameras and of refined parameters.
#pragma once

#include <nlohmann/json.hpp>

#include "rsfm/refraction/camera_config.h"
#include "tools/offline/observability.h"

namespace rsfm {

// Lens model, its parameters, port type and, where there is a port, its parameters.
nlohmann::ordered_json CameraJson(const CameraConfig& camera);

// Each refined parameter with its values, standard deviations and verdict.
nlohmann::ordered_json ParametersJson(const ObservabilityReport& report);

}  // namespace rsfm
