// Whether an image may go on to the front end: its time, its size, and whether it shows anything.
// What is refused is counted by reason and changes nothing else. Fixed memory.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/base/time.h"
#include "rsfm/mapping/feature.h"

namespace rsfm {

enum class FrameVerdict : std::uint8_t {
  kGood,
  // Not to be used at all.
  kNoImage,        // no data, a number of channels that is neither 1 nor 3, rows that overlap
  kWrongSize,      // not the camera's
  kRepeatedTime,   // that of the image before
  kOutOfOrder,     // older than the image before
  kFromTheFuture,  // ahead of all that is known of the time by more than max_gap_s
  // Taken at its time, but it shows nothing of the scene: an image without features.
  kBlack,
  kWhite,
  kFlat,       // one grey all over
  kTorn,       // a part of it was never filled, or is that of the image before
  kDuplicate,  // to the last bit the image before
};
inline constexpr int kNumFrameVerdicts = 11;

// "good", "no image", "wrong size", …
std::string_view ToString(FrameVerdict verdict) noexcept;
constexpr bool IsTimeGood(FrameVerdict verdict) noexcept {
  return verdict == FrameVerdict::kGood || verdict >= FrameVerdict::kBlack;
}

struct FrameGateOptions {
  // A time so far ahead of the image before, and of navigation, is believed only when the images
  // that follow go on from it.
  double max_gap_s = 60.0;
  int images_that_confirm = 3;  // of such a time, itself included
  int torn_that_confirm = 8;    // so many in a row: this is how the camera sees now
  // Images that are older than the last good one, one after the other over that long: the camera's
  // clock was set back.
  double back_that_confirms_s = 5.0;
};

class FrameGate {
 public:
  // The only place that allocates.
  FrameGate(int width_px, int height_px, const FrameGateOptions& options = {});

  // Something else is known to be of that time, navigation or the end of a list: an image of about
  // then is not from the future.
  void SeeTime(Utime utime) noexcept;
  // Judges and counts the next image. Those that are good become the image before.
  FrameVerdict Check(const ImageView& image, Utime utime) noexcept;

  // That image is older than one before: it was taken because the clock was set back.
  bool was_set_back() const { return was_set_back_; }

  std::int64_t count(FrameVerdict verdict) const { return counts_[static_cast<int>(verdict)]; }
  std::size_t bytes() const { return last_rows_.bytes() + rows_.bytes(); }

 private:
  struct Row {
    std::uint64_t hash = 0;
    bool is_uniform = false;
  };
  FrameVerdict Judge(const ImageView& image, Utime utime) noexcept;
  FrameVerdict JudgeTime(Utime utime) noexcept;
  FrameVerdict JudgeOlder(Utime utime) noexcept;
  FrameVerdict JudgeContents(const ImageView& image) noexcept;
  void TakeRows(const ImageView& image) noexcept;
  bool IsTorn(const ImageView& image) noexcept;

  int width_, height_;
  FrameGateOptions options_;
  Utime max_gap_us_, back_us_;
  Utime last_utime_ = 0, newest_seen_ = 0, pending_utime_ = 0;
  Utime older_utime_ = 0, older_since_ = 0;
  bool has_time_ = false, has_seen_ = false, has_rows_ = false, has_older_ = false;
  bool was_set_back_ = false;
  int num_pending_ = 0, num_torn_ = 0;
  FixedVector<Row> rows_, last_rows_;  // of this image, of the last good one
  std::array<std::int64_t, kNumFrameVerdicts> counts_{};
};

}  // namespace rsfm
