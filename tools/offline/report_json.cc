#include "tools/offline/report_json.h"

#include <vector>

namespace rsfm {

nlohmann::ordered_json CameraJson(const CameraConfig& camera) {
  nlohmann::ordered_json json;
  json["model"] = ToString(camera.lens);
  json["params"] = std::vector<double>(camera.lens_params.begin(), camera.lens_params.end());
  json["port"] = {{"type", ToString(camera.port.type)}};
  if (camera.port.type != PortType::kNone) json["port"]["params"] = camera.port.Params();
  return json;
}

nlohmann::ordered_json ParametersJson(const ObservabilityReport& report) {
  auto parameters = nlohmann::ordered_json::array();
  for (const ParameterEstimate& p : report.parameters) {
    parameters.push_back({{"name", p.name},
                          {"start", p.start},
                          {"value", p.value},
                          {"sigma", p.sigma},
                          {"prior_sigma", p.prior_sigma},
                          {"scale_correlation", p.scale_correlation},
                          {"verdict", p.verdict}});
  }
  return parameters;
}

}  // namespace rsfm
