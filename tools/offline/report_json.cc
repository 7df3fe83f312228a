#include "tools/offline/report_json.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace rsfm {

nlohmann::ordered_json CameraJson(const CameraConfig& camera) {
  nlohmann::ordered_json json;
  json["model"] = ToString(camera.lens);
  json["params"] = std::vector<double>(camera.lens_params.begin(), camera.lens_params.end());
  json["port"] = {{"type", ToString(camera.port.type)}};
  if (camera.port.type != PortType::kNone) json["port"]["params"] = camera.port.Params();
  return json;
}

nlohmann::ordered_json EstimatesJson(const std::vector<ParameterEstimate>& estimates) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const ParameterEstimate& p : estimates) {
    json.push_back({{"name", p.name},
                    {"start", p.start},
                    {"value", p.value},
                    {"sigma", p.sigma},
                    {"prior_sigma", p.prior_sigma},
                    {"scale_correlation", p.scale_correlation},
                    {"verdict", p.verdict}});
  }
  return json;
}

nlohmann::ordered_json ObservabilityJson(const ObservabilityReport& report) {
  nlohmann::ordered_json json = {{"noise_px", report.noise_px},
                                 {"scale_sigma", report.scale_sigma}};
  if (report.bend) {
    json["bend"] = {{"sagitta_m", report.bend->sagitta_m},
                    {"sigma_m", report.bend->sigma_m},
                    {"radius_m", report.bend->radius_m},
                    {"along_line", report.bend->along_line}};
  }
  json["parameters"] = EstimatesJson(report.parameters);
  json["held_sigmas"] = report.held_sigmas;
  json["held"] = nlohmann::ordered_json::array();
  for (const ParameterDoubt& d : report.held) {
    json["held"].push_back(
        {{"name", d.name}, {"value", d.value}, {"step", d.step}, {"sigma", d.sigma}});
  }
  return json;
}

nlohmann::ordered_json ResidualsJson(const NavigationResiduals& r) {
  return {{"positions", r.num_positions},
          {"position_rms_m", r.position_rms_m},
          {"position_max_m", r.position_max_m},
          {"position_sigma_m", r.position_sigma_m},
          {"attitudes", r.num_attitudes},
          {"attitude_median_deg", r.attitude_median_deg},
          {"depths", r.num_depths},
          {"depth_rms_m", r.depth_rms_m}};
}

std::string Describe(const ParameterEstimate& e) {
  constexpr double kGoesWith = 0.9;
  char text[200], scale[80] = "";
  if (e.scale_correlation != 0.0) {
    std::snprintf(scale, sizeof scale, " (correlation with scale %+.2f%s)", e.scale_correlation,
                  std::abs(e.scale_correlation) > kGoesWith ? ": as good as that" : "");
  }
  std::snprintf(text, sizeof text, "%-20s %12.6g -> %12.6g +- %.2g, %s%s", e.name.c_str(), e.start,
                e.value, e.sigma, e.verdict.c_str(), scale);
  return text;
}

std::vector<std::string> ObservabilityWarnings(const ObservabilityReport& report) {
  constexpr double kSigmas = 3.0, kFocalRatio = 0.01, kNormalRad = 0.01, kCenterM = 0.001;
  constexpr double kBendRatio = 0.01;
  std::vector<std::string> warnings;
  char text[400];
  if (report.bend && report.bend->sigma_m > kBendRatio * report.bend->radius_m) {
    const BendEstimate& bend = *report.bend;
    std::snprintf(
        text, sizeof text,
        "nothing in the data says how straight the map is: it bends by %+.3f +- %.3f m over "
        "a radius of %.2f m; give navigation with depth (--nav), or calibrate lens and port",
        bend.sagitta_m, bend.sigma_m, bend.radius_m);
    warnings.push_back(text);
  }
  for (const ParameterDoubt& d : report.held) {
    const bool focal = d.kind == ParameterKind::kFocal, normal = d.kind == ParameterKind::kNormal;
    const double matters = focal ? kFocalRatio * d.value : normal ? kNormalRad : kCenterM;
    if (!(report.held_sigmas > kSigmas && std::abs(d.step) > std::max(matters, 2.0 * d.sigma)))
      continue;
    std::snprintf(
        text, sizeof text,
        "the images contradict the camera file: %s is %.6g there, and they ask for a step of "
        "%+.3g +- %.2g; the map may be bent. Check the file, or try %s",
        d.name.c_str(), d.value, d.step, d.sigma, focal ? "--refine-lens" : "--refine-port");
    warnings.push_back(text);
  }
  return warnings;
}

}  // namespace rsfm
