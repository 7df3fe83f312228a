#include "rsfm/mapping/map.h"

#include <algorithm>
#include <cstring>

namespace rsfm {
namespace {

std::size_t PoolSize(const MapperOptions& options) {
  return static_cast<std::size_t>(options.max_keyframes) *
         static_cast<std::size_t>(options.max_features);
}

}  // namespace

Map::Map(const MapperOptions& options)
    : max_features_(static_cast<std::size_t>(options.max_features)),
      type_(options.descriptor),
      keyframes_(static_cast<std::size_t>(options.max_keyframes)),
      landmarks_(static_cast<std::size_t>(options.max_landmarks)),
      order_(static_cast<std::size_t>(options.max_keyframes)),
      features_(PoolSize(options)),
      landmark_of_(PoolSize(options)),
      descriptors_(PoolSize(options) *
                   static_cast<std::size_t>(DescriptorStride(options.descriptor))) {
  features_.TryResize(features_.capacity());
  landmark_of_.TryResize(landmark_of_.capacity());
  descriptors_.TryResize(descriptors_.capacity());
}

std::size_t Map::keyframe_bytes() const {
  return keyframes_.bytes() + order_.bytes() + features_.bytes() + landmark_of_.bytes() +
         descriptors_.bytes();
}

std::optional<SlotId> Map::AddKeyframe(const FrameObservations& frame, const Keyframe& keyframe) {
  const std::optional<SlotId> id = keyframes_.TryInsert(keyframe);
  if (!id) return std::nullopt;
  order_.TryPushBack(*id);
  const std::size_t count = std::min(frame.features.size(), max_features_);
  Keyframe& stored = *keyframes_.Find(*id);
  stored.utime = frame.utime;
  stored.num_features = static_cast<int>(count);
  stored.num_landmarks = 0;
  std::copy_n(frame.features.begin(), count, features_.begin() + First(*id));
  std::fill_n(landmark_of_.begin() + First(*id), count, SlotId{});
  const auto stride = static_cast<std::size_t>(DescriptorStride(type_));
  if (frame.descriptors.type == type_ && frame.descriptors.count >= stored.num_features) {
    std::memcpy(descriptors_.data() + First(*id) * stride, frame.descriptors.data, count * stride);
  } else {
    std::memset(descriptors_.data() + First(*id) * stride, 0, count * stride);
  }
  return id;
}

std::optional<SlotId> Map::InsertBeforeNewest(const FrameObservations& frame,
                                              const Keyframe& keyframe) {
  const std::optional<SlotId> id = AddKeyframe(frame, keyframe);
  if (id) std::swap(order_[order_.size() - 2], order_[order_.size() - 1]);
  return id;
}

void Map::EraseKeyframe(SlotId id) {
  if (!keyframes_.Contains(id)) return;
  for (const SlotId landmark : landmarks_of(id)) {
    const Landmark* seen = landmarks_.Find(landmark);
    if (seen == nullptr) continue;
    if (seen->observations.size() <= 1) {
      EraseLandmark(landmark);
    } else {
      Unobserve(landmark, id);
    }
  }
  const auto place = std::find(order_.begin(), order_.end(), id);
  std::move(place + 1, order_.end(), place);
  order_.pop_back();
  keyframes_.Erase(id);
}

std::span<const Feature> Map::features(SlotId id) const {
  return {features_.data() + First(id), static_cast<std::size_t>(keyframe(id).num_features)};
}

DescriptorView Map::descriptors(SlotId id) const {
  const auto stride = static_cast<std::size_t>(DescriptorStride(type_));
  return {descriptors_.data() + First(id) * stride, keyframe(id).num_features, type_};
}

std::span<const SlotId> Map::landmarks_of(SlotId id) const {
  return {landmark_of_.data() + First(id), static_cast<std::size_t>(keyframe(id).num_features)};
}

SlotId Map::AddLandmark(const Vec3& point_in_world, const Feature& feature) {
  Landmark landmark;
  landmark.id = next_landmark_id_;
  landmark.point_in_world = point_in_world;
  landmark.r = feature.r;
  landmark.g = feature.g;
  landmark.b = feature.b;
  const std::optional<SlotId> id = landmarks_.TryInsert(landmark);
  if (!id) return SlotId{};
  ++next_landmark_id_;
  return *id;
}

void Map::EraseLandmark(SlotId id) {
  const Landmark* landmark = landmarks_.Find(id);
  if (landmark == nullptr) return;
  for (const Observation& observation : landmark->observations) {
    landmark_of_[First(observation.keyframe) + static_cast<std::size_t>(observation.feature)] = {};
    --keyframe(observation.keyframe).num_landmarks;
  }
  landmarks_.Erase(id);
}

bool Map::Observe(SlotId landmark_id, SlotId keyframe_id, int feature) {
  Landmark* landmark = landmarks_.Find(landmark_id);
  SlotId& link = landmark_of_[First(keyframe_id) + static_cast<std::size_t>(feature)];
  if (landmark == nullptr || landmarks_.Contains(link)) return false;
  for (const Observation& observation : landmark->observations) {
    if (observation.keyframe == keyframe_id) return false;
  }
  if (landmark->observations.full()) Unobserve(landmark_id, landmark->observations[0].keyframe);
  landmark->observations.TryPushBack({keyframe_id, feature});
  link = landmark_id;
  ++keyframe(keyframe_id).num_landmarks;
  return true;
}

void Map::Unobserve(SlotId landmark_id, SlotId keyframe_id) {
  Landmark* landmark = landmarks_.Find(landmark_id);
  if (landmark == nullptr) return;
  auto& observations = landmark->observations;
  const auto found = std::find_if(observations.begin(), observations.end(),
                                  [&](const auto& o) { return o.keyframe == keyframe_id; });
  if (found == observations.end()) return;
  landmark_of_[First(keyframe_id) + static_cast<std::size_t>(found->feature)] = {};
  --keyframe(keyframe_id).num_landmarks;
  std::move(found + 1, observations.end(), found);
  observations.pop_back();
}

void Map::Merge(SlotId from, SlotId into) {
  const Landmark* source = landmarks_.Find(from);
  if (source == nullptr || !landmarks_.Contains(into) || from == into) return;
  const auto observations = source->observations;
  Landmark* target = landmarks_.Find(into);
  target->fresh_from = std::max(target->fresh_from, source->fresh_from);
  EraseLandmark(from);
  for (const Observation& observation : observations)
    Observe(into, observation.keyframe, observation.feature);
}

void Map::Clear() {
  keyframes_.Clear();
  landmarks_.Clear();
  order_.clear();
}

}  // namespace rsfm
