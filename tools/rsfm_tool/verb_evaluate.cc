#include "tools/rsfm_tool/verb_evaluate.h"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "rsfm/io/mission.h"
#include "rsfm/io/trajectory.h"
#include "tools/common/exit.h"
#include "tools/evaluation/evaluate.h"

namespace rsfm {
namespace {

nlohmann::json OrNull(const std::optional<double>& value) {
  return value ? nlohmann::json(*value) : nlohmann::json(nullptr);
}

void PrintJson(const Evaluation& result, const std::string& align) {
  const nlohmann::ordered_json json = {
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
  };
  std::printf("%s\n", json.dump(2).c_str());
}

void PrintLine(const char* name, const std::optional<double>& value, const char* unit) {
  value ? std::printf("%-22s %.6g %s\n", name, *value, unit) : std::printf("%-22s -\n", name);
}

void PrintText(const Evaluation& result, const std::string& align) {
  std::printf("%-22s %d compared, %d without ground truth\n", "images", result.num_images,
              result.num_unmatched);
  std::printf("%-22s %s, scale %.9g\n", "alignment", align.c_str(),
              result.truth_from_estimate.scale);
  PrintLine("rotation error", result.rotation_error_deg, "degrees (mean)");
  PrintLine("position error", result.position_error_mm, "mm (mean)");
  PrintLine("", result.position_rmse_mm, "mm (root mean square)");
  PrintLine("", result.position_max_mm, "mm (largest)");
  PrintLine("reprojection error", result.reprojection_error_px, "px (mean)");
  PrintLine("point error", result.point_error_mm, "mm (mean distance to the mesh)");
  PrintLine("", result.point_error_median_mm, "mm (median)");
}

IoExpected<Evaluation> EvaluatePaths(const EvaluateOptions& options, Alignment alignment) {
  const auto truth = ReadGroundTruth(options.ground_truth);
  if (!truth) return Fail(truth.error());
  if (!IsMissionFolder(options.model)) {
    const auto model = ReadModel(options.model);
    if (!model) return Fail(model.error());
    return Evaluate(*model, TrajectoryOf(*model), *truth, alignment);
  }
  const auto mission = ReadMission(options.model, {.keep_descriptors = false});
  if (!mission) return Fail(mission.error());
  const std::vector<TrajectoryPose> trajectory = TrajectoryOf(*mission);
  if (trajectory.empty()) {
    return Fail({Errc::kInvalidArgument, options.model, "", "holds no tracked pose",
                 "give a mission whose mapper has run, or a model"});
  }
  return Evaluate(ModelFromMission(*mission), trajectory, *truth, alignment);
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
  verb->add_option("--align", options->align, "sim3 (default), se3 or none")
      ->check(CLI::IsMember({"sim3", "se3", "none"}));
  verb->add_flag("--json", options->json, "print JSON");
  return verb;
}

int RunEvaluate(const EvaluateOptions& options) {
  const Alignment alignment = options.align == "sim3"  ? Alignment::kSim3
                              : options.align == "se3" ? Alignment::kSe3
                                                       : Alignment::kNone;
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
