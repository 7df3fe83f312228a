// report.json of a refinement.
#include <string_view>

#include "tools/offline/refine_mission.h"
#include "tools/offline/report_json.h"

namespace rsfm {
namespace {

using Json = nlohmann::ordered_json;

Json RoundJson(const RefineRound& round) {
  return {{"refines_camera", round.refines_camera},
          {"sigma_px", round.sigma_px},
          {"mean_error_px", round.mean_error_px},
          {"images", round.num_images},
          {"points", round.num_points},
          {"observations", round.num_observations},
          {"iterations", round.bundle.iterations},
          {"converged", round.bundle.converged},
          {"cost_before", round.bundle.initial_cost},
          {"cost_after", round.bundle.final_cost},
          {"seconds", round.bundle.seconds},
          {"linear_solver", round.bundle.solver},
          {"removed_observations", round.filter.observations},
          {"added_observations", round.tracks.completed + round.tracks.created_observations},
          {"merged_points", round.tracks.merged}};
}

// What decided each part of the world's place: "navigation"; "held": it stays where it was;
// "refraction": how far the bent rays say that it is.
Json GaugeJson(const RefineResult& result) {
  const BundleGauge gauge =
      result.scene.rounds.empty() ? BundleGauge() : result.scene.rounds.back().bundle.gauge;
  const auto word = [](bool held) { return held ? "held" : "navigation"; };
  Json json = {{"position", word(gauge.position)},
               {"attitude", word(gauge.attitude)},
               {"scale", gauge.scale_from_refraction ? "refraction" : word(gauge.scale)},
               {"scale_factor_from_navigation", result.alignment.scale_factor}};
  return json;
}

}  // namespace

std::string FormatRefineReport(const RefineRequest& request, const RefineResult& result) {
  const RefineSceneReport& scene = result.scene;
  Json json;
  json["input"] = request.input.string();
  json["mode"] = request.uwpinhole ? "uwpinhole" : "refractive";
  json["images"] = {{"offered", result.num_images},
                    {"placed_before", scene.placed_before},
                    {"placed", result.model.images.size()},
                    {"newly_placed", scene.newly_placed.size()}};
  json["points"] = result.model.points.size();
  json["from_scratch"] = scene.from_scratch;
  if (scene.placed_before < 2 || scene.observations_before == 0) {
    json["before"] = nullptr;
  } else {
    json["before"] = {{"mean_error_px", scene.mean_error_before_px},
                      {"observations", scene.observations_before}};
  }
  json["after"] = {{"mean_error_px", scene.errors.mean_px},
                   {"rms_error_px", scene.errors.rms_px},
                   {"observations", scene.errors.num_observations}};
  json["unconfirmed_outliers"] = scene.num_unconfirmed_outliers;
  json["matching"] = {{"pairs", scene.num_pairs},
                      {"verified_pairs", scene.num_verified_pairs},
                      {"matches", scene.num_matches},
                      {"guided_matches", scene.num_guided_matches}};
  json["seconds"] = {{"matching", scene.seconds_matching},
                     {"placing", scene.seconds_placing},
                     {"rounds", scene.seconds_rounds}};
  json["world"] = GaugeJson(result);
  if (result.water) {
    json["index_water"] = {{"rig", result.water->rig},
                           {"used", result.water->used},
                           {"lowest_in_mission", result.water->low},
                           {"highest_in_mission", result.water->high}};
  }
  json["camera_before"] = CameraJson(result.camera_before);
  json["camera_after"] = CameraJson(result.camera_after);
  json["observability"] = result.observability ? ObservabilityJson(*result.observability) : Json();
  if (!result.mount.empty()) json["mount"] = EstimatesJson(result.mount);
  json["warnings"] = result.observability ? ObservabilityWarnings(*result.observability)
                                          : std::vector<std::string>();
  json["rounds"] = Json::array();
  for (const RefineRound& round : scene.rounds) json["rounds"].push_back(RoundJson(round));
  return json.dump(2) + "\n";
}

}  // namespace rsfm
