#include "tools/rsfm_tool/verb_evaluate_solvers.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <thread>

#include "rsfm/io/atomic_output.h"
#include "tools/common/exit.h"
#include "tools/common/progress.h"
#include "tools/evaluation/solver_evaluation.h"
#include "tools/report/solver_figures.h"

namespace rsfm {
namespace {

constexpr SolverPort kPorts[] = {SolverPort::kFlat, SolverPort::kDome, SolverPort::kCentredDome};
constexpr SolverFigure kFigures[] = {SolverFigure::kAbsolutePose, SolverFigure::kRelativePose};

template <class T, std::size_t kN>
T Named(const T (&values)[kN], const std::string& name) {
  return *std::find_if(std::begin(values), std::end(values),
                       [&](T value) { return ToString(value) == name; });
}

IoStatus Check(const EvaluateSolversOptions& options) {
  for (const double noise : options.noise_px) {
    if (std::isfinite(noise) && noise >= 0.0 && noise <= 100.0) continue;
    return Fail({Errc::kInvalidArgument, "", "--noise", std::to_string(noise) + " is no noise",
                 "give standard deviations in pixels, 0 to 100"});
  }
  return {};
}

IoStatus Write(const SolverEvaluation& evaluation, const std::filesystem::path& folder) {
  const std::string name =
      std::string(ToString(evaluation.figure)) + "_" + std::string(ToString(evaluation.port));
  if (auto status = WriteFileAtomically(folder / (name + ".csv"), ToCsv(evaluation.rows)); !status)
    return status;
  if (auto status = WriteFileAtomically(folder / (name + "_bound.csv"), ToCsv(evaluation.bounds));
      !status) {
    return status;
  }
  return WriteFileAtomically(folder / (name + ".svg"), SolverFigureSvg(evaluation));
}

void Print(const SolverEvaluation& evaluation) {
  const bool is_absolute = evaluation.figure == SolverFigure::kAbsolutePose;
  std::printf("%s %s\nnoise px  method             failures  rotation deg  %s  inliers  ms\n",
              std::string(ToString(evaluation.figure)).c_str(),
              std::string(ToString(evaluation.port)).c_str(),
              is_absolute ? "position mm" : "direction deg");
  for (std::size_t i = 0; i < evaluation.rows.size(); ++i) {
    const SolverRow& row = evaluation.rows[i];
    std::printf("%8.3g  %-17s  %8d  %12.4g  %11.4g  %7.4f  %.3g\n", row.noise_px,
                std::string(row.method).c_str(), row.failures, row.rotation_error_deg_mean,
                row.translation_error_mean, row.inlier_ratio_mean, row.time_ms_median);
    if (i + 1 < evaluation.rows.size() && evaluation.rows[i + 1].noise_px == row.noise_px) continue;
    const auto bound =
        std::find_if(evaluation.bounds.begin(), evaluation.bounds.end(),
                     [&](const SolverBound& b) { return b.noise_px == row.noise_px; });
    std::printf("%8.3g  %-17s  %8s  %12.4g  %11.4g  %7.4f\n", row.noise_px, "(bound, truth)", "",
                bound->rotation_error_deg, bound->translation_error, bound->inlier_ratio);
  }
}

}  // namespace

CLI::App* DeclareEvaluateSolvers(CLI::App& app, EvaluateSolversOptions* options) {
  CLI::App* verb = app.add_subcommand(
      "evaluate-solvers",
      "Absolute and relative pose solvers on random refractive rigs: CSV tables and SVG figures");
  verb->add_option("--figure", options->figures, "abs_pose, rel_pose; default: both")
      ->delimiter(',')
      ->check(CLI::IsMember({"abs_pose", "rel_pose"}));
  verb->add_option("--port", options->ports, "flat, dome, dome_centered; default: all")
      ->delimiter(',')
      ->check(CLI::IsMember({"flat", "dome", "dome_centered"}));
  verb->add_option("--noise", options->noise_px,
                   "standard deviations of a pixel's coordinates; default: "
                   "0,0.2,0.5,0.8,1.2,1.5,1.8,2")
      ->delimiter(',');
  verb->add_option("--experiments", options->experiments, "at each level; default: 1000")
      ->check(CLI::Range(1, 1000000));
  verb->add_option("--seed", options->seed, "of rigs, scenes and samples; default: 1");
  verb->add_option("--threads", options->threads, "0: all cores; the results do not depend on it")
      ->check(CLI::Range(0, 1024));
  verb->add_option("--out", options->out, "folder to write FIGURE_PORT.csv and .svg to")
      ->required();
  return verb;
}

int RunEvaluateSolvers(const EvaluateSolversOptions& options) {
  if (const IoStatus status = Check(options); !status) return Report(status.error());
  SolverRequest request;
  request.noise_px = options.noise_px;
  request.experiments = options.experiments;
  request.seed = options.seed;
  request.threads = options.threads > 0
                        ? options.threads
                        : static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  for (const std::string& figure : options.figures) {
    for (const std::string& port : options.ports) {
      request.figure = Named(kFigures, figure);
      request.port = Named(kPorts, port);
      Progress progress(figure + " " + port,
                        static_cast<std::int64_t>(request.noise_px.size()) * request.experiments);
      const auto evaluation = EvaluateSolvers(request, [&progress](std::int64_t done) {
        progress.Update(done);
        return !IsInterrupted();
      });
      if (!evaluation) return ReportInterrupted();
      progress.Finish();
      if (const IoStatus status = Write(*evaluation, options.out); !status)
        return Report(status.error());
      Print(*evaluation);
    }
  }
  return FinishStdout();
}

}  // namespace rsfm
