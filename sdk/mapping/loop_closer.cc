#include "rsfm/mapping/loop_closer.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace rsfm {
namespace {

// What a link may be off by, per root of a metre (and at least the root of a step of 0.1 m).
constexpr double kTilt = 3e-4, kTurn = 1e-3;  // rad
constexpr double kShift = 0.01;               // m
constexpr double kMinStep_m = 0.1;
constexpr int kMinObservations = 3;  // of a landmark that a place keeps
constexpr int kMinFeatures = 40;     // of a place
constexpr int kMinMatches = 15;
constexpr double kSpacing = 0.3;  // of the range, between places
constexpr double kReach = 1.0;    // of the range, plus three sigmas: what is near
// A place's points are not exact, and not independent: the loop's own deviation, at least.
constexpr double kLoopTurn = 2e-3, kLoopShift = 0.01;

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

PoseGraphOptions GraphOptions(const MapperOptions& options) {
  PoseGraphOptions graph;
  graph.max_nodes = options.max_places > 0 ? options.max_way_nodes : 0;
  graph.max_loops = options.max_places > 0 ? options.max_loops : 0;
  return graph;
}

// The median distance of its landmarks, or 0.
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

// Of a left perturbation of camera_from_world, as a turn and a shift along the world's axes.
Mat6 AlongWorld(const Mat6& covariance, const Rigid3& world_from_camera) {
  const Mat3 rotation = world_from_camera.rotation.toRotationMatrix();
  Mat6 turned = Mat6::Zero();
  turned.topLeftCorner<3, 3>() = rotation * covariance.topLeftCorner<3, 3>() * rotation.transpose();
  turned.bottomRightCorner<3, 3>() =
      rotation * covariance.bottomRightCorner<3, 3>() * rotation.transpose();
  return turned;
}

}  // namespace

LoopCloser::LoopCloser(const MapperOptions& options, const AnyCamera& camera)
    : options_(options),
      camera_(camera),
      graph_(GraphOptions(options)),
      matcher_(options.max_places > 0 ? std::max(options.max_features, int{kFeatures}) : 1),
      estimator_(options.max_places > 0 ? kFeatures : 1),
      known_(Count(GraphOptions(options).max_nodes)),
      places_(Count(options.max_places)),
      free_slots_(Count(options.max_places)),
      points_(Count(options.max_places) * kFeatures),
      descriptors_(Count(options.max_places) * kFeatures *
                   Count(DescriptorStride(options.descriptor))),
      matches_(kFeatures),
      pixels_(kFeatures),
      matched_points_(kFeatures) {
  points_.TryResizeForOverwrite(points_.capacity());
  descriptors_.TryResize(descriptors_.capacity());
  matches_.TryResize(matches_.capacity());
  Clear();
}

std::size_t LoopCloser::bytes() const {
  return graph_.bytes() + matcher_.bytes() + estimator_.bytes() + known_.bytes() + places_.bytes() +
         free_slots_.bytes() + points_.bytes() + descriptors_.bytes() + matches_.bytes() +
         pixels_.bytes() + matched_points_.bytes();
}

void LoopCloser::Clear() noexcept {
  graph_.Clear();
  known_.clear();
  places_.clear();
  free_slots_.clear();
  for (std::size_t slot = free_slots_.capacity(); slot-- > 0;) free_slots_.TryPushBack(slot);
  spacing_m_ = 0.0;
}

// As the odometry has it by experience, or as the pose's own covariance grows where that is more:
// through an outage.
Vec6 LoopCloser::LinkVariance(const Keyframe& keyframe, const Rigid3& world_from_camera) noexcept {
  const Mat6 covariance = AlongWorld(keyframe.covariance, world_from_camera);
  Vec6 variance = Vec6::Ones();
  if (graph_.size() > 0) {
    const double step =
        (world_from_camera.translation - graph_.world_from_camera(graph_.size() - 1).translation)
            .norm();
    Vec6 sigma;
    sigma << kTilt, kTilt, kTurn, kShift, kShift, kShift;
    if (!is_ned_) sigma.head<3>().setConstant(kTurn);
    variance = std::max(step, kMinStep_m) * sigma.cwiseAbs2();
    const Vec6 growth = (covariance - last_covariance_).diagonal();
    variance.tail<3>() = variance.tail<3>().cwiseMax(growth.tail<3>());
  }
  last_covariance_ = covariance;
  return variance;
}

// The oldest quarter of the way is forgotten.
void LoopCloser::MakeRoom() noexcept {
  const int dropped = graph_.capacity() / 4;
  graph_.DropOldest(dropped);
  std::move(known_.begin() + dropped, known_.end(), known_.begin());
  known_.TryResizeForOverwrite(known_.size() - Count(dropped));
  std::size_t kept = 0;
  for (Place place : places_) {
    place.node -= dropped;
    if (place.node < 0) {
      free_slots_.TryPushBack(place.slot);
    } else {
      places_[kept++] = place;
    }
  }
  places_.TryResizeForOverwrite(kept);
}

// Every other place goes; those to come lie twice as far apart.
void LoopCloser::ThinOut() noexcept {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (i % 2 == 1) {
      free_slots_.TryPushBack(places_[i].slot);
    } else {
      places_[kept++] = places_[i];
    }
  }
  places_.TryResizeForOverwrite(kept);
  spacing_m_ *= 2.0;
}

void LoopCloser::Keep(const Map& map, SlotId id) noexcept {
  const Keyframe& keyframe = map.keyframe(id);
  const int node = graph_.size() - 1;
  if (!places_.empty()) {
    const Vec3 step = graph_.world_from_camera(node).translation -
                      graph_.world_from_camera(places_.back().node).translation;
    if (step.norm() < spacing_m_) return;
  }
  if (free_slots_.empty()) ThinOut();
  if (free_slots_.empty()) return;
  Place place{node, free_slots_.back(), 0};
  const DescriptorView rows = map.descriptors(id);
  const auto stride = Count(DescriptorStride(options_.descriptor));
  const std::span<const SlotId> landmarks = map.landmarks_of(id);
  for (std::size_t i = 0; i < landmarks.size() && place.num_features < kFeatures; ++i) {
    const Landmark* landmark = map.landmarks().Find(landmarks[i]);
    if (landmark == nullptr || landmark->observations.size() < kMinObservations) continue;
    const std::size_t k = place.slot * kFeatures + Count(place.num_features++);
    points_[k] = keyframe.camera_from_world * landmark->point_in_world;
    std::copy_n(rows.Row(static_cast<int>(i)), stride, descriptors_.data() + k * stride);
  }
  if (place.num_features < kMinFeatures) return;
  free_slots_.pop_back();
  places_.TryPushBack(place);
}

// The places nearest to the newest node, of those that are near enough for what is not known of the
// way between, and that have left the map long ago.
void LoopCloser::FindNear(double reach_m) noexcept {
  near_.clear();
  const int newest = graph_.size() - 1;
  const Rigid3& here = graph_.world_from_camera(newest);
  double variance = 0.0, turn_variance = 0.0;
  std::size_t left = places_.size();
  std::array<double, 3> distances{};
  for (int node = newest; node >= 0 && left > 0; --node) {
    for (; left > 0 && places_[left - 1].node == node; --left) {
      if (newest - node < options_.max_keyframes) continue;
      const double distance =
          (graph_.world_from_camera(node).translation - here.translation).norm();
      const double sigma = std::sqrt(variance + turn_variance * distance * distance);
      if (distance > reach_m + 3.0 * sigma) continue;
      std::size_t at = near_.size();
      if (near_.full()) {
        if (distances[near_.size() - 1] <= distance) continue;
        at = near_.size() - 1;
      } else {
        near_.TryPushBack({});
      }
      for (; at > 0 && distances[at - 1] > distance; --at) {
        distances[at] = distances[at - 1];
        near_[at] = near_[at - 1];
      }
      distances[at] = distance;
      near_[at] = places_[left - 1];
    }
    variance += graph_.variance(node).tail<3>().sum();
    turn_variance += graph_.variance(node)[2];
  }
}

bool LoopCloser::Match(const Map& map, SlotId id, const Place& place,
                       PoseGraph::Loop* loop) noexcept {
  const auto stride = Count(DescriptorStride(options_.descriptor));
  const DescriptorView known{descriptors_.data() + place.slot * kFeatures * stride,
                             place.num_features, options_.descriptor};
  const int count = matcher_.Match(known, map.descriptors(id), options_.max_ratio, matches_.span());
  if (count < kMinMatches) return false;
  pixels_.clear();
  matched_points_.clear();
  for (int i = 0; i < count; ++i) {
    const DescriptorMatch& match = matches_[Count(i)];
    pixels_.TryPushBack(map.features(id)[Count(match.train)].pixel());
    matched_points_.TryPushBack(points(place)[Count(match.query)]);
  }
  AbsolutePoseOptions options;
  options.ransac.max_error_px = options_.max_error_px;
  options.ransac.max_iterations = options_.ransac_iterations;
  options.ransac.seed = options_.seed + static_cast<std::uint64_t>(map.keyframe(id).id);
  options.min_inliers = std::max(kMinMatches, count / 4);
  const auto found = estimator_.Estimate(camera_, pixels_.span(), matched_points_.span(), options);
  if (!found) return false;
  loop->a = place.node;
  loop->b = graph_.size() - 1;
  loop->a_from_b = found->camera_from_world.Inverse();
  // A left perturbation of b_from_a is a right one of a_from_b, the other way round.
  Vec6 floor;
  floor << kLoopTurn, kLoopTurn, kLoopTurn, kLoopShift, kLoopShift, kLoopShift;
  loop->covariance = found->covariance;
  loop->covariance.diagonal() += floor.cwiseAbs2();
  return true;
}

bool LoopCloser::Add(const Map& map, SlotId id, bool is_ned) noexcept {
  if (options_.max_places == 0) return false;
  const Keyframe& keyframe = map.keyframe(id);
  is_ned_ = is_ned;
  if (graph_.size() == graph_.capacity()) MakeRoom();
  const Rigid3 world_from_camera = keyframe.camera_from_world.Inverse();
  if (!graph_.AddNode(world_from_camera, LinkVariance(keyframe, world_from_camera))) return false;
  known_.TryPushBack({keyframe.id, world_from_camera});
  const double range = RangeOf(map, id);
  if (range <= 0.0) return false;
  spacing_m_ = std::max(spacing_m_, kSpacing * range);
  FindNear(kReach * range);
  bool is_closed = false;
  for (const Place& place : near_) {
    PoseGraph::Loop loop;
    if (!Match(map, id, place, &loop)) continue;
    for (std::size_t i = 0; i < known_.size(); ++i)
      known_[i].world_from_camera = graph_.world_from_camera(static_cast<int>(i));
    is_closed = graph_.Close(loop).has_value();
    num_refused_ += !is_closed;
    num_closed_ += is_closed;
    break;  // one a keyframe
  }
  // Where it was seen before it is not kept again.
  if (near_.empty() || !is_closed) Keep(map, id);
  return is_closed;
}

Rigid3 LoopCloser::Correction(std::int32_t keyframe_id) const noexcept {
  const auto at = std::lower_bound(
      known_.begin(), known_.end(), keyframe_id,
      [](const Known& known, std::int32_t wanted) { return known.keyframe_id < wanted; });
  const bool is_known = at != known_.end() && at->keyframe_id == keyframe_id;
  const auto node =
      static_cast<std::size_t>(is_known ? at - known_.begin() : known_.end() - known_.begin() - 1);
  return graph_.world_from_camera(static_cast<int>(node)) *
         known_[node].world_from_camera.Inverse();
}

}  // namespace rsfm
