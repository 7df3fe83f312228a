#include "tools/rsfm_tool/verb_evaluate.h"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "rsfm/io/mission.h"
#include "rsfm/io/tables.h"
#include "rsfm/io/trajectory.h"
#include "rsfm/mapping/incremental_mapper.h"
#include "tools/common/exit.h"
#include "tools/evaluation/consistency.h"
#include "tools/evaluation/evaluate.h"
#include "tools/offline/image_navigation.h"
#include "tools/offline/report_json.h"

namespace rsfm {
namespace {

nlohmann::json OrNull(const std::optional<double>& value) {
  return value ? nlohmann::json(*value) : nlohmann::json(nullptr);
}

struct Findings {
  Evaluation truth;
  std::optional<NavigationResiduals> navigation;  // where there is some
  std::optional<Evaluation> reckoned;             // dead reckoning instead, over the same images
  std::optional<Consistency> consistency;         // of a mission's poses
};

std::string StateName(int state) {
  const bool is_known = state >= 0 && state <= pose_t::STATE_LOST;
  return is_known ? std::string(ToString(static_cast<MapperState>(state))) : std::to_string(state);
}

nlohmann::ordered_json ConsistencyJson(const Consistency& c) {
  nlohmann::ordered_json spells = nlohmann::ordered_json::array();
  const Utime start = c.spells.front().begin;
  for (const Consistency::Spell& spell : c.spells) {
    spells.push_back({{"state", StateName(spell.state)},
                      {"begin_s", SecondsFromUs(spell.begin - start)},
                      {"end_s", SecondsFromUs(spell.end - start)},
                      {"frames", spell.num_frames},
                      {"jumps", spell.num_jumps},
                      {"position_max_m", spell.position_error_max_m},
                      {"nees", spell.nees}});
  }
  return {{"poses", c.num_judged},
          {"nees", c.nees},
          {"nees_of_parts", c.nees_of_parts},
          {"within_95", c.within_95},
          {"states", spells}};
}

void PrintConsistency(const Consistency& c) {
  std::printf("%-22s NEES %.3g over %d poses (6 where it is right), %.1f %% within 95 %%\n",
              "covariance", c.nees, c.num_judged, 100.0 * c.within_95);
  std::printf("%-22s north and east %.3g (2), down %.3g (1), level %.3g (2), heading %.3g (1)\n",
              "", c.nees_of_parts[0], c.nees_of_parts[1], c.nees_of_parts[2], c.nees_of_parts[3]);
  for (const Consistency::Spell& spell : c.spells) {
    std::printf(
        "%-22s %.1f to %.1f s: %d frames, %d jumps announced, %.3g m off at most, NEES %.3g\n",
        StateName(spell.state).c_str(), SecondsFromUs(spell.begin - c.spells.front().begin),
        SecondsFromUs(spell.end - c.spells.front().begin), spell.num_frames, spell.num_jumps,
        spell.position_error_max_m, spell.nees);
  }
}

void PrintJson(const Findings& findings, const std::string& align) {
  const Evaluation& result = findings.truth;
  nlohmann::ordered_json json = {
      {"images", result.num_images},
      {"rotation_error_deg", OrNull(result.rotation_error_deg)},
      {"position_error_mm", result.position_error_mm},
      {"reprojection_error_px", OrNull(result.reprojection_error_px)},
      {"point_error_mm", OrNull(result.point_error_mm)},
      {"position_rmse_mm", result.position_rmse_mm},
      {"position_max_mm", result.position_max_mm},
      {"point_error_median_mm", OrNull(result.point_error_median_mm)},
      {"images_without_ground_truth", result.num_unmatched},
      {"align", align},
      {"scale", result.truth_from_estimate.scale},
      {"distance_m", result.distance_m},
  };
  json["bend"] = nullptr;
  if (result.bend) {
    json["bend"] = {{"sagitta_mm", 1e3 * result.bend->sagitta_m},
                    {"radius_m", result.bend->radius_m},
                    {"along_line", result.bend->along_line}};
  }
  json["navigation"] =
      findings.navigation ? ResidualsJson(*findings.navigation) : nlohmann::ordered_json(nullptr);
  json["dead_reckoning"] = nullptr;
  if (const auto& reckoned = findings.reckoned) {
    json["dead_reckoning"] = {{"rotation_error_deg", OrNull(reckoned->rotation_error_deg)},
                              {"position_rmse_mm", reckoned->position_rmse_mm},
                              {"position_max_mm", reckoned->position_max_mm}};
  }
  json["consistency"] = findings.consistency ? ConsistencyJson(*findings.consistency)
                                             : nlohmann::ordered_json(nullptr);
  std::printf("%s\n", json.dump(2).c_str());
}

void PrintLine(const char* name, const std::optional<double>& value, const char* unit) {
  value ? std::printf("%-22s %.6g %s\n", name, *value, unit) : std::printf("%-22s -\n", name);
}

void PrintText(const Findings& findings, const std::string& align) {
  const Evaluation& result = findings.truth;
  std::printf("%-22s %d compared, %d without ground truth\n", "images", result.num_images,
              result.num_unmatched);
  std::printf("%-22s %s, scale %.9g\n", "alignment", align.c_str(),
              result.truth_from_estimate.scale);
  PrintLine("rotation error", result.rotation_error_deg, "degrees (mean)");
  PrintLine("position error", result.position_error_mm, "mm (mean)");
  PrintLine("", result.position_rmse_mm, "mm (root mean square)");
  PrintLine("", result.position_max_mm, "mm (largest)");
  PrintLine("distance", result.distance_m, "m");
  if (const auto& reckoned = findings.reckoned)
    std::printf("%-22s %.6g mm (root mean square), %.6g mm (largest)\n", "dead reckoning alone",
                reckoned->position_rmse_mm, reckoned->position_max_mm);
  PrintLine("reprojection error", result.reprojection_error_px, "px (mean)");
  PrintLine("point error", result.point_error_mm, "mm (mean distance to the mesh)");
  PrintLine("", result.point_error_median_mm, "mm (median)");
  if (const auto& bend = result.bend)
    std::printf("%-22s %.6g mm over a radius of %.4g m\n", "bend", 1e3 * bend->sagitta_m,
                bend->radius_m);
  if (findings.consistency) PrintConsistency(*findings.consistency);
  if (!findings.navigation) return;
  const NavigationResiduals& nav = *findings.navigation;
  std::printf("%-22s %d positions: %.4g m RMS, %.4g m at most (%.4g m claimed)\n", "navigation",
              nav.num_positions, nav.position_rms_m, nav.position_max_m, nav.position_sigma_m);
  std::printf("%-22s %d attitudes: %.4g degrees in the median (%.4g claimed)\n", "",
              nav.num_attitudes, nav.attitude_median_deg, nav.attitude_sigma_deg);
  std::printf("%-22s %d depths: %.4g m RMS\n", "", nav.num_depths, nav.depth_rms_m);
}

// What navigation says of these images; nothing where there is none, or the model does not lie in
// its frame.
IoExpected<std::optional<NavigationInput>> NavigationOf(
    const EvaluateOptions& options, const Rig& rig, const std::vector<TrajectoryPose>& trajectory,
    std::vector<NavSample> samples) {
  if (!options.nav.empty()) {
    std::vector<ImageTime> images;
    for (const TrajectoryPose& pose : trajectory) images.push_back({pose.image, pose.utime});
    auto table = ReadNavTable(options.nav, images, rig.world.origin);
    if (!table) return Fail(table.error());
    samples = std::move(table->samples);
    if (rig.world.frame != WorldFrame::kNed) {
      return Fail({Errc::kInvalidArgument, options.nav, "--nav",
                   "cannot be compared: the model lies in the frame of its first camera",
                   "reconstruct or refine it with --nav"});
    }
  }
  if (samples.empty() || rig.world.frame != WorldFrame::kNed)
    return std::optional<NavigationInput>();
  return std::optional(NavigationInput{std::move(samples), rig.body_from_camera, rig.mapper});
}

IoStatus CompareWithNavigation(const std::filesystem::path& file, const NavigationInput& input,
                               const std::vector<TrajectoryPose>& trajectory,
                               const GroundTruth& truth, Alignment alignment, Findings* findings) {
  std::vector<Utime> utimes;
  std::vector<std::optional<Rigid3>> poses;
  for (const TrajectoryPose& pose : trajectory) {
    utimes.push_back(pose.utime);
    poses.emplace_back(pose.world_from_camera.Inverse());
  }
  const ImageNavigation at_images(input, utimes);
  if (at_images.num_covered() == 0) {
    return Fail({Errc::kInvalidArgument, file, "utime", at_images.why_not(),
                 "give the navigation of these images"});
  }
  findings->navigation = at_images.Compare(poses);
  findings->reckoned = EvaluateDeadReckoning(at_images, trajectory, truth, alignment);
  return {};
}

IoExpected<Findings> EvaluatePaths(const EvaluateOptions& options, Alignment alignment) {
  const auto truth = ReadGroundTruth(options.ground_truth);
  if (!truth) return Fail(truth.error());
  Model model;
  std::vector<TrajectoryPose> trajectory;
  std::vector<NavSample> samples;
  Findings findings;
  if (!IsMissionFolder(options.model)) {
    auto read = ReadModel(options.model);
    if (!read) return Fail(read.error());
    model = std::move(*read);
    trajectory = TrajectoryOf(model);
  } else {
    auto mission = ReadMission(options.model, {.keep_descriptors = false});
    if (!mission) return Fail(mission.error());
    trajectory = TrajectoryOf(*mission);
    if (trajectory.empty()) {
      return Fail({Errc::kInvalidArgument, options.model, "", "holds no tracked pose",
                   "give a mission whose mapper has run, or a model"});
    }
    model = ModelFromMission(*mission);
    samples = std::move(mission->nav);
    findings.consistency = EvaluateConsistency(*mission, *truth);
  }
  auto evaluation = Evaluate(model, trajectory, *truth, alignment);
  if (!evaluation) return Fail(evaluation.error());
  findings.truth = std::move(*evaluation);
  const auto input = NavigationOf(options, model.rig, trajectory, std::move(samples));
  if (!input) return Fail(input.error());
  if (!*input) return findings;
  const std::string& file = options.nav.empty() ? options.model : options.nav;
  if (auto status = CompareWithNavigation(file, **input, trajectory, *truth, alignment, &findings);
      !status) {
    return Fail(status.error());
  }
  return findings;
}

}  // namespace

CLI::App* DeclareEvaluate(CLI::App& app, EvaluateOptions* options) {
  CLI::App* verb = app.add_subcommand(
      "evaluate", "Compare a model, or a mission's on-board trajectory, with its ground truth");
  verb->add_option("model", options->model, "model or mission folder")->required();
  verb->add_option("ground_truth", options->ground_truth,
                   "model folder, mission or its ground_truth folder, TUM file, or CSV "
                   "(image,x_m,y_m,z_m)")
      ->required();
  verb->add_option("--align", options->align,
                   "sim3 (default), se3, yaw (position and heading) or none")
      ->check(CLI::IsMember({"sim3", "se3", "yaw", "none"}));
  verb->add_option("--nav", options->nav,
                   "NAV.csv to compare with; default: the mission's own navigation");
  verb->add_flag("--json", options->json, "print JSON");
  return verb;
}

int RunEvaluate(const EvaluateOptions& options) {
  const Alignment alignment = AlignmentNamed(options.align).value_or(Alignment::kSim3);
  const auto result = EvaluatePaths(options, alignment);
  if (!result) {
    Diagnostic problem = result.error();
    if (problem.file.empty()) problem.file = options.model;
    return Report(problem);
  }
  options.json ? PrintJson(*result, options.align) : PrintText(*result, options.align);
  return FinishStdout();
}

}  // namespace rsfm
