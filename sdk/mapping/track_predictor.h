// Where the points of one image are expected in the next, given the pose that is expected there:
// landmarks by refractive projection, other points as if they were as far away as the landmarks
// are. Fixed memory.
#pragma once

#include <span>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/mapping/map.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

class TrackPredictor {
 public:
  // The only place that allocates.
  explicit TrackPredictor(int max_features);

  // The features of an image, in ascending order of track, as the front end handed them out.
  void Remember(std::span<const Feature> features) noexcept;
  // A pixel for each of them, not finite where nothing can be said; empty where fewer than ten are
  // landmarks of the newest placed keyframe. The poses are those of that image and of the next.
  std::span<const Vec2> Predict(const Map& map, const AnyCamera& camera,
                                const Rigid3& camera_from_world,
                                const Rigid3& next_from_world) noexcept;

  std::size_t bytes() const { return features_.bytes() + expected_.bytes() + ranges_.bytes(); }

 private:
  int ProjectLandmarks(const Map& map, SlotId keyframe, const AnyCamera& camera,
                       const Rigid3& camera_from_world, const Rigid3& next_from_world) noexcept;

  FixedVector<Feature> features_;
  FixedVector<Vec2> expected_;
  FixedVector<double> ranges_;  // of the landmarks, from the camera
};

}  // namespace rsfm
