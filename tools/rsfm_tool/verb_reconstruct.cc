#include "tools/rsfm_tool/verb_reconstruct.h"

#include <algorithm>
#include <cstdio>
#include <thread>

#include "tools/common/exit.h"
#include "tools/common/stage_progress.h"
#include "tools/offline/report_json.h"
#include "tools/reconstruction/reconstruct.h"
#include "tools/rsfm_tool/camera_flags.h"

namespace rsfm {
namespace {

ReconstructRequest ToRequest(const ReconstructOptions& options) {
  ReconstructRequest request;
  request.images = options.images;
  request.camera = options.camera;
  request.out = options.out;
  request.work = options.work;
  if (!options.nav.empty()) request.nav = options.nav;
  if (!options.times.empty()) request.times = options.times;
  request.refine_port = options.refine_port;
  request.refine_lens = options.refine_lens;
  request.uwpinhole = options.uwpinhole;
  request.mount = options.mount;
  request.guided = options.guided;
  request.nav_scale_only = options.nav_scale_only;
  request.first_baseline_m = options.first_baseline_m;
  request.seed = options.seed;
  request.num_threads = options.threads > 0
                            ? options.threads
                            : static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  FromString(options.features, &request.extraction.type);
  request.extraction.max_features = options.max_features;
  request.extraction.contrast_limit = options.contrast_limit;
  request.selection.exhaustive_up_to = options.exhaustive_up_to;
  return request;
}

void PrintModel(const ReconstructRequest& request, const ReconstructedModel& model) {
  std::printf("model        %d images, %d points, %d observations\n", model.report.num_images,
              model.report.num_points, model.report.num_observations);
  std::printf("  error      %.4f px mean, %.4f px RMS\n", model.report.errors.mean_px,
              model.report.errors.rms_px);
  if (model.alignment.scale) {
    std::printf("  scale      from navigation\n");
  } else if (model.report.start.baseline_from_navigation) {
    std::printf("  scale      from the first pair's baseline, %.4f m as %s, held\n",
                model.report.start.baseline_m,
                request.first_baseline_m > 0.0 ? "given" : "navigation has it");
  } else if (!model.report.scale_held && model.observability) {
    std::printf("  scale      from refraction alone, +- %.2g %%\n",
                100.0 * model.observability->scale_sigma);
  } else {
    std::printf("  scale      unknown: that of the first pair's baseline, held\n");
  }
  if (model.residuals && model.residuals->num_positions > 0)
    std::printf("  navigation positions differ by %.3f m RMS\n", model.residuals->position_rms_m);
  for (const ParameterEstimate& p : model.mount) std::printf("  %s\n", Describe(p).c_str());
  if (!model.observability) return;
  if (const auto& bend = model.observability->bend)
    std::printf("  bend       %+.4f +- %.4f m over a radius of %.2f m\n", bend->sagitta_m,
                bend->sigma_m, bend->radius_m);
  for (const ParameterEstimate& p : model.observability->parameters)
    std::printf("  %s\n", Describe(p).c_str());
}

void PrintFindings(const ReconstructRequest& request, const ReconstructResult& result) {
  for (const std::string& warning : result.warnings)
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  std::printf("images       %d offered, %zu used\n", result.num_offered,
              result.extraction.images.size());
  std::printf("pairs        %d tried, %d verified, %lld matches\n", result.matching.num_pairs,
              result.num_verified_pairs, static_cast<long long>(result.num_verified_matches));
  for (const ReconstructedModel& model : result.models) PrintModel(request, model);
  std::printf(
      "time         features %.1f s, matching %.1f s, verification %.1f s, mapping %.1f s\n",
      result.seconds_extraction, result.seconds_matching + result.seconds_selection,
      result.seconds_verification, result.seconds_mapping);
}

}  // namespace

CLI::App* DeclareReconstruct(CLI::App& app, ReconstructOptions* options) {
  CLI::App* verb = app.add_subcommand(
      "reconstruct", "Structure from motion: a folder of images, in any order, to a model");
  verb->add_option("images", options->images, "folder of images, or mission folder")->required();
  verb->add_option("--camera", options->camera, "rig or camera file: lens and port")->required();
  verb->add_option("--out", options->out, "model folder to write")->required();
  verb->add_option("--work", options->work,
                   "folder for features, matches and checkpoints; default: OUT.work");
  CLI::Option* nav = verb->add_option("--nav", options->nav, "NAV.csv: scale, frame and priors");
  verb->add_flag("--nav-scale-only", options->nav_scale_only,
                 "navigation gives the first pair's baseline and nothing else")
      ->needs(nav);
  verb->add_option("--times", options->times, "IMAGES.csv: image,utime");
  verb->add_flag("--guided", options->guided, kGuidedHelp);
  AddCameraFlags(verb, &options->refine_port, &options->refine_lens, &options->uwpinhole);
  for (CLI::Option* flag : AddMountFlags(verb, &options->mount)) flag->needs(nav);
  verb->add_option("--first-baseline", options->first_baseline_m,
                   "length of the first pair's baseline [m], where it is known")
      ->check(CLI::PositiveNumber);
  verb->add_option("--features", options->features, "sift, orb or akaze")
      ->check(CLI::IsMember({"sift", "orb", "akaze"}))
      ->capture_default_str();
  verb->add_option("--max-features", options->max_features, "kept of an image")
      ->check(CLI::Range(50, 60000))
      ->capture_default_str();
  verb->add_option("--contrast", options->contrast_limit,
                   "limit of local contrast equalisation for murky water; 0: none")
      ->check(CLI::Range(0.0, 100.0));
  verb->add_option("--exhaustive", options->exhaustive_up_to,
                   "match every pair of up to this many images")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
  verb->add_option("--threads", options->threads, "default: all cores")->check(CLI::Range(1, 1024));
  verb->add_option("--seed", options->seed, "of all random choices")->capture_default_str();
  return verb;
}

int RunReconstruct(const ReconstructOptions& options) {
  ReconstructRequest request = ToRequest(options);
  StageProgress progress;
  request.progress = [&progress](const std::string& stage, double part) {
    return progress.Update(stage, part);
  };
  const auto result = Reconstruct(request);
  if (!result) return Report(result.error());
  if (result->interrupted) {
    std::fprintf(stderr, "stopped; the same command continues from %s\n",
                 WorkFolder(request).c_str());
    return ReportInterrupted();
  }
  if (const IoStatus status = WriteReconstruction(request, *result); !status)
    return Report(status.error());
  PrintFindings(request, *result);
  return FinishStdout();
}

}  // namespace rsfm
