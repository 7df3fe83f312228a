#include "tools/rsfm_tool/verb_camera.h"

#include <cstdio>
#include <vector>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/rig.h"
#include "rsfm/io/tables.h"
#include "rsfm_drivers/v4l2/capture.h"
#include "rsfm_drivers/v4l2/device_list.h"
#include "tools/common/exit.h"
#include "tools/common/progress.h"

namespace rsfm {
namespace {

// A camera that gives nothing for so long gives nothing.
constexpr int kPatienceMs = 5000;

int List() {
  std::vector<Diagnostic> problems;
  const auto cameras = ListCameras(&KernelVideoSystem(), &problems);
  for (const CameraInfo& camera : cameras) {
    std::printf("%s  %s  (%s, %s)\n", camera.path.c_str(), camera.card.c_str(),
                camera.driver.c_str(), camera.bus.c_str());
  }
  for (const Diagnostic& problem : problems)
    std::fprintf(stderr, "warning: %s\n", ToString(problem).c_str());
  if (cameras.empty()) std::printf("no camera: no /dev/video* captures, or none may be opened\n");
  return FinishStdout();
}

void PrintFailures(const CallFailures& failures) {
  for (std::size_t i = 0; i < failures.size(); ++i) {
    std::printf("warning: %s (%lld times)\n", ToString(failures[i]).c_str(),
                static_cast<long long>(failures[i].count));
  }
}

IoStatus Describe(const std::string& device) {
  const auto details = DescribeCamera(&KernelVideoSystem(), device);
  if (!details) return Fail(details.error());
  std::printf("%s: %s (%s, %s)\nformats:\n", device.c_str(), details->info.card.c_str(),
              details->info.driver.c_str(), details->info.bus.c_str());
  for (const auto& format : details->formats) {
    const PixelFormat known = FormatOf(format.fourcc);
    std::printf("  %s%s\n", FourccName(format.fourcc).c_str(),
                known == PixelFormat::kAuto
                    ? " (not read here)"
                    : (", capture.format: " + std::string(ToString(known))).c_str());
    for (const auto& size : format.sizes) {
      std::printf("    %s%d x %d", size.size.is_range ? "up to " : "", size.size.width,
                  size.size.height);
      if (size.max_rate_hz > 0.0) std::printf(", to %g images/s", size.max_rate_hz);
      std::printf("\n");
    }
  }
  std::printf("controls:\n");
  for (const ControlInfo& control : details->controls) {
    std::printf("  %s (0x%08x): %lld, from %lld to %lld%s\n", control.name.c_str(), control.id,
                static_cast<long long>(control.value), static_cast<long long>(control.minimum),
                static_cast<long long>(control.maximum),
                control.is_writable ? "" : ", not to be set now");
  }
  PrintFailures(details->failures);
  return {};
}

struct GrabRequest {
  CaptureOptions capture;
  int width = 0, height = 0;
};

IoExpected<GrabRequest> MakeRequest(const CameraOptions& options) {
  GrabRequest request;
  if (!options.rig.empty()) {
    const auto rig = ReadRig(options.rig);
    if (!rig) return Fail(rig.error());
    request = {rig->capture, rig->camera.width, rig->camera.height};
  }
  char rest = 0;
  if (!options.size.empty() &&
      (std::sscanf(options.size.c_str(), "%dx%d%c", &request.width, &request.height, &rest) != 2 ||
       request.width < 2 || request.height < 2)) {
    return Fail({Errc::kInvalidArgument, "", "--size", "'" + options.size + "' is no size",
                 "give WIDTHxHEIGHT, as 1280x960"});
  }
  if (request.width == 0) {
    return Fail({Errc::kInvalidArgument, "", "grab", "does not know the images' size",
                 "give --size WIDTHxHEIGHT or --rig RIG.yaml"});
  }
  if (!options.device.empty()) request.capture.device = options.device;
  if (!options.format.empty() && !FromString(options.format, &request.capture.format)) {
    return Fail({Errc::kInvalidArgument, "", "--format", "'" + options.format + "' is no format",
                 "give auto, grey, y16, y10, nv12, yuyv, bayer8 or mjpeg"});
  }
  if (options.rate_hz > 0.0) request.capture.frame_rate_hz = options.rate_hz;
  if (options.exposure_us >= 0.0) request.capture.exposure_us = options.exposure_us;
  if (options.gain >= 0.0) request.capture.gain = options.gain;
  return request;
}

// What there is; and where a size is known, what the camera makes of the request.
int Info(const CameraOptions& options) {
  const bool has_request = !options.rig.empty() || !options.size.empty();
  IoExpected<GrabRequest> request = GrabRequest();
  if (has_request) request = MakeRequest(options);
  if (!request) return Report(request.error());
  const CaptureOptions& capture = request->capture;
  const std::string device = options.device.empty() ? capture.device : options.device;
  if (auto s = Describe(device); !s) return Report(s.error());
  if (!has_request) return FinishStdout();
  auto opened = VideoDevice::Open(&KernelVideoSystem(), capture, request->width, request->height);
  if (!opened) return Report(opened.error());
  std::printf("as it is asked for: %s\n", ToString(opened->format()).c_str());
  PrintFailures(*opened->failures());
  return FinishStdout();
}

IoStatus WritePgm(const std::filesystem::path& path, const std::vector<std::uint8_t>& grey,
                  int width, int height) {
  std::string bytes = "P5\n" + std::to_string(width) + " " + std::to_string(height) + "\n255\n";
  bytes.append(reinterpret_cast<const char*>(grey.data()), grey.size());
  return WriteFileAtomically(path, bytes);
}

int Grab(const CameraOptions& options) {
  const auto request = MakeRequest(options);
  if (!request) return Report(request.error());
  std::error_code error;
  std::filesystem::create_directories(options.out, error);
  if (error) return Report(FromErrno(error.value(), options.out, "create the folder"));
  Capture capture(&KernelVideoSystem(), request->capture, request->width, request->height);
  if (auto s = capture.Open(); !s) return Report(s.error());
  std::vector<std::uint8_t> grey(static_cast<std::size_t>(request->width) *
                                 static_cast<std::size_t>(request->height));
  std::vector<ImageTime> images;
  for (int idle_ms = 0; static_cast<int>(images.size()) < options.count && !IsInterrupted();) {
    for (const std::string& news : capture.TakeNews()) std::fprintf(stderr, "%s\n", news.c_str());
    CapturedFrame frame;
    constexpr int kStepMs = 200;
    if (capture.Next(kStepMs, grey.data(), &frame) != Capture::Result::kFrame) {
      idle_ms += kStepMs;
      if (idle_ms < kPatienceMs) continue;
      return Report(capture.last_problem().value_or(
          Diagnostic{Errc::kIo, request->capture.device, "", "gives no images",
                     "see its cable, its trigger and its frame rate"}));
    }
    idle_ms = 0;
    char name[32];
    std::snprintf(name, sizeof name, "%06zu.pgm", images.size());
    if (auto s = WritePgm(std::filesystem::path(options.out) / name, grey, request->width,
                          request->height);
        !s) {
      return Report(s.error());
    }
    images.push_back({name, frame.utime});
  }
  if (auto s = WriteImageTimes(images, std::filesystem::path(options.out) / "images.csv"); !s)
    return Report(s.error());
  const CaptureCounters& counters = capture.counters();
  const double seconds =
      images.size() > 1 ? SecondsFromUs(images.back().utime - images.front().utime) : 0.0;
  std::printf("%zu images of %s in %s, %.2f images/s; %lld missed, %lld damaged\n", images.size(),
              FourccName(capture.format().fourcc).c_str(), options.out.c_str(),
              seconds > 0.0 ? static_cast<double>(images.size() - 1) / seconds : 0.0,
              static_cast<long long>(counters.missed), static_cast<long long>(counters.damaged));
  if (counters.late + counters.io_errors + counters.bad_stamps + counters.clock_steps +
          counters.restarts >
      0) {
    std::printf(
        "%lld late, %lld I/O errors, %lld impossible time stamps, %lld clock steps, %lld "
        "restarts\n",
        static_cast<long long>(counters.late), static_cast<long long>(counters.io_errors),
        static_cast<long long>(counters.bad_stamps), static_cast<long long>(counters.clock_steps),
        static_cast<long long>(counters.restarts));
  }
  return FinishStdout();
}

}  // namespace

CLI::App* DeclareCamera(CLI::App& app, CameraOptions* options) {
  CLI::App* verb = app.add_subcommand("camera", "List cameras, describe one, or take images");
  verb->add_option("ACTION", options->action, "list, info or grab")
      ->required()
      ->check(CLI::IsMember({"list", "info", "grab"}));
  verb->add_option("--device", options->device, "Device; default: the rig's, else /dev/video0");
  verb->add_option("--rig", options->rig, "Rig file: size and capture section");
  verb->add_option("--size", options->size, "WIDTHxHEIGHT in pixels; default: the rig's");
  verb->add_option("--format", options->format,
                   "auto, grey, y16, y10, nv12, yuyv, bayer8 or mjpeg");
  verb->add_option("--rate", options->rate_hz, "Images a second");
  verb->add_option("--exposure-us", options->exposure_us, "Exposure; 0: automatic");
  verb->add_option("--gain", options->gain, "Gain, in the device's units");
  verb->add_option("--count", options->count, "grab: so many images")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  verb->add_option("--out", options->out, "grab: folder for PGM images and images.csv");
  return verb;
}

int RunCamera(const CameraOptions& options) {
  if (options.action == "list") return List();
  if (options.action == "info") return Info(options);
  if (options.out.empty()) {
    return Report(
        {Errc::kInvalidArgument, "", "--out", "is missing", "give a folder for the images"});
  }
  return Grab(options);
}

}  // namespace rsfm
