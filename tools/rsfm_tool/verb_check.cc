#include "tools/rsfm_tool/verb_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>
#include <vector>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/rig.h"
#include "rsfm/io/text.h"
#include "rsfm/refraction/any_camera.h"
#include "rsfm/refraction/best_fit.h"
#include "tools/check/heat_map.h"
#include "tools/check/transect.h"
#include "tools/common/exit.h"
#include "tools/feed/mapper_feed.h"
#include "tools/onboard/memory_plan.h"

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
  std::printf(", %.2f mm thick; indices of air %.6g, glass %.6g", 1e3 * port.thickness_m,
              port.index_air, port.index_glass);
  for (const PortLayer& layer : port.outer_layers)
    std::printf(", then %.2f mm of %.6g", 1e3 * layer.thickness_m, layer.index);
  std::printf(", water %.6g\n", port.index_water);
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

// "1:8"
bool ParseRange(const std::string& text, RangeBand* band) {
  const std::vector<std::string_view> parts = SplitAt(text, ':');
  if (parts.size() != 2) return false;
  const auto near = ParseNumber(parts[0]), far = ParseNumber(parts[1]);
  if (!near || !far || !(*near > 0.0) || !(*far >= *near) || !(*far <= 1e4)) return false;
  *band = {*near, *far};
  return true;
}

// The transect is flown in the middle of the band, by ratio.
double TransectAltitude(const RangeBand& band) { return std::sqrt(band.near_m * band.far_m); }

std::string Verdict(const AnyCamera& camera, const RefractionEffect& effect, double sagitta_m) {
  constexpr double kInvisiblePx = 0.1, kVisiblePx = 0.5;       // a feature is found to 0.2 to 1 px
  constexpr double kInvisibleBowl = 0.01, kVisibleBowl = 0.1;  // m in 50 m
  const double bowl = std::abs(sagitta_m);
  if (camera.config().port.type == PortType::kNone)
    return "no port, no refraction: the lens is all there is";
  if (effect.max_px < kInvisiblePx && bowl < kInvisibleBowl)
    return "refraction does not matter: a pinhole fitted in water does for this rig";
  if (effect.mean_px < kVisiblePx && bowl < kVisibleBowl)
    return "refraction matters little: model the port where long lines must stay straight";
  return "refraction matters: this rig is not a pinhole, model the port";
}

void PrintEffect(const RefractionEffect& effect) {
  std::printf(
      "as a pinhole  from %g to %g m, behind the lens's own distortion: fx %.2f fy %.2f cx %.2f "
      "cy %.2f px\n",
      effect.band.near_m, effect.band.far_m, effect.fit.fx, effect.fit.fy, effect.fit.cx,
      effect.fit.cy);
  std::printf("  error       %.3f px mean, %.3f px at most\n", effect.mean_px, effect.max_px);
  for (const RangeEffect& at : effect.ranges) {
    std::printf("    %6.2f m  %.3f px mean, %.3f px at most; lengths measured %+.3f %%\n",
                at.range_m, at.mean_px, at.max_px, 100.0 * at.length_bias);
  }
  std::printf(
      "not central   rays miss the point nearest to all of them, (%.2f, %.2f, %.2f) mm, by %.3f mm "
      "mean, %.3f mm at most\n",
      1e3 * effect.nearest_center_m.x(), 1e3 * effect.nearest_center_m.y(),
      1e3 * effect.nearest_center_m.z(), 1e3 * effect.mean_miss_m, 1e3 * effect.max_miss_m);
}

IoStatus WriteHeatMap(const AnyCamera& camera, const RefractionEffect& effect,
                      const CheckOptions& options, const std::string& verdict) {
  const Vec2 size = HeatMapSize(camera);
  SvgCanvas canvas(size.x(), size.y());
  DrawHeatMap(camera, effect, "Does refraction matter for " + options.rig + "?", verdict, &canvas);
  return WriteFileAtomically(options.svg, canvas.Finish());
}

// What it would cost to take the rig for a pinhole.
int PrintRefraction(const AnyCamera& camera, const RangeBand& band, const CheckOptions& options) {
  const auto pinhole = PinholeInWater::Fit(camera, band);
  if (!pinhole) {
    return Report({pinhole.error().code, options.rig, "camera",
                   "sees too little that looks forward to be compared with a pinhole",
                   "leave --range out: such a camera is none"});
  }
  const RefractionEffect effect = MeasureEffect(*pinhole, band);
  PrintEffect(effect);
  TransectOptions transect_options;
  transect_options.altitude_m = TransectAltitude(band);
  const auto transect = SimulateTransect(*pinhole, transect_options);
  if (!transect) {
    return Report({transect.error().code, options.rig, transect.error().where,
                   "is too little to simulate a transect with", "give another --range"});
  }
  std::printf(
      "a transect    of %g m at %.2f m above a flat seabed, reconstructed as a pinhole's: %s of "
      "%.3f m\n              (radius %.3g m; an image every %.2f m, %.3f px left in the images)\n",
      transect_options.length_m, transect_options.altitude_m,
      transect->sagitta_m >= 0.0 ? "a bowl" : "a hump", std::abs(transect->sagitta_m),
      1.0 / std::abs(transect->curvature_per_m), transect->spacing_m, transect->mean_error_px);
  const std::string verdict = Verdict(camera, effect, transect->sagitta_m);
  std::printf("verdict       %s\n", verdict.c_str());
  if (options.svg.empty()) return 0;
  const IoStatus written = WriteHeatMap(camera, effect, options, verdict);
  return written ? 0 : Report(written.error());
}

// What the on-board mapper takes from the heap when it is made; it takes nothing later, OpenCV's
// buffers excepted.
void PrintMemory(const Rig& rig, const MemoryPlan& plan) {
  constexpr double kMebi = 1024.0 * 1024.0;
  std::printf("mapper memory %.1f MiB, taken at the start:\n",
              static_cast<double>(plan.total()) / kMebi);
  for (const MemoryPlan::Item& item : plan.items) {
    std::printf("              %8.2f MiB  %s\n", static_cast<double>(item.bytes) / kMebi,
                item.name);
  }
  const DaemonMemory daemon = PlanDaemon(rig);
  std::printf(
      "daemon memory %.1f MiB more on board: images %.2f MiB, queues %.2f MiB; programs and "
      "libraries\n              take up to %d MiB on top\n",
      static_cast<double>(daemon.frame_bytes + daemon.queue_bytes) / kMebi,
      static_cast<double>(daemon.frame_bytes) / kMebi,
      static_cast<double>(daemon.queue_bytes) / kMebi, kLibrariesMiB);
}

}  // namespace

CLI::App* DeclareCheck(CLI::App& app, CheckOptions* options) {
  CLI::App* verb = app.add_subcommand("check", "Check a rig or camera file and describe it");
  verb->add_option("rig", options->rig, "rig.yaml or a camera file")->required();
  CLI::Option* range =
      verb->add_option("--range", options->range,
                       "NEAR:FAR in metres, the working distances: does refraction matter there?");
  verb->add_option("--svg", options->svg, "write the error over the image as a picture")
      ->needs(range);
  return verb;
}

int RunCheck(const CheckOptions& options) {
  RangeBand band;
  if (!options.range.empty() && !ParseRange(options.range, &band)) {
    return Report({Errc::kInvalidArgument, "", "--range", Quoted(options.range) + " is no band",
                   "give metres, near before far: --range 1:8"});
  }
  std::vector<Diagnostic> problems;
  const auto rig = ReadRig(options.rig, &problems);
  for (const Diagnostic& problem : problems) Report(problem);
  if (!rig) return ExitCode(rig.error());
  const auto feed = MapperFeed::Create(*rig, options.rig);
  if (!feed) return Report(feed.error());
  const AnyCamera& camera = feed->camera();
  std::printf("%s is a good rig file\n", options.rig.c_str());
  PrintCamera(camera);
  PrintPort(rig->camera.port);
  if (options.range.empty()) PrintBestFit(camera);
  if (!options.range.empty()) {
    if (const int code = PrintRefraction(camera, band, options); code != 0) return code;
  }
  PrintMemory(*rig, feed->memory_plan());
  return FinishStdout();
}

}  // namespace rsfm
