#include "rsfm/mapping/frame_placer.h"

#include <algorithm>
#include <limits>

namespace rsfm {
namespace {

constexpr int kSimilarityFeatures = 300;  // of each image, for the first look
constexpr std::int32_t kFar = std::numeric_limits<std::int32_t>::max();

std::size_t Count(int value) { return static_cast<std::size_t>(std::max(value, 0)); }

}  // namespace

FramePlacer::FramePlacer(const MapperOptions& options, const AnyCamera& camera)
    : options_(options),
      camera_(camera),
      matcher_(options.max_features),
      grid_(camera.width(), camera.height(), 32, options.max_features),
      estimator_(static_cast<std::uint32_t>(Count(options.max_features))),
      match_pool_(Count(options.max_features) *
                  Count(options.match_keyframes + options.relocalise_keyframes)),
      keyframe_matches_(Count(options.match_keyframes + options.relocalise_keyframes)),
      landmark_of_(Count(options.max_features)),
      distance_of_(Count(options.max_features)),
      is_taken_(Count(options.max_landmarks)),
      shared_(Count(options.max_keyframes)),
      pixels_(Count(options.max_features)),
      points_(Count(options.max_features)),
      feature_of_pair_(Count(options.max_features)),
      similar_(Count(options.max_keyframes)),
      similarity_(Count(options.max_keyframes)) {
  match_pool_.TryResize(match_pool_.capacity());
  is_taken_.TryResize(is_taken_.capacity());
  shared_.TryResize(shared_.capacity());
}

std::size_t FramePlacer::bytes() const {
  return matcher_.bytes() + grid_.bytes() + estimator_.bytes() + match_pool_.bytes() +
         keyframe_matches_.bytes() + landmark_of_.bytes() + distance_of_.bytes() +
         is_taken_.bytes() + shared_.bytes() + pixels_.bytes() + points_.bytes() +
         feature_of_pair_.bytes() + similar_.bytes() + similarity_.bytes();
}

void FramePlacer::MatchTracks(std::span<const Feature> frame, std::span<const Feature> keyframe,
                              std::span<DescriptorMatch> matches, int* count) const {
  // Both are in ascending order of track: one pass.
  std::size_t i = 0, j = 0;
  while (i < frame.size() && j < keyframe.size() && Count(*count) < matches.size()) {
    const std::uint32_t a = frame[i].track, b = keyframe[j].track;
    if (a == kNoTrack || b == kNoTrack) return;
    if (a == b) {
      matches[Count((*count)++)] = {static_cast<std::int32_t>(i), static_cast<std::int32_t>(j), 0};
    }
    if (a <= b) ++i;
    if (b <= a) ++j;
  }
}

void FramePlacer::MatchWith(const Map& map, const FrameView& frame,
                            std::span<const SlotId> keyframes) {
  keyframe_matches_.clear();
  std::size_t used = 0;
  for (const SlotId keyframe : keyframes) {
    if (keyframe_matches_.full()) break;
    const auto room = match_pool_.span().subspan(used);
    int count = 0;
    MatchTracks(frame.features, map.features(keyframe), room, &count);
    if (count == 0 && frame.descriptors.count > 0)
      count =
          matcher_.Match(frame.descriptors, map.descriptors(keyframe), options_.max_ratio, room);
    keyframe_matches_.TryPushBack({keyframe, room.first(Count(count))});
    used += Count(count);
  }
}

void FramePlacer::StartAssociations(std::size_t num_features) {
  landmark_of_.clear();
  landmark_of_.TryResize(num_features);
  distance_of_.TryResize(num_features);
  std::fill(distance_of_.begin(), distance_of_.end(), kFar);
}

void FramePlacer::Associate(const Map& map, const FrameView& frame,
                            const Rigid3& camera_from_world) noexcept {
  StartAssociations(frame.features.size());
  AssociateByProjection(map, frame, camera_from_world, options_.max_error_px);
}

void FramePlacer::AssociateByMatches(const Map& map, const FrameView& frame) {
  StartAssociations(frame.features.size());
  for (const KeyframeMatches& with : keyframe_matches_) {
    const std::span<const SlotId> landmarks = map.landmarks_of(with.keyframe);
    for (const DescriptorMatch& match : with.matches) {
      const SlotId landmark = landmarks[Count(match.train)];
      if (!map.landmarks().Contains(landmark)) continue;
      if (match.distance >= distance_of_[Count(match.query)]) continue;
      landmark_of_[Count(match.query)] = landmark;
      distance_of_[Count(match.query)] = match.distance;
    }
  }
}

// The nearest descriptor near each landmark's projection; where two landmarks want one feature the
// more similar one gets it. Returns how many features have a landmark.
int FramePlacer::AssociateByProjection(const Map& map, const FrameView& frame,
                                       const Rigid3& camera_from_world, double radius_px) noexcept {
  grid_.Build(frame.features);
  std::fill(is_taken_.begin(), is_taken_.end(), std::uint8_t{0});
  for (const SlotId landmark : landmark_of_) {
    if (landmark.valid()) is_taken_[landmark.index] = 1;
  }
  const DescriptorType type = frame.descriptors.type;
  map.landmarks().ForEach([&](SlotId id, const Landmark& landmark) {
    if (is_taken_[id.index] || landmark.observations.empty()) return;
    Vec2 pixel;
    const Vec3 point_in_camera = camera_from_world * landmark.point_in_world;
    if (camera_.Project(point_in_camera, &pixel) != Projection::kOk || !camera_.IsInImage(pixel))
      return;
    const Observation& last = landmark.observations.back();
    const std::uint8_t* descriptor = map.descriptors(last.keyframe).Row(last.feature);
    const float size = map.features(last.keyframe)[Count(last.feature)].size_px;
    std::int32_t best = kFar, second = kFar, best_feature = -1;
    grid_.ForEachNear(pixel, radius_px, [&](int i) {
      const float ratio = frame.features[Count(i)].size_px / size;
      if (ratio > 2.5f || ratio < 0.4f) return;
      const std::int32_t distance = DescriptorDistance(type, descriptor, frame.descriptors.Row(i));
      if (distance < best) {
        second = best;
        best = distance;
        best_feature = i;
      } else if (distance < second) {
        second = distance;
      }
    });
    if (best_feature < 0 || best > MaxDescriptorDistance(type)) return;
    if (!PassesRatio(type, best, second, options_.max_ratio)) return;
    if (best >= distance_of_[Count(best_feature)]) return;
    landmark_of_[Count(best_feature)] = id;
    distance_of_[Count(best_feature)] = best;
  });
  return static_cast<int>(std::count_if(landmark_of_.begin(), landmark_of_.end(),
                                        [](SlotId id) { return id.valid(); }));
}

Expected<Placement> FramePlacer::Estimate(const Map& map, const FrameView& frame,
                                          const Rigid3* start, std::uint64_t seed) noexcept {
  pixels_.clear();
  points_.clear();
  feature_of_pair_.clear();
  for (std::size_t i = 0; i < landmark_of_.size(); ++i) {
    const Landmark* landmark = map.landmarks().Find(landmark_of_[i]);
    if (landmark == nullptr) continue;
    pixels_.TryPushBack(frame.features[i].pixel());
    points_.TryPushBack(landmark->point_in_world);
    feature_of_pair_.TryPushBack(static_cast<int>(i));
  }
  AbsolutePoseOptions options;
  options.ransac.max_error_px = options_.max_error_px;
  options.ransac.max_iterations = options_.ransac_iterations;
  options.ransac.seed = seed;
  options.min_inliers = std::min(options_.min_inliers, 8);
  const auto report =
      start != nullptr ? estimator_.Refine(camera_, pixels_.span(), points_.span(), *start, options)
                       : estimator_.Estimate(camera_, pixels_.span(), points_.span(), options);
  if (!report) return tl::unexpected(report.error());
  const std::span<const std::uint8_t> inliers = estimator_.inlier_mask();
  for (std::size_t k = 0; k < feature_of_pair_.size(); ++k) {
    if (inliers[k]) continue;
    landmark_of_[Count(feature_of_pair_[k])] = {};
    distance_of_[Count(feature_of_pair_[k])] = kFar;
  }
  return Placement{report->camera_from_world, report->covariance, report->num_inliers,
                   MostShared(map)};
}

// Looks again where the first pose projects all landmarks of the map, and refines on what is found.
Expected<Placement> FramePlacer::Complete(const Map& map, const FrameView& frame,
                                          const Placement& first) noexcept {
  Placement placement = first;
  if (frame.descriptors.count > 0) {
    AssociateByProjection(map, frame, first.camera_from_world, 2.0 * options_.max_error_px);
    const auto refined = Estimate(map, frame, &first.camera_from_world, options_.seed);
    if (!refined) return tl::unexpected(refined.error());
    placement = *refined;
  }
  if (placement.num_inliers < options_.min_inliers)
    return Fail(Errc::kNotEnoughInliers, "inliers", placement.num_inliers);
  return placement;
}

Expected<Placement> FramePlacer::Place(const Map& map, const FrameView& frame,
                                       std::uint64_t seed) noexcept {
  AssociateByMatches(map, frame);
  const auto first = Estimate(map, frame, nullptr, seed);
  if (!first) return tl::unexpected(first.error());
  return Complete(map, frame, *first);
}

Expected<Placement> FramePlacer::PlaceNear(const Map& map, const FrameView& frame,
                                           const Rigid3& camera_from_world, double radius_px,
                                           std::uint64_t seed) noexcept {
  StartAssociations(frame.features.size());
  AssociateByProjection(map, frame, camera_from_world, radius_px);
  const auto first = Estimate(map, frame, nullptr, seed);
  if (!first) return tl::unexpected(first.error());
  return Complete(map, frame, *first);
}

SlotId FramePlacer::MostShared(const Map& map) noexcept {
  std::fill(shared_.begin(), shared_.end(), 0);
  for (const SlotId id : landmark_of_) {
    const Landmark* landmark = map.landmarks().Find(id);
    if (landmark == nullptr) continue;
    for (const Observation& o : landmark->observations) ++shared_[o.keyframe.index];
  }
  SlotId best;
  int best_count = 0;
  for (const SlotId keyframe : map.keyframes()) {
    if (!map.keyframe(keyframe).is_placed || shared_[keyframe.index] < best_count) continue;
    best = keyframe;
    best_count = shared_[keyframe.index];
  }
  return best;
}

int FramePlacer::Similarity(const DescriptorView& a, const DescriptorView& b) noexcept {
  const DescriptorView first{a.data, std::min(a.count, kSimilarityFeatures), a.type};
  const DescriptorView second{b.data, std::min(b.count, kSimilarityFeatures), b.type};
  return matcher_.Match(first, second, options_.max_ratio, match_pool_.span());
}

std::span<const SlotId> FramePlacer::MostSimilar(const Map& map, const FrameView& frame, int count,
                                                 std::span<const SlotId> candidates) noexcept {
  similar_.clear();
  similarity_.clear();
  if (count <= 0) return {};  // looking writes over what matches() says
  for (const SlotId candidate : candidates) {
    const int similarity = Similarity(frame.descriptors, map.descriptors(candidate));
    // Insertion into a list sorted by falling similarity.
    if (!similar_.TryPushBack(candidate)) break;
    similarity_.TryPushBack(similarity);
    for (std::size_t i = similar_.size() - 1; i > 0 && similarity_[i] > similarity_[i - 1]; --i) {
      std::swap(similarity_[i], similarity_[i - 1]);
      std::swap(similar_[i], similar_[i - 1]);
    }
    if (similar_.size() > Count(count)) {
      similar_.pop_back();
      similarity_.pop_back();
    }
  }
  return similar_.span();
}

}  // namespace rsfm
