#include "tools/rsfm_tool/verb_map.h"

#include <algorithm>
#include <cstdio>
#include <memory>

#include "tools/common/exit.h"
#include "tools/common/progress.h"
#include "tools/map/map_images.h"
#include "tools/map/replay.h"

namespace rsfm {

CLI::App* DeclareMap(CLI::App& app, MapOptions* options) {
  CLI::App* verb =
      app.add_subcommand("map", "Map images (and navigation) with the on-board mapper");
  verb->add_option("IMAGES", options->images, "Folder of images, or a mission folder");
  verb->add_option("--rig", options->rig, "Rig file; default: the mission folder's rig.yaml");
  verb->add_option("--out", options->out, "Mission folder to write");
  auto* times = verb->add_option("--times", options->times, "Table image,utime of the images");
  verb->add_option(
          "--fps", options->fps,
          "Images a second, taken in the order of their names; default 1 where no table is")
      ->check(CLI::PositiveNumber)
      ->excludes(times);
  verb->add_option("--nav", options->nav, "Navigation table; default: a mission folder's nav.csv");
  verb->add_option("--lcm-url", options->lcm_url, "Bus to publish on")->capture_default_str();
  verb->add_option("--replay", options->replay,
                   "Map this mission's log again and compare with what it published; nothing is "
                   "written");
  return verb;
}

namespace {

// 0: the same bytes; 1: a difference, whose first event is named.
int RunReplay(const MapOptions& options) {
  for (const std::string* other :
       {&options.images, &options.rig, &options.out, &options.times, &options.nav}) {
    if (!other->empty())
      return Report({Errc::kInvalidArgument, *other, "--replay",
                     "is given together with other inputs or outputs",
                     "give the mission alone: its log has all that the mapper had"});
  }
  std::unique_ptr<Progress> progress;
  MapHooks hooks;
  hooks.progress = [&](int done, int total, const std::string& note) {
    if (!progress) progress = std::make_unique<Progress>("replay", total);
    progress->Update(done, note);
  };
  hooks.is_interrupted = IsInterrupted;
  const auto result = ReplayMission(options.replay, hooks);
  if (!result || result->interrupted || result->difference) progress.reset();
  if (!result) return Report(result.error());
  if (result->interrupted) return ReportInterrupted();
  if (progress) progress->Finish();
  const auto count = [](std::int64_t value) { return static_cast<long long>(value); };
  if (const auto& d = result->difference) {
    std::printf("%lld poses the same; then event %lld, %s at %lld us: %s\n",
                count(result->num_poses), count(d->event), d->channel.c_str(), count(d->utime),
                d->what.c_str());
    std::fflush(stdout);
    return Report({Errc::kNotConverged, options.replay, "event " + std::to_string(d->event),
                   "the replay differs from the record: " + d->what,
                   "replay with the build that recorded it; if it is that one, its inputs (log, "
                   "images, rig.yaml) are not those of the flight: a camera's images are only "
                   "where onboard.record_lossless was on"});
  }
  std::printf("%s: %d images, %lld poses and %lld events in all, the same to the last byte\n",
              options.replay.c_str(), result->num_images, count(result->num_poses),
              count(result->num_events));
  if (result->num_left_out > 0)
    std::printf("%d images were not mapped in the flight\n", result->num_left_out);
  return FinishStdout();
}

}  // namespace

int RunMap(const MapOptions& options) {
  if (!options.replay.empty()) return RunReplay(options);
  if (options.images.empty() || options.out.empty())
    return Report({Errc::kInvalidArgument, options.images.empty() ? "IMAGES" : "--out", "",
                   "is missing", "give both IMAGES and --out, or --replay MISSION"});
  MapRequest request;
  request.images = options.images;
  request.rig = options.rig;
  request.out = options.out;
  if (!options.times.empty()) request.times = options.times;
  if (options.fps > 0.0) request.fps = options.fps;
  if (!options.nav.empty()) request.nav = options.nav;
  request.lcm_url = options.lcm_url;

  std::unique_ptr<Progress> progress;
  MapHooks hooks;
  hooks.progress = [&](int done, int total, const std::string& note) {
    if (!progress) progress = std::make_unique<Progress>("map", total);
    progress->Update(done, note);
  };
  hooks.is_interrupted = IsInterrupted;
  const auto result = MapImages(request, hooks);
  if (!result || result->interrupted) progress.reset();
  if (!result) return Report(result.error());
  if (result->interrupted) return ReportInterrupted();
  if (progress) progress->Finish();

  std::printf("%s: %d of %d images placed, %d resets, %d landmarks, %.3f px in the last window\n",
              options.out.c_str(), result->num_placed, result->num_images, result->num_resets,
              result->num_landmarks, result->mean_error_px);
  if (!result->left_out.empty())
    std::printf("images of which nothing was used: %s\n", result->left_out.c_str());
  std::printf("world: %s, scale %s\n", result->world_is_ned ? "north-east-down" : "first camera",
              result->scale_is_metric ? "metric" : "unknown: nothing measured it");
  const double images = result->num_images;
  std::printf("%.1f ms front end, %.1f ms mapper an image; %.1f images/s; %.1f MiB planned\n",
              1e3 * result->front_end_s / images, 1e3 * result->mapper_s / images,
              images / std::max(result->front_end_s + result->mapper_s, 1e-9),
              static_cast<double>(result->memory_plan_bytes) / (1 << 20));
  if (result->num_placed == 0) {
    return Report({Errc::kNotEnoughInliers, options.images, "",
                   "no two images have enough matches with parallax: nothing was placed",
                   "check camera and port in the rig file, or lower init_min_inliers and "
                   "init_min_angle_deg of its mapper section"});
  }
  return FinishStdout();
}

}  // namespace rsfm
