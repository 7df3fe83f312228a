#include "tools/rsfm_tool/verb_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>
#include <vector>

#include "rsfm/io/rig.h"
#include "rsfm/mapping/incremental_mapper.h"
#include "rsfm/refraction/any_camera.h"
#include "rsfm/refraction/best_fit.h"
#include "tools/common/exit.h"

namespace rsfm {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;

// The angle between the rays of two pixels, in water; NaN where one of them has none.
double AngleInWater(const AnyCamera& camera, const Vec2& a, const Vec2& b) {
  Ray3 ray_a, ray_b;
  if (camera.Backproject(a, &ray_a) != Projection::kOk ||
      camera.Backproject(b, &ray_b) != Projection::kOk) {
    return std::nan("");
  }
  return std::acos(std::clamp(ray_a.direction.dot(ray_b.direction), -1.0, 1.0)) * kDegrees;
}

void PrintCamera(const AnyCamera& camera) {
  const CameraConfig& config = camera.config();
  std::printf("camera        %s, %d x %d px, focal length %.1f px\n",
              std::string(ToString(config.lens)).c_str(), config.width, config.height,
              camera.MeanFocalLength());
  const double w = config.width, h = config.height;
  const auto print = [](const char* name, double angle) {
    std::isfinite(angle) ? std::printf(" %s %.1f", name, angle)
                         : std::printf(" %s none (no ray there)", name);
  };
  std::printf("field of view in water, degrees:");
  print("horizontal", AngleInWater(camera, {0.0, h / 2}, {w, h / 2}));
  print("vertical", AngleInWater(camera, {w / 2, 0.0}, {w / 2, h}));
  print("diagonal", AngleInWater(camera, {0.0, 0.0}, {w, h}));
  std::printf("\n");
}

void PrintPort(const PortConfig& port) {
  if (port.type == PortType::kNone) {
    std::printf("port          none: the lens is taken as it is\n");
    return;
  }
  if (port.type == PortType::kFlat) {
    std::printf("port          flat, %.2f mm away, tilted by %.3f degrees", 1e3 * port.distance_m,
                std::acos(std::clamp(port.normal.z() / port.normal.norm(), -1.0, 1.0)) * kDegrees);
  } else {
    std::printf("port          dome, inner radius %.2f mm, camera off its centre by %.3f mm",
                1e3 * port.radius_m, 1e3 * port.center_m.norm());
  }
  std::printf(", %.2f mm thick; indices of air %.6g, glass %.6g, water %.6g\n",
              1e3 * port.thickness_m, port.index_air, port.index_glass, port.index_water);
}

// How far the camera is from the pinhole that comes nearest to it.
void PrintBestFit(const AnyCamera& camera) {
  const auto fit = FitPerspective(camera);
  if (!fit) {
    std::printf("best pinhole  none: too few pixels have a ray that looks forward\n");
    return;
  }
  std::printf(
      "best pinhole  fx %.2f fy %.2f cx %.2f cy %.2f px at 5 m; error there: %.3f px rms, "
      "%.3f px at most\n",
      fit->fx, fit->fy, fit->cx, fit->cy, fit->rms_error_px, fit->max_error_px);
  std::printf("              the same pinhole, treated as exact at other ranges:\n");
  for (const double range : {1.0, 2.0, 8.0}) {
    double sum = 0.0, worst = 0.0;
    int count = 0;
    for (int row = 0; row <= 20; ++row) {
      for (int column = 0; column <= 30; ++column) {
        const Vec2 pixel(camera.width() * column / 30.0, camera.height() * row / 20.0);
        Ray3 ray;
        if (camera.Backproject(pixel, &ray) != Projection::kOk) continue;
        const Vec3 point = ray.At(range);
        if (point.z() <= 0.0) continue;
        const double error = (fit->Project(point) - pixel).norm();
        sum += error;
        worst = std::max(worst, error);
        ++count;
      }
    }
    if (count > 0) {
      std::printf("              %4.1f m  %.3f px mean, %.3f px at most\n", range, sum / count,
                  worst);
    }
  }
}

// What the on-board mapper takes from the heap when it is made; it takes nothing later, OpenCV's
// buffers excepted.
int PrintMemory(const Rig& rig, const AnyCamera& camera, const std::string& file) {
  const auto mapper = IncrementalMapper::Create(rig.mapper, camera, rig.body_from_camera);
  if (!mapper) {
    return Report({mapper.error().code, file, std::string("mapper.") + mapper.error().where,
                   "is not possible", "correct it in the rig file"});
  }
  constexpr double kMebi = 1024.0 * 1024.0;
  const MemoryPlan plan = (*mapper)->memory_plan();
  std::printf("mapper memory %.1f MiB, taken at the start:\n",
              static_cast<double>(plan.total()) / kMebi);
  for (const MemoryPlan::Item& item : plan.items) {
    std::printf("              %8.2f MiB  %s\n", static_cast<double>(item.bytes) / kMebi,
                item.name);
  }
  return 0;
}

}  // namespace

CLI::App* DeclareCheck(CLI::App& app, CheckOptions* options) {
  CLI::App* verb = app.add_subcommand("check", "Check a rig or camera file and describe it");
  verb->add_option("rig", options->rig, "rig.yaml or a camera file")->required();
  return verb;
}

int RunCheck(const CheckOptions& options) {
  std::vector<Diagnostic> problems;
  const auto rig = ReadRig(options.rig, &problems);
  for (const Diagnostic& problem : problems) Report(problem);
  if (!rig) return ExitCode(rig.error());
  const auto camera = AnyCamera::Create(rig->camera);
  if (!camera) {
    return Report({camera.error().code, options.rig, camera.error().where, "is not possible",
                   "correct it in the camera file"});
  }
  std::printf("%s is a good rig file\n", options.rig.c_str());
  PrintCamera(*camera);
  PrintPort(rig->camera.port);
  PrintBestFit(*camera);
  if (const int code = PrintMemory(*rig, *camera, options.rig); code != 0) return code;
  return FinishStdout();
}

}  // namespace rsfm
