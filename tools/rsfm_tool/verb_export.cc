#include "tools/rsfm_tool/verb_export.h"

#include <cstdio>
#include <filesystem>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/calibmar.h"
#include "rsfm/io/mission.h"
#include "rsfm/io/model.h"
#include "rsfm/io/trajectory.h"
#include "tools/common/exit.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

struct Input {
  Model model;
  std::vector<TrajectoryPose> trajectory;
};

IoExpected<Input> ReadInput(const fs::path& path) {
  Input input;
  if (IsMissionFolder(path)) {
    const auto mission = ReadMission(path, {.keep_descriptors = false});
    if (!mission) return Fail(mission.error());
    input.model = ModelFromMission(*mission);
    input.trajectory = TrajectoryOf(*mission);
  } else {
    auto model = ReadModel(path);
    if (!model) return Fail(model.error());
    input.model = std::move(*model);
    input.trajectory = TrajectoryOf(input.model);
  }
  if (input.trajectory.empty() && input.model.images.empty()) {
    return Fail({Errc::kInvalidArgument, path.string(), "", "holds no pose to export",
                 "give a model, or a mission whose mapper has run"});
  }
  return input;
}

Diagnostic WithFile(Diagnostic problem, const std::string& file) {
  problem.file = file;
  return problem;
}

IoStatus Write(const Input& input, const ExportOptions& options) {
  const fs::path out = options.out;
  const std::string name = fs::path(options.input).lexically_normal().filename().string();
  const std::string& format = options.format;
  if (format == "colmap-txt") return WriteModel(input.model, out, ModelFormat::kColmapText);
  if (format == "colmap-bin") return WriteModel(input.model, out, ModelFormat::kColmapBinary);
  if (format == "colmap-underwater") {
    return WriteModel(input.model, out, ModelFormat::kColmapUnderwater);
  }
  if (format == "colmap-underwater-bin") {
    return WriteModel(input.model, out, ModelFormat::kColmapUnderwaterBinary);
  }
  if (format == "calibmar") {
    auto calibration = FormatCalibmar(input.model.rig.camera);
    if (!calibration) return Fail(WithFile(calibration.error(), options.input));
    return WriteFileAtomically(out, *calibration);
  }
  if (format == "ply") return WriteFileAtomically(out, FormatPly(input.model, input.trajectory));
  if (format == "tum") return WriteFileAtomically(out, FormatTum(input.trajectory));
  auto text = format == "kml" ? FormatKml(input.trajectory, input.model.rig.world, name)
                              : FormatGeoJson(input.trajectory, input.model.rig.world, name);
  if (!text) return Fail(WithFile(text.error(), options.input));
  return WriteFileAtomically(out, *text);
}

}  // namespace

CLI::App* DeclareExport(CLI::App& app, ExportOptions* options) {
  CLI::App* verb = app.add_subcommand(
      "export", "Write a model or a mission's on-board result for other programs");
  verb->add_option("input", options->input, "model or mission folder")->required();
  verb->add_option(
          "--format", options->format,
          "colmap-* write a folder, the others a file; calibmar is the camera alone; kml and "
          "geojson need a world on earth")
      ->required()
      ->check(CLI::IsMember({"colmap-txt", "colmap-bin", "colmap-underwater",
                             "colmap-underwater-bin", "calibmar", "ply", "tum", "kml", "geojson"}));
  verb->add_option("--out", options->out, "folder or file to write")->required();
  return verb;
}

int RunExport(const ExportOptions& options) {
  const auto input = ReadInput(options.input);
  if (!input) return Report(input.error());
  if (const IoStatus status = Write(*input, options); !status) return Report(status.error());
  std::printf("%s: %zu images, %zu points\n", options.out.c_str(),
              std::max(input->trajectory.size(), input->model.images.size()),
              input->model.points.size());
  return FinishStdout();
}

}  // namespace rsfm
