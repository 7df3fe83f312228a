#include "tools/onboard/frame_source.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/pgm.h"

namespace rsfm {
namespace {

constexpr int kWaitMs = 100;

}  // namespace

FrameSource::Result CameraSource::Next(Frame* frame) {
  CapturedFrame captured;
  if (capture_.Next(kWaitMs, frame->grey.data(), &captured) != Capture::Result::kFrame)
    return Result::kNothing;
  frame->utime = captured.utime;
  frame->origin_us = captured.mid_exposure_us;
  frame->nav_until = INT64_MAX;
  return Result::kFrame;
}

std::string CameraSource::problem() const {
  std::string text;
  for (const auto& problem : {&capture_.last_problem(), &capture_.control_problem()})
    if (*problem) text += (text.empty() ? "" : "; ") + ToString(**problem);
  return text;
}

ReplaySource::ReplaySource(ImageList list, std::vector<NavSample> nav, int width, int height,
                           const ReplayOptions& options)
    : list_(std::move(list)),
      nav_(std::move(nav)),
      width_(width),
      height_(height),
      options_(options) {
  if (auto jpeg = JpegDecoder::Create()) jpeg_ = std::move(*jpeg);
}

IoStatus ReplaySource::Read(const std::filesystem::path& path, std::uint8_t* grey) {
  const auto bytes = ReadWholeFile(path, std::size_t{1} << 28);
  if (!bytes) return Fail(bytes.error());
  const std::string_view pixels = PgmPixels(*bytes, width_, height_);
  if (!pixels.empty()) {
    std::memcpy(grey, pixels.data(), pixels.size());
    return {};
  }
  const std::span data(reinterpret_cast<const std::uint8_t*>(bytes->data()), bytes->size());
  if (jpeg_ && jpeg_->Decode(data, width_, height_, grey)) return {};
  return Fail({Errc::kInvalidArgument, path.string(), "image",
               "is no whole JPEG or 8-bit PGM of " + std::to_string(width_) + " x " +
                   std::to_string(height_) + " px",
               "give images of the rig's camera"});
}

FrameSource::Result ReplaySource::Next(Frame* frame) {
  if (next_image_ >= list_.images.size()) return Result::kEnd;
  const ImageTime& image = list_.images[next_image_];
  VideoSystem& system = KernelVideoSystem();
  const std::int64_t now_us = system.MonotonicUs();
  if (next_image_ == 0 && start_us_ == 0) start_us_ = now_us;
  if (options_.rate > 0.0) {
    const double since_first = static_cast<double>(image.utime - list_.images.front().utime);
    const std::int64_t due_us = start_us_ + static_cast<std::int64_t>(since_first / options_.rate);
    if (due_us > now_us) {
      system.Wait(std::min<std::int64_t>(due_us - now_us, 1000 * kWaitMs));
      if (due_us - now_us > 1000 * kWaitMs) return Result::kNothing;
    }
  }
  ++next_image_;
  nav_until_ = image.utime + kReplayNavLeadUs;
  if (auto s = Read(list_.folder / image.image, frame->grey.data()); !s) {
    ++counters_.damaged;
    problem_ = ToString(s.error());
    return Result::kNothing;
  }
  ++counters_.frames;
  frame->utime = image.utime;
  frame->origin_us = system.MonotonicUs();
  frame->image = image.image;
  return Result::kFrame;
}

bool ReplaySource::NextNav(NavSample* sample) {
  if (next_nav_ >= nav_.size() || nav_[next_nav_].utime > nav_until_) return false;
  *sample = nav_[next_nav_++];
  return true;
}

}  // namespace rsfm
