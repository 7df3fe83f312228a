// The map in fixed memory: keyframes with their features and descriptors, landmarks with their
// observations, and the links between them, which are kept consistent here and nowhere else.
#pragma once

#include <optional>
#include <span>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/base/slot_map.h"
#include "rsfm/base/static_vector.h"
#include "rsfm/mapping/feature.h"
#include "rsfm/navigation/nav_sample.h"

namespace rsfm {

// The most keyframes one landmark remembers; the oldest is forgotten for a new one.
inline constexpr int kMaxObservations = 24;

struct Observation {
  SlotId keyframe;
  std::int32_t feature = -1;
};

struct Landmark {
  std::int32_t id = -1;  // counts up from 0, never reused
  Vec3 point_in_world = Vec3::Zero();
  StaticVector<Observation, kMaxObservations> observations;  // oldest first, one per keyframe
  // Observations of keyframes before this one (by id) are summed up in the window's prior.
  std::int32_t fresh_from = 0;
  std::uint8_t r = 128, g = 128, b = 128;
  bool is_changed = true;  // new or moved since the owner last cleared this
};

struct Keyframe {
  std::int32_t id = -1;  // counts up from 0, never reused
  Utime utime = 0;
  bool is_placed = false;          // the pose means something
  Rigid3 camera_from_world;        // metres
  Mat6 covariance = Mat6::Zero();  // of the left perturbation (rotation, translation)
  NavSample nav;                   // at utime; what navigation had
  int num_features = 0;
  int num_landmarks = 0;  // features linked to a landmark
  int world = 0;          // StepReport's
};

class Map {
 public:
  // The only place that allocates.
  explicit Map(const MapperOptions& options);

  // Copies features and descriptors; nullopt when full. Features beyond the capacity are left out.
  std::optional<SlotId> AddKeyframe(const FrameObservations& frame, const Keyframe& keyframe);
  // The same, as the last but one in the order: a keyframe that comes back is older than the frame
  // that it comes back for. Precondition: there is one.
  std::optional<SlotId> InsertBeforeNewest(const FrameObservations& frame,
                                           const Keyframe& keyframe);
  // With its observations; landmarks that are left with none go too.
  void EraseKeyframe(SlotId id);

  Keyframe& keyframe(SlotId id) { return *keyframes_.Find(id); }
  const Keyframe& keyframe(SlotId id) const { return *keyframes_.Find(id); }
  bool Contains(SlotId keyframe) const { return keyframes_.Contains(keyframe); }
  std::span<const SlotId> keyframes() const { return order_.span(); }  // oldest first
  std::size_t keyframe_capacity() const { return keyframes_.capacity(); }

  std::span<const Feature> features(SlotId keyframe) const;
  DescriptorView descriptors(SlotId keyframe) const;
  // Of each feature; none or stale handles where there is none: ask landmarks().Find().
  std::span<const SlotId> landmarks_of(SlotId keyframe) const;

  // kNone when full.
  SlotId AddLandmark(const Vec3& point_in_world, const Feature& feature);
  void EraseLandmark(SlotId id);
  const SlotMap<Landmark>& landmarks() const { return landmarks_; }
  SlotMap<Landmark>& landmarks() { return landmarks_; }

  // Links a feature to a landmark. False, and nothing changes, when the feature has a landmark or
  // the landmark is already seen in that keyframe.
  bool Observe(SlotId landmark, SlotId keyframe, int feature);
  void Unobserve(SlotId landmark, SlotId keyframe);
  // All of `from`'s observations that `into` has not, then erases `from`.
  void Merge(SlotId from, SlotId into);

  void Clear();
  std::size_t keyframe_bytes() const;
  std::size_t landmark_bytes() const { return landmarks_.bytes(); }

 private:
  std::size_t First(SlotId keyframe) const { return keyframe.index * max_features_; }

  std::size_t max_features_;
  DescriptorType type_;
  SlotMap<Keyframe> keyframes_;
  SlotMap<Landmark> landmarks_;
  FixedVector<SlotId> order_;
  FixedVector<Feature> features_;          // of keyframe slot k from k * max_features_
  FixedVector<SlotId> landmark_of_;        // likewise
  FixedVector<std::uint8_t> descriptors_;  // likewise, DescriptorStride apart
  std::int32_t next_landmark_id_ = 0;
};

}  // namespace rsfm
