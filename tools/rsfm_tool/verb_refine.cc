#include "tools/rsfm_tool/verb_refine.h"

#include <cstdio>

#include "tools/common/exit.h"
#include "tools/common/stage_progress.h"
#include "tools/offline/refine_mission.h"
#include "tools/offline/report_json.h"
#include "tools/rsfm_tool/camera_flags.h"

namespace rsfm {
namespace {

void PrintFindings(const RefineResult& result) {
  const RefineSceneReport& scene = result.scene;
  std::printf("images       %zu of %d placed\n", result.model.images.size(), result.num_images);
  std::printf("points       %zu, %d observations\n", result.model.points.size(),
              scene.errors.num_observations);
  if (scene.observations_before > 0)
    std::printf("error before %.4f px mean over %d observations\n", scene.mean_error_before_px,
                scene.observations_before);
  std::printf("error after  %.4f px mean, %.4f px RMS\n", scene.errors.mean_px,
              scene.errors.rms_px);
  const BundleGauge gauge = scene.rounds.empty() ? BundleGauge() : scene.rounds.back().bundle.gauge;
  if (gauge.scale) std::printf("scale        held: no sensor gives it\n");
  if (gauge.scale_from_refraction && result.observability)
    std::printf("scale        from refraction alone, +- %.2g %%\n",
                100.0 * result.observability->scale_sigma);
  if (result.water) {
    std::printf(
        "water        index %.6f for all images; %.6f to %.6f in the mission, %.6f in the rig\n",
        result.water->used, result.water->low, result.water->high, result.water->rig);
  }
  for (const ParameterEstimate& p : result.mount) std::printf("%s\n", Describe(p).c_str());
  if (!result.observability) return;
  for (const std::string& warning : ObservabilityWarnings(*result.observability))
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  std::printf("noise        %.3f px per coordinate\n", result.observability->noise_px);
  if (const auto& bend = result.observability->bend)
    std::printf("bend         %+.4f +- %.4f m over a radius of %.2f m\n", bend->sagitta_m,
                bend->sigma_m, bend->radius_m);
  for (const ParameterEstimate& p : result.observability->parameters)
    std::printf("%s\n", Describe(p).c_str());
}

LossType LossOf(const std::string& name) {
  if (name == "huber") return LossType::kHuber;
  return name == "none" ? LossType::kNone : LossType::kCauchy;
}

}  // namespace

CLI::App* DeclareRefine(CLI::App& app, RefineOptions* options) {
  CLI::App* verb = app.add_subcommand(
      "refine", "Global bundle adjustment of a mission or model: the best poses and points");
  verb->add_option("input", options->input, "mission or model folder")->required();
  verb->add_option("--out", options->out, "model folder to write")->required();
  verb->add_option("--nav", options->nav, "NAV.csv, in place of the mission's own navigation");
  verb->add_flag("--guided", options->guided, kGuidedHelp);
  AddCameraFlags(verb, &options->refine_port, &options->refine_lens, &options->uwpinhole);
  AddMountFlags(verb, &options->mount);
  verb->add_option("--loss", options->loss, "robust loss of image errors: cauchy, huber or none")
      ->check(CLI::IsMember({"cauchy", "huber", "none"}))
      ->capture_default_str();
  verb->add_option("--loss-px", options->loss_px,
                   "image error where the loss begins to bend at the latest [px]")
      ->check(CLI::Range(0.01, 100.0))
      ->capture_default_str();
  return verb;
}

int RunRefine(const RefineOptions& options) {
  RefineRequest request;
  request.input = options.input;
  request.out = options.out;
  if (!options.nav.empty()) request.nav = options.nav;
  request.refine_port = options.refine_port;
  request.refine_lens = options.refine_lens;
  request.uwpinhole = options.uwpinhole;
  request.mount = options.mount;
  if (options.guided) request.scene.guided.emplace();
  request.scene.bundle.loss = {LossOf(options.loss), options.loss_px};
  StageProgress progress;
  request.progress = [&progress](const std::string& stage, double part) {
    return progress.Update(stage, part);
  };
  const auto result = Refine(request);
  if (!result) return Report(result.error());
  if (result->scene.interrupted) return ReportInterrupted();
  if (const IoStatus status = WriteRefined(request, *result); !status)
    return Report(status.error());
  PrintFindings(*result);
  return FinishStdout();
}

}  // namespace rsfm
