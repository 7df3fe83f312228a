// camera_daemon RIG IMAGES MISSION URL FRAMES: the daemon with a camera that is not there. It shows
// the PGM images of a folder, to the last one and back, at the rate that the rig asks for, until so
// many have been taken. Exit codes: those of rsfm_onboard.
#include <time.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "rsfm/io/atomic_output.h"
#include "tests/drivers/paced_video.h"
#include "tools/feed/image_list.h"
#include "tools/onboard/daemon.h"

namespace rsfm {
namespace {

int Report(const Diagnostic& diagnostic) {
  std::fprintf(stderr, "error: %s\n", ToString(diagnostic).c_str());
  return ExitCode(diagnostic);
}

int Main(char** arguments) {
  DaemonOptions options;
  options.rig_file = arguments[1];
  options.mission = arguments[3];
  options.lcm_url = arguments[4];
  const long num_frames = std::atol(arguments[5]);
  const auto rig = ReadRig(options.rig_file);
  const auto list = ListImages(arguments[2], std::nullopt, 1.0);
  if (!rig || !list) return Report(!rig ? rig.error() : list.error());
  std::vector<std::string> images;
  for (const ImageTime& image : list->images) {
    auto bytes = ReadWholeFile(list->folder / image.image, std::size_t{1} << 24);
    if (!bytes) return Report(bytes.error());
    images.push_back(std::move(*bytes));
  }
  PacedVideo video;
  video.fake.formats = {{V4L2_PIX_FMT_GREY, rig->camera.width, rig->camera.height, 1, 1000.0}};
  video.fake.fill = [&](std::uint32_t sequence, std::uint8_t* data, std::size_t* bytes) {
    const std::size_t turn = 2 * (images.size() - 1), at = sequence % turn;
    const std::string& image = images[at < images.size() ? at : turn - at];
    std::memcpy(data, image.data() + image.size() - *bytes, *bytes);
  };
  options.video = &video;
  auto daemon = Daemon::Create(options);
  if (!daemon) return Report(daemon.error());
  const auto wait = [&](int) {
    const timespec duration = {0, 5'000'000};
    ::nanosleep(&duration, nullptr);
    const bool is_over = (*daemon)->MakeStatus(MonotonicUs()).frames_received >= num_frames;
    return is_over ? Daemon::Command::kStop : Daemon::Command::kNone;
  };
  const IoStatus status = (*daemon)->Run(wait, Notifier());
  return status ? 0 : Report(status.error());
}

}  // namespace
}  // namespace rsfm

int main(int argc, char** argv) {
  if (argc == 6) return rsfm::Main(argv);
  std::fputs("usage: camera_daemon RIG IMAGES MISSION URL FRAMES\n", stderr);
  return 2;
}
