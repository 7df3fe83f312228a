// Points followed from image to image: forward by pyramidal Lucas-Kanade, and back again; what does
// not return where it came from is dropped [Kalal 2010, ICPR]. Fixed memory.
//
// Pixels here have the centre of the top-left pixel at (0, 0).
#pragma once

#include <cstdint>
#include <span>

#include "rsfm/base/linear.h"
#include "rsfm/mapping/mapper_options.h"
#include "rsfm/mapping/patch_tracker.h"

namespace rsfm {

struct TrackedPoint {
  PatchPlace place, before;  // in the newest image; in the one before, or the same if it is new
  PatchPlace at_keyframe;
  std::uint32_t track = 0;
  std::int32_t age = 0;  // images it has been followed through
};

class PointTracker {
 public:
  // The only place that allocates.
  PointTracker(const MapperOptions& options, int width_px, int height_px, int max_points);

  // The next image, of the size given above: points are followed into it. Where one is expected is
  // expected_px (the centre of the top-left pixel at (0.5, 0.5)), one for every point, or where its
  // own last motion leads.
  void Follow(const std::uint8_t* grey, int stride_bytes,
              std::span<const Vec2> expected_px) noexcept;
  // Forgets all points.
  void Clear() noexcept { points_.clear(); }
  // A new point of the newest image. False when full.
  bool Add(PatchPlace place) noexcept;

  // In ascending order of track; dropping is done by compacting in place.
  FixedVector<TrackedPoint>& points() { return points_; }
  const FixedVector<TrackedPoint>& points() const { return points_; }
  const ImagePyramid& image() const { return newest_; }
  std::size_t bytes() const {
    return points_.bytes() + tracker_.bytes() + newest_.bytes() + before_.bytes();
  }

 private:
  bool FollowFrom(PatchPlace start, PatchPlace expected, int top_level, PatchPlace* found) noexcept;
  PatchPlace MedianMotion() noexcept;

  float check_px_;
  PatchTracker tracker_;
  ImagePyramid newest_, before_;
  bool has_image_ = false;
  FixedVector<TrackedPoint> points_;
  FixedVector<float> motions_;
  std::uint32_t next_track_ = 0;
};

}  // namespace rsfm
