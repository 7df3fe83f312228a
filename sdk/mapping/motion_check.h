// Points that do not move with the scene: what is fixed to the camera (a burnt-in text, dirt on the
// port, a part of the vehicle), and what drifts by itself ("marine snow"). Fixed memory.
#pragma once

#include <cstdint>
#include <span>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/base/linear.h"
#include "rsfm/base/rng.h"
#include "rsfm/mapping/point_tracker.h"

namespace rsfm {

enum class PointVerdict : std::uint8_t { kScene, kStationary, kDrifting };

class MotionCheck {
 public:
  // The only place that allocates.
  explicit MotionCheck(int max_points);

  // Judges every point; verdicts.size() is points.size().
  //
  // Stationary: since the keyframe the scene has moved, an affine map fits the greater part of it,
  // and where the map sends the point 6 px away or more it has not moved by a pixel, or a tenth of
  // that. Where the map has a fixed point (an approach's goal, a turn's centre) none is stationary.
  //
  // Drifting: its motion from the image before breaks the epipolar constraint that most motions
  // obey [Hartley 1997, PAMI, "In defense of the eight-point algorithm"], by three times what
  // tracking and refraction make. Nothing is said where the images lie too near together, or where
  // no constraint holds for most.
  void Judge(std::span<const TrackedPoint> points, std::uint64_t seed,
             std::span<PointVerdict> verdicts) noexcept;

  std::size_t bytes() const { return motions_.bytes() + moving_.bytes() + errors_.bytes(); }

 private:
  void FindStationary(std::span<const TrackedPoint> points, Rng* rng,
                      std::span<PointVerdict> verdicts) noexcept;
  void FindDrifting(std::span<const TrackedPoint> points, Rng* rng,
                    std::span<PointVerdict> verdicts) noexcept;

  struct Motion {
    Vec2 from, to;
    int point;
  };
  bool FitAffine(Rng* rng, Mat23* to_from_from) const noexcept;
  bool FitEpipolar(Rng* rng, double max_error_px, Mat3* fundamental) noexcept;
  int CountWithin(const Mat3& fundamental, double max_error_px) noexcept;

  FixedVector<Motion> motions_, moving_;
  FixedVector<double> errors_;
};

}  // namespace rsfm
