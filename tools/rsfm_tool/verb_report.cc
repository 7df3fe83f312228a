#include "tools/rsfm_tool/verb_report.h"

#include <cstdio>

#include "tools/common/exit.h"
#include "tools/report/report.h"

namespace rsfm {

CLI::App* DeclareReport(CLI::App& app, ReportOptions* options) {
  CLI::App* verb =
      app.add_subcommand("report", "Figures (SVG, PNG) and an HTML page of a model or mission");
  verb->add_option("input", options->input, "model or mission folder")->required();
  verb->add_option("--out", options->out, "folder to write")->required();
  verb->add_option("--mission", options->mission,
                   "of a model: the mission it came from, for the on-board trajectory");
  verb->add_option("--ground-truth", options->ground_truth,
                   "model folder, mission, TUM file or CSV; default: the mission's own");
  verb->add_option("--align", options->align,
                   "to the ground truth: sim3, se3, yaw (position and heading) or none; default: "
                   "se3 where the scale is "
                   "metric, else sim3")
      ->check(CLI::IsMember({"sim3", "se3", "yaw", "none"}));
  return verb;
}

int RunReport(const ReportOptions& options) {
  ReportRequest request;
  request.input = options.input;
  request.mission = options.mission;
  request.ground_truth = options.ground_truth;
  request.alignment = AlignmentNamed(options.align);
  const auto data = WriteReport(request, options.out);
  if (!data) {
    Diagnostic problem = data.error();
    if (problem.file.empty()) problem.file = options.input;
    return Report(problem);
  }
  for (const ReportTrack& track : data->tracks) {
    if (!track.evaluation) continue;
    std::printf("%-10s %d images, mean position error %.4g mm\n", track.name.c_str(),
                track.evaluation->num_images, track.evaluation->position_error_mm);
  }
  std::printf("report: %s/index.html\n", options.out.c_str());
  return FinishStdout();
}

}  // namespace rsfm
