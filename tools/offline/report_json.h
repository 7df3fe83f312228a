// What every report.json says of cameras and of refined parameters.
#pragma once

#include <nlohmann/json.hpp>

#include <string>
#include <vector>

#include "rsfm/refraction/camera_config.h"
#include "tools/offline/image_navigation.h"
#include "tools/offline/observability.h"

namespace rsfm {

// Lens model, its parameters, port type and, where there is a port, its parameters.
nlohmann::ordered_json CameraJson(const CameraConfig& camera);

// Noise, scale and bend with their standard deviations; each refined parameter with its values,
// standard deviations and verdict; what the residuals say of parameters that were held.
nlohmann::ordered_json ObservabilityJson(const ObservabilityReport& report);

// How far the map lies from navigation.
nlohmann::ordered_json ResidualsJson(const NavigationResiduals& residuals);

nlohmann::ordered_json EstimatesJson(const std::vector<ParameterEstimate>& estimates);

// One parameter in a line, for people.
std::string Describe(const ParameterEstimate& estimate);

// What of the observability the user should know before trusting the result, one sentence each.
std::vector<std::string> ObservabilityWarnings(const ObservabilityReport& report);

}  // namespace rsfm
