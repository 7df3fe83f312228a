#include "rsfm/mapping/place_archive.h"

#include <algorithm>

namespace rsfm {
namespace {

constexpr int kMinObservations = 3;  // of a landmark that a place keeps
constexpr int kMinFeatures = 40;     // of a place
constexpr int kMinMatches = 15;
constexpr int kFirstLook = 32;          // features of a place, its strongest
constexpr int kFirstLookOfFrame = 300;  // features of a frame, likewise

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

}  // namespace

double RangeOf(const Map& map, SlotId id) {
  StaticVector<double, 64> ranges;
  for (const SlotId landmark : map.landmarks_of(id)) {
    const Landmark* point = map.landmarks().Find(landmark);
    if (point == nullptr) continue;
    if (!ranges.TryPushBack((map.keyframe(id).camera_from_world * point->point_in_world).norm()))
      break;
  }
  if (ranges.size() < 8) return 0.0;
  const auto middle = ranges.begin() + static_cast<std::ptrdiff_t>(ranges.size() / 2);
  std::nth_element(ranges.begin(), middle, ranges.end());
  return *middle;
}

PlaceArchive::PlaceArchive(const MapperOptions& options, const AnyCamera& camera)
    : options_(options),
      camera_(camera),
      matcher_(options.max_places > 0 ? std::max(options.max_features, int{kFeatures}) : 1),
      estimator_(options.max_places > 0 ? kFeatures : 1),
      places_(Count(options.max_places)),
      free_slots_(Count(options.max_places)),
      points_(Count(options.max_places) * kFeatures),
      features_(Count(options.max_places) * kFeatures),
      descriptors_(Count(options.max_places) * kFeatures *
                   Count(DescriptorStride(options.descriptor))),
      matches_(kFeatures),
      pixels_(kFeatures),
      matched_points_(kFeatures) {
  points_.TryResizeForOverwrite(points_.capacity());
  features_.TryResize(features_.capacity());
  descriptors_.TryResize(descriptors_.capacity());
  matches_.TryResize(matches_.capacity());
  Clear();
}

std::size_t PlaceArchive::bytes() const {
  return matcher_.bytes() + estimator_.bytes() + places_.bytes() + free_slots_.bytes() +
         points_.bytes() + features_.bytes() + descriptors_.bytes() + matches_.bytes() +
         pixels_.bytes() + matched_points_.bytes();
}

void PlaceArchive::Clear() noexcept {
  places_.clear();
  free_slots_.clear();
  for (std::size_t slot = free_slots_.capacity(); slot-- > 0;) free_slots_.TryPushBack(slot);
}

void PlaceArchive::ThinOut() noexcept {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (i % 2 == 1) {
      free_slots_.TryPushBack(places_[i].slot);
    } else {
      places_[kept++] = places_[i];
    }
  }
  places_.TryResizeForOverwrite(kept);
}

void PlaceArchive::DropNodesBefore(int node) noexcept {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    Place place = places_[i];
    place.node -= node;
    if (place.node < 0) {
      free_slots_.TryPushBack(place.slot);
    } else {
      places_[kept++] = place;
    }
  }
  places_.TryResizeForOverwrite(kept);
}

DescriptorView PlaceArchive::Descriptors(const Place& place) const {
  const auto stride = Count(DescriptorStride(options_.descriptor));
  return {descriptors_.data() + place.slot * kFeatures * stride, place.num_features,
          options_.descriptor};
}

bool PlaceArchive::Keep(const Map& map, SlotId id, int node) noexcept {
  if (free_slots_.empty()) return false;
  const Keyframe& keyframe = map.keyframe(id);
  Place place{node, keyframe.id,       keyframe.utime, RangeOf(map, id), keyframe.covariance,
              0,    free_slots_.back()};
  const DescriptorView rows = map.descriptors(id);
  const auto stride = Count(DescriptorStride(options_.descriptor));
  const std::span<const SlotId> landmarks = map.landmarks_of(id);
  for (std::size_t i = 0; i < landmarks.size() && place.num_features < kFeatures; ++i) {
    const Landmark* landmark = map.landmarks().Find(landmarks[i]);
    if (landmark == nullptr || landmark->observations.size() < kMinObservations) continue;
    const std::size_t k = place.slot * kFeatures + Count(place.num_features++);
    points_[k] = keyframe.camera_from_world * landmark->point_in_world;
    features_[k] = map.features(id)[i];
    features_[k].track = kNoTrack;
    std::copy_n(rows.Row(static_cast<int>(i)), stride, descriptors_.data() + k * stride);
  }
  if (place.num_features < kMinFeatures || !places_.TryPushBack(place)) return false;
  free_slots_.pop_back();
  return true;
}

std::optional<PlaceArchive::Sighting> PlaceArchive::Match(const FrameView& frame,
                                                          const Place& place,
                                                          std::uint64_t seed) noexcept {
  const int count =
      matcher_.Match(Descriptors(place), frame.descriptors, options_.max_ratio, matches_.span());
  if (count < kMinMatches) return std::nullopt;
  pixels_.clear();
  matched_points_.clear();
  for (int i = 0; i < count; ++i) {
    const DescriptorMatch& match = matches_[Count(i)];
    pixels_.TryPushBack(frame.features[Count(match.train)].pixel());
    matched_points_.TryPushBack(points_[place.slot * kFeatures + Count(match.query)]);
  }
  AbsolutePoseOptions options;
  options.ransac.max_error_px = options_.max_error_px;
  options.ransac.max_iterations = options_.ransac_iterations;
  options.ransac.seed = seed;
  options.min_inliers = std::max(kMinMatches, count / 4);
  const auto found = estimator_.Estimate(camera_, pixels_.span(), matched_points_.span(), options);
  if (!found) return std::nullopt;
  return Sighting{found->camera_from_world, found->covariance, found->num_inliers};
}

int PlaceArchive::Similarity(const FrameView& frame, const Place& place) noexcept {
  DescriptorView known = Descriptors(place), seen = frame.descriptors;
  known.count = std::min(known.count, kFirstLook);
  seen.count = std::min(seen.count, kFirstLookOfFrame);
  return matcher_.Match(known, seen, options_.max_ratio, matches_.span());
}

std::optional<SlotId> PlaceArchive::Restore(const Place& place, const Rigid3& camera_from_world,
                                            int world, Map* map) const noexcept {
  const std::span<const Feature> features =
      features_.span().subspan(place.slot * kFeatures, Count(place.num_features));
  Keyframe keyframe;
  keyframe.id = place.keyframe_id;
  keyframe.is_placed = true;
  keyframe.camera_from_world = camera_from_world;
  keyframe.covariance = place.covariance;
  keyframe.world = world;
  const auto id = map->InsertBeforeNewest({place.utime, features, Descriptors(place)}, keyframe);
  if (!id) return std::nullopt;
  const Rigid3 world_from_camera = camera_from_world.Inverse();
  for (std::size_t i = 0; i < features.size(); ++i) {
    const Vec3 point_in_world = world_from_camera * points_[place.slot * kFeatures + i];
    const SlotId landmark = map->AddLandmark(point_in_world, features[i]);
    if (landmark.valid()) map->Observe(landmark, *id, static_cast<int>(i));
  }
  return id;
}

}  // namespace rsfm
