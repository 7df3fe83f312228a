#include "tools/rsfm_tool/verb_simulate.h"

#include <algorithm>
#include <cstdio>
#include <thread>

#include "tools/common/exit.h"
#include "tools/common/progress.h"
#include "tools/simulator/simulate.h"

namespace rsfm {

CLI::App* DeclareSimulate(CLI::App& app, SimulateOptions* options) {
  CLI::App* verb = app.add_subcommand(
      "simulate", "Render a mission: images through the real port, navigation, ground truth");
  verb->add_option("SCENARIO", options->scenario, "Scenario file (see tools/scenarios)")
      ->required();
  verb->add_option("--out", options->out, "Mission folder to write")->required();
  verb->add_option("--images", options->max_images,
                   "At most this many: a survey is made smaller, any other path is cut off")
      ->check(CLI::PositiveNumber);
  auto* mesh = verb->add_option("--mesh", options->mesh, "The scene: a PLY mesh of one's own");
  verb->add_option("--texture", options->texture, "The image on it")->needs(mesh);
  verb->add_option("--dem", options->dem, "The seafloor's heights: an Esri ASCII grid")
      ->excludes(mesh);
  verb->add_option("--threads", options->threads, "Threads to render with; default: all cores")
      ->check(CLI::Range(1, 1024));
  verb->add_option("--nav-seed", options->nav_seed,
                   "Seed of the navigation sensors' noise; default: the scenario's");
  verb->add_flag("--no-images", options->no_images,
                 "Navigation and ground truth alone, for images that are there already");
  return verb;
}

int RunSimulate(const SimulateOptions& options) {
  std::vector<Diagnostic> problems;
  auto scenario = simulator::ReadScenario(options.scenario, &problems);
  if (!scenario) {
    for (std::size_t i = 1; i < problems.size(); ++i) Report(problems[i]);
    return Report(scenario.error());
  }
  if (options.max_images > 0) {
    scenario->images.max_images = options.max_images;
    scenario->images.survey_images = options.max_images;
  }

  if (!options.mesh.empty()) {
    scenario->scene = simulator::SceneKind::kMesh;
    scenario->mesh.file = options.mesh;
    scenario->mesh.texture = options.texture;
  } else if (!options.dem.empty()) {
    scenario->scene = simulator::SceneKind::kSeafloor;
    scenario->dem = options.dem;
  }

  if (options.nav_seed > 0) scenario->navigation.seed = options.nav_seed;
  scenario->images.render = !options.no_images;

  simulator::SimulationHooks hooks;
  hooks.num_threads = options.threads > 0
                          ? options.threads
                          : static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  std::unique_ptr<Progress> progress;
  hooks.progress = [&](int done, int total) {
    if (!progress) progress = std::make_unique<Progress>("simulate", total);
    progress->Update(done);
  };
  hooks.is_interrupted = IsInterrupted;
  auto report = simulator::Simulate(*scenario, options.out, hooks);
  if (!report) {
    progress.reset();
    Diagnostic problem = report.error();
    if (problem.file.empty()) problem.file = options.scenario;
    return Report(problem);
  }
  if (report->interrupted) {
    progress.reset();
    return ReportInterrupted();
  }
  if (progress) progress->Finish();
  std::printf("%s: %d images over %.1f m, %d navigation samples", options.out.c_str(),
              report->num_images, report->path_length_m, report->num_nav_samples);
  options.no_images
      ? std::printf("; not rendered\n")
      : std::printf("; %.1f images/s\n", report->num_images / std::max(report->rendering_s, 1e-6));
  return FinishStdout();
}

}  // namespace rsfm
