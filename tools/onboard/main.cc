// rsfm_onboard RIG.yaml: see docs/onboard.md.
#include <signal.h>
#include <time.h>

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <string_view>

#include "tools/onboard/daemon.h"

namespace rsfm {
namespace {

constexpr int kDone = 0, kFailed = 1, kWrongRequest = 2;

constexpr const char* kUsage =
    "usage: rsfm_onboard RIG.yaml [--out MISSION | --no-mission] [--lcm-url URL]\n"
    "                    [--replay FOLDER [--nav NAV.csv] [--rate F]]\n"
    "\n"
    "Maps what the camera sees, publishes poses on LCM and writes a mission.\n"
    "  --out MISSION    folder to write; default: a new one in onboard.missions_folder\n"
    "  --no-mission     write nothing\n"
    "  --lcm-url URL    bus; default: the rig file's\n"
    "  --replay FOLDER  JPEG or PGM images with their times (images.csv) instead of a camera\n"
    "  --nav NAV.csv    navigation of the replay; default: the folder's nav.csv, else the bus\n"
    "  --rate F         speed of the replay; 0: as fast as the mapper takes it, dropping nothing\n"
    "SIGTERM and SIGINT end it and close the mission; SIGHUP reads exposure, gain, controls and\n"
    "recording from the rig file again.\n";

int Report(const Diagnostic& diagnostic) {
  std::fprintf(stderr, "error: %s\n", ToString(diagnostic).c_str());
  return ExitCode(diagnostic);
}

Diagnostic WrongArgument(const std::string& argument, const char* problem) {
  return {Errc::kInvalidArgument, "", argument, problem, "see rsfm_onboard --help"};
}

IoExpected<DaemonOptions> ParseArguments(int argc, char** argv) {
  DaemonOptions options;
  bool has_rate = false;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--no-mission") {
      options.write_mission = false;
      continue;
    }
    if (!argument.starts_with("--")) {
      if (!options.rig_file.empty()) return Fail(WrongArgument(argument, "is one too many"));
      options.rig_file = argument;
      continue;
    }
    if (i + 1 >= argc) return Fail(WrongArgument(argument, "is unknown or lacks its value"));
    const std::string value = argv[++i];
    if (argument == "--out") {
      options.mission = value;
    } else if (argument == "--lcm-url") {
      options.lcm_url = value;
    } else if (argument == "--replay") {
      options.replay = value;
    } else if (argument == "--nav") {
      options.nav = value;
    } else if (argument == "--rate") {
      char* end = nullptr;
      options.replay_options.rate = std::strtod(value.c_str(), &end);
      has_rate = true;
      if (end == value.c_str() || *end != '\0' || !(options.replay_options.rate >= 0.0) ||
          options.replay_options.rate > 1e6) {
        return Fail(WrongArgument(argument, "takes a number from 0 up"));
      }
    } else {
      return Fail(WrongArgument(argument, "is no option"));
    }
  }
  if (options.rig_file.empty()) return Fail(WrongArgument("RIG.yaml", "is missing"));
  if (!options.replay && (options.nav || has_rate))
    return Fail(WrongArgument(options.nav ? "--nav" : "--rate", "goes with --replay only"));
  if (!options.write_mission && !options.mission.empty())
    return Fail(WrongArgument("--out", "contradicts --no-mission"));
  return options;
}

// Signals come to the main thread, one after the other, and nowhere else.
sigset_t BlockSignals() {
  sigset_t signals;
  ::sigemptyset(&signals);
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) ::sigaddset(&signals, signal);
  ::pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  ::signal(SIGPIPE, SIG_IGN);
  ::signal(SIGXFSZ, SIG_IGN);  // a file size limit is a full disk
  return signals;
}

Daemon::Command WaitForSignal(const sigset_t& signals, int timeout_ms) {
  const timespec timeout = {timeout_ms / 1000, timeout_ms % 1000 * 1'000'000L};
  const int signal = ::sigtimedwait(&signals, nullptr, &timeout);
  if (signal == SIGHUP) return Daemon::Command::kReload;
  return signal > 0 ? Daemon::Command::kStop : Daemon::Command::kNone;
}

int Main(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == "--help") {
    std::fputs(kUsage, stdout);
    return kDone;
  }
  if (argc > 1 && std::string_view(argv[1]) == "--version") {
    std::puts(RSFM_VERSION);
    return kDone;
  }
  const auto options = ParseArguments(argc, argv);
  if (!options) return Report(options.error());
  const sigset_t signals = BlockSignals();
  const Notifier notifier;
  auto daemon = Daemon::Create(*options);
  if (!daemon) return Report(daemon.error());
  for (const std::string& problem : {(*daemon)->mission_problem(), (*daemon)->memory_problem()})
    if (!problem.empty()) std::fprintf(stderr, "warning: %s\n", problem.c_str());
  if (!(*daemon)->mission().empty())
    std::fprintf(stderr, "mission: %s\n", (*daemon)->mission().c_str());
  const IoStatus status = (*daemon)->Run(
      [&signals](int timeout_ms) { return WaitForSignal(signals, timeout_ms); }, notifier);
  const status_t last = (*daemon)->MakeStatus(MonotonicUs());
  std::fprintf(stderr,
               "%lld images, %lld placed, %lld dropped, %lld keyframes; latency p50 %.1f ms, p99 "
               "%.1f ms, of which bus p99 %.2f ms\n",
               static_cast<long long>(last.frames_received),
               static_cast<long long>(last.frames_registered),
               static_cast<long long>(last.frames_dropped),
               static_cast<long long>(last.num_keyframes), last.latency_p50_ms, last.latency_p99_ms,
               (*daemon)->shared().bus_latency.Compute(MonotonicUs()).p99_ms);
  return status ? kDone : Report(status.error());
}

}  // namespace
}  // namespace rsfm

int main(int argc, char** argv) {
  try {
    return rsfm::Main(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return rsfm::kFailed;
  }
}
