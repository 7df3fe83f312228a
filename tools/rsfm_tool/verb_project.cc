#include "tools/rsfm_tool/verb_project.h"

#include "tools/common/exit.h"
#include "tools/rsfm_tool/point_lines.h"

namespace rsfm {

CLI::App* DeclareProject(CLI::App& app, ProjectOptions* options) {
  CLI::App* verb = app.add_subcommand(
      "project", "Project points: lines 'x y z' (metres, camera frame) in, lines 'u v' out");
  verb->add_option("--camera", options->camera, "camera file or rig.yaml")->required();
  return verb;
}

int RunProject(const ProjectOptions& options) {
  std::optional<AnyCamera> camera;
  if (const int code = LoadCamera(options.camera, &camera); code != kExitDone) return code;
  return ConvertLines(3, "write three numbers, x y z in metres",
                      [&](std::span<const double> values, std::string* text) {
                        Vec2 pixel;
                        Projection status =
                            camera->Project(Vec3(values[0], values[1], values[2]), &pixel);
                        if (status == Projection::kOk && !camera->IsInImage(pixel)) {
                          status = Projection::kOutsideImage;
                        }
                        if (status != Projection::kOk) return AppendFailure(2, status, text);
                        AppendNumbers(std::span(pixel.data(), 2), text);
                      });
}

}  // namespace rsfm
