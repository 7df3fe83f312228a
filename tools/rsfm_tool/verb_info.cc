#include "tools/rsfm_tool/verb_info.h"

#include <cstdio>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <utility>

#include "rsfm/io/event_log.h"
#include "rsfm/io/mission.h"
#include "rsfm/io/model.h"
#include "rsfm/io/rig_names.h"
#include "rsfm/io/trajectory.h"
#include "tools/common/exit.h"
#include "tools/common/progress.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

long long Count(std::size_t size) { return static_cast<long long>(size); }

void PrintLog(const EventLogStatistics& log) {
  std::printf("events        %lld in %.3f s\n", static_cast<long long>(log.num_events),
              SecondsFromUs(log.last_utime - log.first_utime));
  for (const auto& [name, channel] : log.channels) {
    std::printf("  %-24s %8lld events  %12lld bytes\n", name.c_str(),
                static_cast<long long>(channel.num_events),
                static_cast<long long>(channel.num_bytes));
  }
  if (log.num_damaged > 0) {
    std::printf("damage        %lld places, %lld bytes skipped\n",
                static_cast<long long>(log.num_damaged), static_cast<long long>(log.damaged_bytes));
  }
  if (log.cut_bytes > 0) {
    std::printf("cut           the last event is cut off; its %lld bytes are lost\n",
                static_cast<long long>(log.cut_bytes));
  }
  if (log.num_damaged == 0 && log.cut_bytes == 0) std::printf("damage        none\n");
}

double PathLength(const std::vector<TrajectoryPose>& poses) {
  double length = 0.0;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    length += (poses[i].world_from_camera.translation - poses[i - 1].world_from_camera.translation)
                  .norm();
  }
  return length;
}

void PrintWorld(const World& world) {
  std::printf("world         %s", std::string(ToString(world.frame)).c_str());
  if (world.origin) {
    std::printf(", origin %.9f N %.9f E %.3f m", world.origin->latitude_deg,
                world.origin->longitude_deg, world.origin->height_m);
  }
  std::printf("%s\n", world.scale_is_metric ? "" : ", scale not known");
}

void PrintModel(const Model& model) {
  std::size_t num_features = 0, num_observations = 0;
  for (const ModelImage& image : model.images) num_features += image.features.size();
  for (const ModelPoint& point : model.points) num_observations += point.track.size();
  for (const ModelCamera& camera : model.cameras) {
    std::printf("camera        %s %d x %d, port %s\n",
                std::string(ToString(camera.config.lens)).c_str(), camera.config.width,
                camera.config.height, std::string(ToString(camera.config.port.type)).c_str());
  }
  std::printf("images        %lld\nfeatures      %lld\npoints        %lld\n",
              Count(model.images.size()), Count(num_features), Count(model.points.size()));
  std::printf("observations  %lld, %.2f per point\n", Count(num_observations),
              model.points.empty() ? 0.0
                                   : static_cast<double>(num_observations) /
                                         static_cast<double>(model.points.size()));
}

// "  refused: 2 black, 1 torn", or nothing.
void PrintReasons(const char* head,
                  std::initializer_list<std::pair<const char*, std::int64_t>> counts) {
  std::string text;
  for (const auto& [name, count] : counts) {
    if (count > 0) text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + name;
  }
  if (!text.empty()) std::printf("%-13s %s\n", head, text.c_str());
}

// What became of the images and messages, as the vehicle counted.
void PrintStatus(const status_t& status) {
  const auto number = [](std::int64_t value) { return static_cast<long long>(value); };
  std::printf(
      "frames        %lld received, %lld missed, %lld damaged, %lld late, %lld skipped, %lld "
      "camera restarts\n",
      number(status.frames_received), number(status.frames_missed), number(status.frames_damaged),
      number(status.frames_late), number(status.frames_skipped), number(status.camera_restarts));
  PrintReasons("  camera", {{"failed openings", status.camera_failed_openings},
                            {"time stamps that cannot be", status.camera_bad_stamps},
                            {"steps of the clock", status.clock_steps}});
  PrintReasons("  refused", {{"of another form", status.frames_wrong_form},
                             {"of a repeated time", status.frames_repeated_time},
                             {"out of order", status.frames_out_of_order},
                             {"from the future", status.frames_from_the_future},
                             {"black", status.frames_black},
                             {"white", status.frames_white},
                             {"flat", status.frames_flat},
                             {"torn", status.frames_torn},
                             {"duplicate", status.frames_duplicate}});
  PrintReasons("  navigation", {{"not finite", status.nav_not_finite},
                                {"sentinel values", status.nav_sentinel},
                                {"out of range", status.nav_out_of_range},
                                {"running backwards", status.nav_runs_backwards},
                                {"repeated", status.nav_repeated},
                                {"too late", status.nav_too_late},
                                {"frozen", status.nav_frozen},
                                {"jumping", status.nav_jump},
                                {"messages without a usable field", status.nav_unusable},
                                {"outliers", status.nav_outliers}});
  std::printf(
      "messages      %lld malformed, %lld overrun, %lld not logged; %lld images not recorded\n",
      number(status.messages_malformed), number(status.messages_overrun), number(status.log_errors),
      number(status.images_dropped));
}

int PrintMission(const fs::path& path) {
  const auto mission = ReadMission(path, {.keep_descriptors = false});
  if (!mission) return Report(mission.error());
  std::printf("mission       %s\n", path.c_str());
  PrintWorld(mission->rig.world);
  std::printf("images        %lld%s\n", Count(mission->images.size()),
              mission->ImagesFolder().empty() ? ", their files are not here" : "");
  PrintLog(mission->log);
  if (!mission->statuses.empty()) PrintStatus(mission->statuses.back());
  std::printf("malformed     %lld messages\n", static_cast<long long>(mission->num_malformed));
  std::printf("navigation    %lld samples, %lld rejected\n", Count(mission->nav.size()),
              static_cast<long long>(mission->num_nav_rejected));
  const std::vector<TrajectoryPose> poses = TrajectoryOf(*mission);
  std::printf("poses         %lld, of which %lld tracked; path %.3f m\n",
              Count(mission->poses.size()), Count(poses.size()), PathLength(poses));
  for (const water_t& water : mission->waters) {
    std::printf("water         index %.6f", water.index_water);
    if (water.is_measured) {
      std::printf(" from %.3f s on: %.2f degrees, %.2f psu, %.1f m deep",
                  SecondsFromUs(water.utime - mission->waters.front().utime), water.temperature_c,
                  water.salinity_psu, water.depth_m);
    }
    std::printf("\n");
  }
  std::printf("landmarks     %lld\n", Count(mission->landmarks.size()));
  std::printf("keyframes     %lld\n", Count(mission->keyframes.size()));
  std::printf("on-board model\n");
  PrintModel(ModelFromMission(*mission));
  return FinishStdout();
}

int PrintModelFolder(const fs::path& path) {
  const auto model = ReadModel(path);
  if (!model) return Report(model.error());
  std::printf("model         %s\n", path.c_str());
  PrintWorld(model->rig.world);
  PrintModel(*model);
  std::printf("path          %.3f m\n", PathLength(TrajectoryOf(*model)));
  return FinishStdout();
}

int PrintLogFile(const fs::path& path) {
  auto log = EventLogReader::Open(path);
  if (!log) return Report(log.error());
  LogEvent event;
  while (true) {
    const auto has_event = log->Next(&event);
    if (!has_event) return Report(has_event.error());
    if (!*has_event) break;
    if (IsInterrupted()) return ReportInterrupted();
  }
  std::printf("event log     %s, %lld bytes\n", path.c_str(),
              static_cast<long long>(log->file_bytes()));
  PrintLog(log->statistics());
  if (log->statistics().num_events > 0 || log->file_bytes() == 0) return FinishStdout();
  return Report({Errc::kCorrupt, path.string(), "", "holds no event",
                 "give an LCM event log, a mission or a model"});
}

}  // namespace

CLI::App* DeclareInfo(CLI::App& app, InfoOptions* options) {
  CLI::App* verb = app.add_subcommand("info", "Describe a mission, a model or an event log");
  verb->add_option("path", options->path, "mission folder, model folder or event log")->required();
  return verb;
}

int RunInfo(const InfoOptions& options) {
  const fs::path path = options.path;
  std::error_code error;
  if (!fs::is_directory(path, error)) return PrintLogFile(path);
  return IsMissionFolder(path) ? PrintMission(path) : PrintModelFolder(path);
}

}  // namespace rsfm
