// Where images come from: the camera, or a folder.
#pragma once

#include <memory>
#include <string>

#include "rsfm/navigation/nav_sample.h"
#include "rsfm_drivers/v4l2/capture.h"
#include "tools/feed/image_list.h"
#include "tools/onboard/frame_pool.h"

namespace rsfm {

class FrameSource {
 public:
  enum class Result : std::uint8_t { kFrame, kNothing, kEnd };

  virtual ~FrameSource() = default;
  // Waits at most a fifth of a second for the next image.
  virtual Result Next(Frame* frame) = 0;
  // Exposure, gain and other controls, while it runs.
  virtual IoStatus ChangeControls(const CaptureOptions& options) = 0;
  virtual CaptureCounters counters() const = 0;
  // What keeps images from coming, or controls from being taken; empty: nothing does.
  virtual std::string problem() const = 0;
  // What the daemon's log should have since the last call.
  virtual std::vector<std::string> TakeNews() { return {}; }
};

class CameraSource final : public FrameSource {
 public:
  CameraSource(VideoSystem* system, const CaptureOptions& options, int width, int height)
      : capture_(system, options, width, height) {}
  Result Next(Frame* frame) override;
  IoStatus ChangeControls(const CaptureOptions& options) override {
    return capture_.ChangeControls(options);
  }
  CaptureCounters counters() const override { return capture_.counters(); }
  std::string problem() const override;
  std::vector<std::string> TakeNews() override { return capture_.TakeNews(); }

 private:
  Capture capture_;
};

struct ReplayOptions {
  // 1: as fast as it was taken, 2: twice as fast; 0: as fast as the mapper takes, and nothing is
  // dropped.
  double rate = 1.0;
};

// JPEG or PGM images with their times. What cannot be read is counted as damaged and left out.
class ReplaySource final : public FrameSource {
 public:
  ReplaySource(ImageList list, std::vector<NavSample> nav, int width, int height,
               const ReplayOptions& options);
  Result Next(Frame* frame) override;
  IoStatus ChangeControls(const CaptureOptions&) override { return {}; }
  CaptureCounters counters() const override { return counters_; }
  std::string problem() const override { return problem_; }

  // The navigation that belongs before the image that Next() gave last, sample by sample: false
  // when there is no more.
  bool NextNav(NavSample* sample);
  const ImageList& list() const { return list_; }

 private:
  IoStatus Read(const std::filesystem::path& path, std::uint8_t* grey);

  ImageList list_;
  std::vector<NavSample> nav_;
  int width_, height_;
  ReplayOptions options_;
  std::optional<JpegDecoder> jpeg_;
  CaptureCounters counters_;
  std::string problem_;
  std::size_t next_image_ = 0, next_nav_ = 0;
  Utime nav_until_ = INT64_MIN;
  std::int64_t start_us_ = 0;  // monotonic
};

// Navigation is handed over this much ahead of an image, as it is on a vehicle whose images take
// their time to arrive: interpolation needs a sample on both sides.
inline constexpr Utime kReplayNavLeadUs = 500'000;

}  // namespace rsfm
