// Frames of a simulated mission into the kernel's `vivid` driver: out of its HDMI output, which is
// looped into its HDMI input, where a camera is expected. Runs in the guest of tests/vivid/run.sh.
//
//   vivid_feed play CAPTURE OUTPUT MISSION STEP_MS LCM_URL
//     shows the mission's images to and fro, a new one each STEP_MS, until it is ended by a signal;
//     RSFM_NAV tells where the vehicle was when the image was taken, a few frames before it is
//     seen: the daemon refuses repeated images, so what it maps is the first sight of each
//   vivid_feed grab CAPTURE MISSION COUNT
//     captures COUNT frames and counts those that are equal to one of the images
//   vivid_feed set DEVICE NUMBER VALUE
//     one control, such as a fault of vivid's
#include <fcntl.h>
#include <linux/v4l2-dv-timings.h>
#include <linux/videodev2.h>
#include <signal.h>
#include <sys/mman.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/nav_messages.h"
#include "rsfm/io/rig.h"
#include "rsfm/io/tables.h"
#include "rsfm/io/trajectory.h"
#include "rsfm_drivers/jpeg/jpeg.h"
#include "rsfm_drivers/lcm/bus.h"
#include "rsfm_drivers/v4l2/capture.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

constexpr std::uint32_t kLoopVideo = 0x00f0f025;     // output to input
constexpr std::uint32_t kOnScreenText = 0x00f0f001;  // 2: none, the pixels pass unchanged
constexpr std::uint32_t kStampSource = 0x00f0f018;  // 1: start of exposure; 0 may lie in the future
constexpr int kNumBuffers = 4;
constexpr std::int64_t kNavPeriodUs = 50'000;
constexpr std::int64_t kReturnUs = 2'000'000;  // the camera's user comes back before the cable does

bool IsEnded() {
  sigset_t pending;
  ::sigpending(&pending);
  return ::sigismember(&pending, SIGTERM) == 1;
}

struct Show {
  int width = 0, height = 0;
  std::vector<std::vector<std::uint8_t>> images;
  std::vector<NavSample> nav;  // of each image: position, attitude and depth; it stands still
};

bool Complain(const std::string& what) {
  std::fprintf(stderr, "vivid_feed: %s: %s\n", what.c_str(), std::strerror(errno));
  return false;
}

// What a good inertial navigation says of this pose.
NavSample NavOf(const Rigid3& ned_from_body) {
  NavSample nav;
  nav.position_ned_m = ned_from_body.translation;
  nav.sigma_position_m = Vec3::Constant(0.005);
  nav.ned_from_body = ned_from_body.rotation;
  nav.sigma_attitude_rad = Vec3::Constant(0.002);
  nav.depth_m = ned_from_body.translation.z();
  nav.sigma_depth_m = 0.005;
  for (const NavField field : {NavField::kPosition, NavField::kAttitude, NavField::kDepth})
    nav.Set(field);
  return nav;
}

bool ReadShow(const fs::path& mission, Show* show) {
  const auto rig = ReadRig(mission / "rig.yaml");
  const auto times = ReadImageTimes(mission / "images.csv");
  if (!rig || !times) return Complain("the mission's rig.yaml or images.csv");
  const auto poses = ReadTum(mission / "ground_truth" / "trajectory.tum");
  if (!poses || poses->size() != times->size()) return Complain("the mission's ground truth");
  show->width = rig->camera.width;
  show->height = rig->camera.height;
  auto decoder = JpegDecoder::Create();
  if (!decoder) return Complain("the JPEG decoder");
  const auto size = static_cast<std::size_t>(show->width) * static_cast<std::size_t>(show->height);
  for (const ImageTime& image : *times) {
    const auto bytes = ReadWholeFile(mission / "images" / image.image);
    if (!bytes) return Complain(image.image);
    std::vector<std::uint8_t>& grey = show->images.emplace_back(size);
    const std::span data(reinterpret_cast<const std::uint8_t*>(bytes->data()), bytes->size());
    if (!decoder->Decode(data, show->width, show->height, grey.data()))
      return Complain(image.image);
    show->nav.push_back(
        NavOf((*poses)[show->nav.size()].world_from_camera * rig->body_from_camera.Inverse()));
  }
  return true;
}

bool SetControl(VideoSystem* system, int fd, std::uint32_t id, std::int32_t value) {
  v4l2_control control = {id, value};
  errno = system->Ioctl(fd, VIDIOC_S_CTRL, &control);
  return errno == 0 || Complain("set a control");
}

v4l2_dv_timings TimingsOf(int width) {
  const v4l2_dv_timings small = V4L2_DV_BT_CEA_640X480P59_94, large = V4L2_DV_BT_CEA_1280X720P24;
  return width == 640 ? small : large;
}

// The output side of the loop while its device is there.
class Player {
 public:
  Player(VideoSystem* system, const Show& show) : system_(system), show_(show) {}
  ~Player() {
    for (const Mapped& buffer : buffers_) system_->Unmap(buffer.data, buffer.bytes);
  }

  bool Open(const char* capture, const char* output) {
    int fd = -1;
    if ((errno = system_->Open(capture, &fd)) != 0) return false;
    const UniqueFd input(system_, fd);
    if ((errno = system_->Open(output, &fd)) != 0) return false;
    output_ = UniqueFd(system_, fd);
    for (const int device : {input.get(), output_.get()}) {
      v4l2_dv_timings timings = TimingsOf(show_.width);
      errno = system_->Ioctl(device, VIDIOC_S_DV_TIMINGS, &timings);
      // A camera that is streaming already has them.
      if (errno != 0 && errno != EBUSY) return Complain("VIDIOC_S_DV_TIMINGS");
    }
    return SetControl(system_, input.get(), kLoopVideo, 1) &&
           SetControl(system_, input.get(), kOnScreenText, 2) &&
           SetControl(system_, input.get(), kStampSource, 1) && StartStream();
  }

  // False: the device is gone.
  bool Step(std::size_t image) {
    unsigned events = 0;
    if (system_->Poll(output_.get(), 20, &events) != 0 || (events & VideoSystem::kError) != 0)
      return false;
    for (int i = 0; i < kNumBuffers; ++i) {
      v4l2_buffer buffer = Buffer(0);
      const int error = system_->Ioctl(output_.get(), VIDIOC_DQBUF, &buffer);
      if (error == EAGAIN) return true;
      if (error != 0) return false;
      if (!Queue(buffer.index, image)) return false;
    }
    return true;
  }

 private:
  struct Mapped {
    void* data;
    std::size_t bytes;
    std::size_t image;  // what it holds
  };

  v4l2_buffer Buffer(std::uint32_t index) const {
    v4l2_buffer buffer = {};
    buffer.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    buffer.memory = V4L2_MEMORY_MMAP;
    buffer.index = index;
    buffer.field = V4L2_FIELD_NONE;
    return buffer;
  }

  bool StartStream() {
    v4l2_format format = {};
    format.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    format.fmt.pix.width = static_cast<std::uint32_t>(show_.width);
    format.fmt.pix.height = static_cast<std::uint32_t>(show_.height);
    format.fmt.pix.pixelformat = V4L2_PIX_FMT_GREY;
    format.fmt.pix.field = V4L2_FIELD_NONE;
    format.fmt.pix.colorspace = V4L2_COLORSPACE_SRGB;
    if ((errno = system_->Ioctl(output_.get(), VIDIOC_S_FMT, &format)) != 0)
      return Complain("VIDIOC_S_FMT");
    v4l2_requestbuffers request = {};
    request.count = kNumBuffers;
    request.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    request.memory = V4L2_MEMORY_MMAP;
    if ((errno = system_->Ioctl(output_.get(), VIDIOC_REQBUFS, &request)) != 0)
      return Complain("VIDIOC_REQBUFS");
    for (std::uint32_t i = 0; i < request.count; ++i) {
      v4l2_buffer buffer = Buffer(i);
      if ((errno = system_->Ioctl(output_.get(), VIDIOC_QUERYBUF, &buffer)) != 0)
        return Complain("VIDIOC_QUERYBUF");
      void* data = nullptr;
      if ((errno = system_->Map(output_.get(), buffer.length, buffer.m.offset, &data)) != 0)
        return Complain("mmap");
      buffers_.push_back({data, buffer.length, show_.images.size()});
      if (!Queue(i, 0)) return false;
    }
    int type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    errno = system_->Ioctl(output_.get(), VIDIOC_STREAMON, &type);
    return errno == 0 || Complain("VIDIOC_STREAMON");
  }

  bool Queue(std::uint32_t index, std::size_t image) {
    const std::vector<std::uint8_t>& pixels = show_.images[image];
    if (buffers_[index].bytes < pixels.size()) return false;
    if (buffers_[index].image != image)
      std::memcpy(buffers_[index].data, pixels.data(), pixels.size());
    buffers_[index].image = image;
    v4l2_buffer buffer = Buffer(index);
    buffer.bytesused = static_cast<std::uint32_t>(pixels.size());
    return (errno = system_->Ioctl(output_.get(), VIDIOC_QBUF, &buffer)) == 0;
  }

  VideoSystem* system_;
  const Show& show_;
  UniqueFd output_;
  std::vector<Mapped> buffers_;
};

int Play(char** argv) {
  Show show;
  if (!ReadShow(argv[4], &show)) return 1;
  const std::int64_t step_us = 1000 * std::atoll(argv[5]);
  auto bus = LcmBus::Create({.url = argv[6]});
  if (!bus || step_us <= 0) return 2;
  VideoSystem& system = KernelVideoSystem();
  const std::int64_t start_us = system.MonotonicUs();
  const auto turns = static_cast<std::int64_t>(2 * show.images.size() - 2);
  std::unique_ptr<Player> player;
  std::int64_t last_nav_us = 0, away_until_us = 0;
  std::size_t last_image = 0;
  int num_opens = 0;
  while (!IsEnded()) {
    const std::int64_t now_us = system.MonotonicUs();
    std::int64_t at = (now_us - start_us) / step_us % turns;
    if (at >= static_cast<std::int64_t>(show.images.size())) at = turns - at;  // back again
    const auto image = static_cast<std::size_t>(at);
    if (!player && now_us >= away_until_us) {
      player = std::make_unique<Player>(&system, show);
      if (player->Open(argv[2], argv[3])) {
        std::printf("vivid_feed: playing, %d x %d, open %d\n", show.width, show.height,
                    ++num_opens);
        std::fflush(stdout);
      } else {
        player.reset();
        if (num_opens == 0) return 1;
        away_until_us = now_us + kReturnUs;
      }
    }
    if (player && !player->Step(image)) {
      player.reset();
      away_until_us = system.MonotonicUs() + kReturnUs;
    }
    if (player && (image != last_image || now_us - last_nav_us >= kNavPeriodUs)) {
      last_nav_us = now_us;
      last_image = image;
      nav_t nav = ToMessage(show.nav[image]);
      nav.utime = system.UtcUs();
      (*bus)->Publish("RSFM_NAV", nav);
    }
    if (!player) system.Wait(kNavPeriodUs);
  }
  return 0;
}

int Grab(char** argv) {
  Show show;
  if (!ReadShow(argv[3], &show)) return 1;
  CaptureOptions options;
  options.device = argv[2];
  options.format = PixelFormat::kGrey;
  Capture capture(&KernelVideoSystem(), options, show.width, show.height);
  std::vector<std::uint8_t> grey(show.images[0].size());
  CapturedFrame frame;
  const int wanted = std::atoi(argv[4]);
  int num_frames = 0, num_exact = 0;
  for (int calls = 0; num_frames < wanted && calls < 20 * wanted; ++calls) {
    if (capture.Next(500, grey.data(), &frame) != Capture::Result::kFrame) continue;
    ++num_frames;
    for (const auto& image : show.images) num_exact += image == grey ? 1 : 0;
  }
  std::printf("vivid_feed: grabbed %d, exact %d, missed %lld\n", num_frames, num_exact,
              static_cast<long long>(capture.counters().missed));
  return 0;
}

int Set(char** argv) {
  VideoSystem& system = KernelVideoSystem();
  int fd = -1;
  if ((errno = system.Open(argv[2], &fd)) != 0) return Complain(argv[2]) ? 0 : 1;
  const UniqueFd device(&system, fd);
  const auto id = static_cast<std::uint32_t>(std::strtoul(argv[3], nullptr, 0));
  return SetControl(&system, device.get(), id, std::atoi(argv[4])) ? 0 : 1;
}

int Main(int argc, char** argv) {
  sigset_t signals;
  ::sigemptyset(&signals);
  ::sigaddset(&signals, SIGTERM);
  ::sigprocmask(SIG_BLOCK, &signals, nullptr);
  const std::string verb = argc > 1 ? argv[1] : "";
  if (verb == "play" && argc == 7) return Play(argv);
  if (verb == "grab" && argc == 5) return Grab(argv);
  if (verb == "set" && argc == 5) return Set(argv);
  std::fprintf(stderr, "usage: see vivid_feed.cc\n");
  return 2;
}

}  // namespace
}  // namespace rsfm

int main(int argc, char** argv) { return rsfm::Main(argc, argv); }
