// report.json of a reconstruction, and its warnings.
#include <cmath>
#include <cstdio>

#include "tools/offline/report_json.h"
#include "tools/reconstruction/reconstruct.h"

namespace rsfm {
namespace {

using Json = nlohmann::ordered_json;

Json LeftOutJson(const std::vector<LeftOutImage>& images) {
  Json json = Json::array();
  for (const LeftOutImage& image : images)
    json.push_back({{"image", image.image}, {"reason", image.reason}});
  return json;
}

// Where the scale comes from, in words that say how far to trust it.
std::string ScaleSource(const ReconstructRequest& request, const ReconstructedModel& model) {
  if (model.alignment.scale) return "navigation";
  if (request.first_baseline_m > 0.0) return "length given for the first pair's baseline";
  if (model.report.start.baseline_from_navigation)
    return "first pair's baseline as navigation has it, held";
  if (!model.report.scale_held) return "refraction alone: see scale_sigma";
  return "unknown: length of the first pair's baseline, held";
}

Json NavigationJson(const ReconstructedModel& model) {
  Json json = {{"attitude", model.alignment.attitude},
               {"position", model.alignment.position},
               {"depth", model.alignment.depth},
               {"scale", model.alignment.scale}};
  if (model.residuals) json["residuals"] = ResidualsJson(*model.residuals);
  return json;
}

Json ModelJson(const ReconstructRequest& request, const ReconstructResult& result,
               const ReconstructedModel& model) {
  const auto& images = result.extraction.images;
  Json json = {
      {"images", model.report.num_images},
      {"points", model.report.num_points},
      {"observations", model.report.num_observations},
      {"contradicted_images", model.report.num_contradicted},
      {"unconfirmed_outliers", model.report.num_unconfirmed_outliers},
      {"mean_error_px", model.report.errors.mean_px},
      {"rms_error_px", model.report.errors.rms_px},
      {"first_pair",
       {images[model.report.start.images.a].name, images[model.report.start.images.b].name}},
      {"first_baseline_m", model.report.start.baseline_m},
      {"frame", model.alignment.attitude ? "NED" : "first image's camera"},
      {"scale", ScaleSource(request, model)},
      {"camera", CameraJson(model.camera)},
      {"navigation", NavigationJson(model)}};
  if (!model.mount.empty()) json["mount"] = EstimatesJson(model.mount);
  if (model.observability) json["observability"] = ObservabilityJson(*model.observability);
  return json;
}

}  // namespace

std::vector<std::string> ModelWarnings(const ReconstructResult& result) {
  std::vector<std::string> warnings;
  if (result.models.size() > 1) {
    std::string sizes;
    for (const ReconstructedModel& model : result.models)
      sizes += (sizes.empty() ? "" : ", ") + std::to_string(model.report.num_images);
    warnings.push_back("the images do not connect: " + std::to_string(result.models.size()) +
                       " models of " + sizes + " images, each in a frame of its own");
  }
  if (!result.not_placed.empty()) {
    const LeftOutImage& first = result.not_placed[0];
    warnings.push_back(std::to_string(result.not_placed.size()) +
                       " image(s) not placed: " + first.image + " " + first.reason +
                       (result.not_placed.size() > 1 ? "; ..." : ""));
  }
  for (const ReconstructedModel& model : result.models) {
    if (model.report.num_contradicted == 0) continue;
    warnings.push_back(
        std::to_string(model.report.num_contradicted) + " of " +
        std::to_string(model.report.num_images) +
        " images stand where matches with their neighbours contradict: patterns that repeat; "
        "the map is not to be trusted there. Give navigation (--nav), or leave the images out");
  }
  if (result.models[0].observability)
    for (std::string& warning : ObservabilityWarnings(*result.models[0].observability))
      warnings.push_back(std::move(warning));
  const double rms = result.models[0].report.errors.rms_px;
  if (rms > 1.5) {
    char text[200];
    std::snprintf(text, sizeof text,
                  "the reprojection error is %.2f px RMS: the camera file does not describe "
                  "these images well; try --refine-port or --refine-lens, or calibrate",
                  rms);
    warnings.push_back(text);
  }
  return warnings;
}

std::string FormatReconstructReport(const ReconstructRequest& request,
                                    const ReconstructResult& result) {
  Json json;
  json["images"] = {{"offered", result.num_offered},
                    {"used", result.extraction.images.size()},
                    {"left_out", LeftOutJson(result.extraction.left_out)},
                    {"not_placed", LeftOutJson(result.not_placed)}};
  json["warnings"] = result.warnings;
  json["pairs"] = {{"exhaustive", result.selection.exhaustive},
                   {"from_sequence", result.selection.num_from_sequence},
                   {"from_places", result.selection.num_from_places},
                   {"from_similarity", result.selection.num_from_similarity},
                   {"tried", result.matching.num_pairs},
                   {"matched", result.matching.num_matched},
                   {"matches", result.matching.num_matches},
                   {"verified", result.num_verified_pairs},
                   {"verified_matches", result.num_verified_matches},
                   {"guided_matches", result.num_guided_matches},
                   {"range_m", result.range_m}};
  json["camera_before"] = CameraJson(result.camera_before);
  json["models"] = Json::array();
  for (const ReconstructedModel& model : result.models)
    json["models"].push_back(ModelJson(request, result, model));
  json["seconds"] = {{"features", result.seconds_extraction},
                     {"features_from_cache", result.extraction.num_cached},
                     {"choosing_pairs", result.seconds_selection},
                     {"matching", result.seconds_matching},
                     {"pairs_from_cache", result.matching.num_cached},
                     {"verification", result.seconds_verification},
                     {"mapping", result.seconds_mapping},
                     {"mapping_placing", result.seconds_placing},
                     {"mapping_windows", result.seconds_windows},
                     {"mapping_global", result.seconds_global},
                     {"mapping_tracks", result.seconds_tracks},
                     {"global_adjustments", result.num_global_adjustments},
                     {"resumed", result.resumed}};
  return json.dump(2) + "\n";
}

}  // namespace rsfm
