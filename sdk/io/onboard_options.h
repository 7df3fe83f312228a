// What rig.yaml says about the camera's driver (`capture`) and about the daemon (`onboard`).
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace rsfm {

// How pixels come from the camera. kAuto takes the first of the others that the camera offers in
// the rig's size, in this order: what needs least work and loses least.
enum class PixelFormat : std::uint8_t { kAuto, kGrey, kY16, kY10, kNv12, kYuyv, kBayer8, kMjpeg };

// Section `capture`.
struct CaptureOptions {
  // A device node. /dev/v4l/by-id/... and /dev/rsfm-camera (udev rule) survive replugging.
  std::string device = "/dev/video0";
  PixelFormat format = PixelFormat::kAuto;
  double frame_rate_hz = 0.0;  // 0: the device's own
  int num_buffers = 4;         // of the driver's pool; the device may grant another number
  double exposure_us = 0.0;    // 0: automatic
  double gain = -1.0;          // in the device's own units; negative: automatic
  // Any other control by the device's name for it, lower case with underscores ("trigger_mode"),
  // or by number ("0x009a0902"); set in this order by name when the device is opened.
  std::map<std::string, std::int64_t> controls;

  // Time. The first to the last row's read-out; rows of a rolling shutter are exposed one after the
  // other, and the time of an image is then its middle row's.
  double readout_us = 0.0;
  bool rolling_shutter = false;
  double time_offset_us = 0.0;  // added to every image's time: a delay that was measured

  // Without a frame for this long the device is closed and opened again; 0: ten frame periods, at
  // least a second. Give more than the longest pause of an external trigger.
  double watchdog_s = 0.0;
};

// Section `onboard`.
struct OnboardOptions {
  // Missions are folders in here, named by the time of the start (UTC).
  std::string missions_folder = "/var/lib/rsfm/missions";

  // Images.
  bool record_images = true;
  int record_every = 1;                 // of the frames, one in so many
  bool record_lossless = false;         // as PGM instead of JPEG: replays to the same bytes
  int jpeg_quality = 90;                // 1 to 100
  std::int64_t image_quota_mb = 0;      // of one mission's images; 0: no quota
  std::int64_t min_disk_free_mb = 512;  // recording images stops below: the log needs room

  // Queues; what is dropped when one is full is in docs/onboard.md.
  int frame_queue = 2;    // frames that wait for the mapper
  int record_queue = 16;  // frames that wait for the disk
  int bus_queue_mb = 4;   // messages that wait for the bus
  int log_queue_mb = 32;  // messages that wait for the disk
  int nav_queue = 1024;   // navigation samples that wait for the mapper

  // Real time. Priority 0: the ordinary scheduler, else SCHED_FIFO's; cpu -1: any.
  int capture_priority = 0;
  int capture_cpu = -1;
  int mapper_priority = 0;
  int mapper_cpu = -1;
  bool lock_memory = false;  // nothing of the process is ever swapped out
};

std::string_view ToString(PixelFormat format);  // "auto", "grey", "y16", ...
bool FromString(std::string_view name, PixelFormat* format);

// f(name, member, low, high) for every option but `device`, `format` and `controls`, in the order
// of the rig file; low and high bound the member. Members are int, std::int64_t, bool or double.
template <class Options, class F>
void ForEachCaptureOption(Options& o, F&& f) {
  f("frame_rate_hz", o.frame_rate_hz, 0, 10000);
  f("num_buffers", o.num_buffers, 2, 32);
  f("exposure_us", o.exposure_us, 0, 10'000'000);
  f("gain", o.gain, -1, 1'000'000'000);
  f("readout_us", o.readout_us, 0, 1'000'000);
  f("rolling_shutter", o.rolling_shutter, 0, 1);
  f("time_offset_us", o.time_offset_us, -10'000'000, 10'000'000);
  f("watchdog_s", o.watchdog_s, 0, 3600);
}
// The same for every option but `missions_folder`.
template <class Options, class F>
void ForEachOnboardOption(Options& o, F&& f) {
  f("record_images", o.record_images, 0, 1);
  f("record_every", o.record_every, 1, 1'000'000);
  f("record_lossless", o.record_lossless, 0, 1);
  f("jpeg_quality", o.jpeg_quality, 1, 100);
  f("image_quota_mb", o.image_quota_mb, 0, 1'000'000'000);
  f("min_disk_free_mb", o.min_disk_free_mb, 0, 1'000'000'000);
  f("frame_queue", o.frame_queue, 1, 64);
  f("record_queue", o.record_queue, 1, 256);
  f("bus_queue_mb", o.bus_queue_mb, 1, 1024);
  f("log_queue_mb", o.log_queue_mb, 1, 1024);
  f("nav_queue", o.nav_queue, 16, 65536);
  f("capture_priority", o.capture_priority, 0, 99);
  f("capture_cpu", o.capture_cpu, -1, 1023);
  f("mapper_priority", o.mapper_priority, 0, 99);
  f("mapper_cpu", o.mapper_cpu, -1, 1023);
  f("lock_memory", o.lock_memory, 0, 1);
}

}  // namespace rsfm
