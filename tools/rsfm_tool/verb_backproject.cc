#include "tools/rsfm_tool/verb_backproject.h"

#include <array>
#include <cmath>

#include "tools/common/exit.h"
#include "tools/rsfm_tool/point_lines.h"

namespace rsfm {

CLI::App* DeclareBackproject(CLI::App& app, BackprojectOptions* options) {
  CLI::App* verb = app.add_subcommand(
      "backproject",
      "Back-project pixels: lines 'u v' in, lines 'ox oy oz dx dy dz' out (metres, camera frame)");
  verb->add_option("--camera", options->camera, "camera file or rig.yaml")->required();
  return verb;
}

int RunBackproject(const BackprojectOptions& options) {
  std::optional<AnyCamera> camera;
  if (const int code = LoadCamera(options.camera, &camera); code != kExitDone) return code;
  return ConvertLines(
      2, "write two numbers, u v in pixels",
      [&](std::span<const double> values, std::string* text) {
        const Vec2 pixel(values[0], values[1]);
        Ray3 ray;
        Projection status = Projection::kOutsideImage;
        if (!pixel.allFinite()) {
          status = Projection::kNotFinite;
        } else if (camera->IsInImage(pixel)) {
          status = camera->Backproject(pixel, &ray);
        }
        if (status != Projection::kOk) return AppendFailure(6, status, text);
        const Vec3 &o = ray.origin, &d = ray.direction;
        AppendNumbers(std::array<double, 6>{o.x(), o.y(), o.z(), d.x(), d.y(), d.z()}, text);
      });
}

}  // namespace rsfm
