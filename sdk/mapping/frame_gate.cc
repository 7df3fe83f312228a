#include "rsfm/mapping/frame_gate.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <utility>
#include "rsfm/base/plausible_time.h"

namespace rsfm {
namespace {

constexpr int kSampleStep = 4;                                     // of the histogram, pixels
constexpr int kBlackBelow = 10, kWhiteFrom = 250, kFlatBelow = 3;  // greys
constexpr int kTornPart = 8;       // of the height, at least one in so many rows
constexpr int kMinRowTexture = 2;  // mean step along a row, greys: rows without may repeat

// Mixes eight bytes at a time [Steele & Vigna 2021, "Computationally easy, spectrally good
// multipliers", SP&E].
std::uint64_t HashOf(const std::uint8_t* bytes, std::size_t count) {
  std::uint64_t hash = count;
  for (std::size_t i = 0; i < count; i += 8) {
    std::uint64_t word = 0;
    std::memcpy(&word, bytes + i, std::min<std::size_t>(8, count - i));
    hash = (hash ^ word) * 0xD1342543DE82EF95u;
    hash ^= hash >> 32;
  }
  return hash;
}

// The greys that one in a hundred samples lies below, and one in a hundred above.
std::pair<int, int> GreyRange(const ImageView& image) {
  int histogram[256] = {};
  int count = 0;
  for (int y = 0; y < image.height; y += kSampleStep) {
    const std::uint8_t* row = image.data + static_cast<std::ptrdiff_t>(y) * image.stride_bytes;
    const int middle = image.channels == 3 ? 1 : 0;
    for (int x = 0; x < image.width; x += kSampleStep, ++count)
      ++histogram[row[x * image.channels + middle]];
  }
  const int tail = count / 100;
  int low = 0, high = 255;
  for (int sum = histogram[0]; sum <= tail && low < 255; sum += histogram[low]) ++low;
  for (int sum = histogram[255]; sum <= tail && high > 0; sum += histogram[high]) --high;
  return {low, std::max(low, high)};
}

}  // namespace

std::string_view ToString(FrameVerdict verdict) noexcept {
  constexpr std::string_view kNames[kNumFrameVerdicts] = {
      "good",  "no image", "wrong size", "repeated time", "out of order", "from the future",
      "black", "white",    "flat",       "torn",          "duplicate"};
  return kNames[static_cast<int>(verdict)];
}

FrameGate::FrameGate(int width_px, int height_px, const FrameGateOptions& options)
    : width_(width_px),
      height_(height_px),
      options_(options),
      max_gap_us_(static_cast<Utime>(1e6 * options.max_gap_s)),
      back_us_(static_cast<Utime>(1e6 * options.back_that_confirms_s)),
      rows_(static_cast<std::size_t>(std::max(height_px, 0))),
      last_rows_(rows_.capacity()) {
  rows_.TryResize(rows_.capacity());
  last_rows_.TryResize(last_rows_.capacity());
}

void FrameGate::SeeTime(Utime utime) noexcept {
  if (!IsTime(utime)) return;
  newest_seen_ = has_seen_ ? std::max(newest_seen_, utime) : utime;
  has_seen_ = true;
}

FrameVerdict FrameGate::Check(const ImageView& image, Utime utime) noexcept {
  const FrameVerdict verdict = Judge(image, utime);
  ++counts_[static_cast<int>(verdict)];
  was_set_back_ = IsTimeGood(verdict) && has_time_ && utime < last_utime_;
  if (was_set_back_) has_seen_ = false;
  if (IsTimeGood(verdict)) {
    last_utime_ = utime;
    has_time_ = true;
    has_older_ = false;
    num_pending_ = 0;
  }
  num_torn_ = verdict == FrameVerdict::kTorn ? num_torn_ + 1 : 0;
  if (verdict == FrameVerdict::kGood) {
    std::swap(rows_, last_rows_);
    has_rows_ = true;
  }
  return verdict;
}

FrameVerdict FrameGate::Judge(const ImageView& image, Utime utime) noexcept {
  const bool is_image = image.data != nullptr && (image.channels == 1 || image.channels == 3) &&
                        image.stride_bytes >= image.width * image.channels;
  if (!is_image) return FrameVerdict::kNoImage;
  if (image.width != width_ || image.height != height_) return FrameVerdict::kWrongSize;
  const FrameVerdict time = JudgeTime(utime);
  return time == FrameVerdict::kGood ? JudgeContents(image) : time;
}

FrameVerdict FrameGate::JudgeTime(Utime utime) noexcept {
  if (!IsTime(utime)) return FrameVerdict::kFromTheFuture;
  if (has_time_ && utime == last_utime_) return FrameVerdict::kRepeatedTime;
  if (has_time_ && utime < last_utime_) return JudgeOlder(utime);
  const bool is_known = has_time_ || has_seen_;
  const bool is_near = (has_time_ && utime - last_utime_ <= max_gap_us_) ||
                       (has_seen_ && utime <= newest_seen_ + max_gap_us_);
  if (!is_known || is_near) return FrameVerdict::kGood;
  const bool goes_on =
      num_pending_ > 0 && utime > pending_utime_ && utime - pending_utime_ <= max_gap_us_;
  num_pending_ = goes_on ? num_pending_ + 1 : 1;
  pending_utime_ = utime;
  return num_pending_ >= options_.images_that_confirm ? FrameVerdict::kGood
                                                      : FrameVerdict::kFromTheFuture;
}

// Late images are few, or stand among good ones.
FrameVerdict FrameGate::JudgeOlder(Utime utime) noexcept {
  const bool goes_on = has_older_ && utime > older_utime_ && utime - older_utime_ <= max_gap_us_;
  if (!goes_on) older_since_ = utime;
  older_utime_ = utime;
  has_older_ = true;
  return utime - older_since_ >= back_us_ ? FrameVerdict::kGood : FrameVerdict::kOutOfOrder;
}

FrameVerdict FrameGate::JudgeContents(const ImageView& image) noexcept {
  const auto [low, high] = GreyRange(image);
  if (high < kBlackBelow) return FrameVerdict::kBlack;
  if (low >= kWhiteFrom) return FrameVerdict::kWhite;
  if (high - low < kFlatBelow) return FrameVerdict::kFlat;
  TakeRows(image);
  if (has_rows_) {
    int same = 0;
    for (std::size_t y = 0; y < rows_.size(); ++y) same += rows_[y].hash == last_rows_[y].hash;
    if (same == height_) return FrameVerdict::kDuplicate;
    if (num_torn_ < options_.torn_that_confirm && IsTorn(image)) return FrameVerdict::kTorn;
  }
  return FrameVerdict::kGood;
}

void FrameGate::TakeRows(const ImageView& image) noexcept {
  const auto bytes = static_cast<std::size_t>(image.width * image.channels);
  const auto pixel = static_cast<std::size_t>(image.channels);
  for (int y = 0; y < height_; ++y) {
    const std::uint8_t* row = image.data + static_cast<std::ptrdiff_t>(y) * image.stride_bytes;
    rows_[static_cast<std::size_t>(y)] = {HashOf(row, bytes),
                                          std::memcmp(row, row + pixel, bytes - pixel) == 0};
  }
}

// A block of rows at the top or bottom that is one colour, and was not in the last good image, or
// that is the last good image's, with texture in it.
bool FrameGate::IsTorn(const ImageView& image) noexcept {
  const auto is_bad = [&](int y) {
    const Row &row = rows_[static_cast<std::size_t>(y)],
              &last = last_rows_[static_cast<std::size_t>(y)];
    if (row.is_uniform) return !last.is_uniform;
    if (row.hash != last.hash) return false;
    const std::uint8_t* pixels = image.data + static_cast<std::ptrdiff_t>(y) * image.stride_bytes;
    int steps = 0;
    for (int i = image.channels; i < width_ * image.channels; ++i)
      steps += std::abs(pixels[i] - pixels[i - image.channels]);
    return steps >= kMinRowTexture * width_ * image.channels;
  };
  int top = 0, bottom = 0;
  while (top < height_ && is_bad(top)) ++top;
  while (bottom < height_ && is_bad(height_ - 1 - bottom)) ++bottom;
  return kTornPart * std::max(top, bottom) >= height_;
}

}  // namespace rsfm
