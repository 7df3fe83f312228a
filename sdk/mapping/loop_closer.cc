#include "rsfm/mapping/loop_closer.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace rsfm {
namespace {

// What a link may be off by, per root of a metre (and at least the root of a step of 0.1 m).
constexpr double kTurn = 1e-3;   // rad
constexpr double kShift = 0.01;  // m
constexpr double kMinStep_m = 0.1;
// The same of what sensors hold; and what they may be off by from one pass to the next: a loop that
// says otherwise is none against them (attitude's noise; the tide).
constexpr double kHeldTilt = 1e-5, kHeldDepth = 1e-4;  // rad, m
constexpr double kPassTilt = 0.01, kPassDepth = 0.2;
constexpr double kSpacing = 0.3;  // of the range, between places
constexpr double kReach = 1.0;    // of the range, plus three sigmas: what is near
// A place's points are not exact, and not independent: the loop's own deviation, at least.
constexpr double kLoopTurn = 2e-3, kLoopShift = 0.01;
constexpr int kMinSimilarity = 4;  // of a place, to be searched for a lost frame

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

PoseGraphOptions GraphOptions(const MapperOptions& options) {
  PoseGraphOptions graph;
  graph.max_nodes = options.max_places > 0 ? options.max_way_nodes : 0;
  graph.max_loops = options.max_places > 0 ? options.max_loops : 0;
  return graph;
}

// Of a left perturbation of camera_from_world, as a turn and a shift along the world's axes.
Mat6 AlongWorld(const Mat6& covariance, const Rigid3& world_from_camera) {
  const Mat3 rotation = world_from_camera.rotation.toRotationMatrix();
  Mat6 turned;
  for (const int i : {0, 3})
    for (const int j : {0, 3})
      turned.block<3, 3>(i, j) = rotation * covariance.block<3, 3>(i, j) * rotation.transpose();
  return turned;
}

// The variances of a way, as seen from its end: what is not known of a turn then moves it by all
// that lies between.
Vec6 AtTheEnd(Vec6 sum, const Vec3& between) {
  sum.tail<3>().array() += sum.head<3>().maxCoeff() * between.squaredNorm();
  return sum;
}

// A left perturbation of b_from_a is a right one of a_from_b, the other way round. `b` is left out.
PoseGraph::Loop MakeLoop(int node, const PlaceArchive::Sighting& seen) {
  PoseGraph::Loop loop;
  loop.a = node;
  loop.a_from_b = seen.frame_from_place.Inverse();
  Vec6 floor;
  floor << kLoopTurn, kLoopTurn, kLoopTurn, kLoopShift, kLoopShift, kLoopShift;
  loop.covariance = seen.covariance;
  loop.covariance.diagonal() += floor.cwiseAbs2();
  return loop;
}

}  // namespace

LoopCloser::LoopCloser(const MapperOptions& options, const AnyCamera& camera)
    : options_(options),
      graph_(GraphOptions(options)),
      places_(options, camera),
      known_(Count(GraphOptions(options).max_nodes)),
      shift_variances_(Count(options.max_places)) {}

std::size_t LoopCloser::bytes() const {
  return graph_.bytes() + places_.bytes() + known_.bytes() + shift_variances_.bytes();
}

void LoopCloser::Clear() noexcept {
  graph_.Clear();
  known_.clear();
  places_.Clear();
  spacing_m_ = 0.0;
  anchored_.clear();
  has_moved_ = false;
}

bool LoopCloser::IsFarFrom(const Rigid3& pose, const Rigid3& told) noexcept {
  return (pose.translation - told.translation).squaredNorm() > kToldShift_m * kToldShift_m ||
         pose.rotation.angularDistance(told.rotation) > kToldTurn_rad;
}

// As the odometry has it by experience, or as the pose's own covariance grows where that is more:
// through an outage. What grows only because the step is taken under a heading that was uncertain
// before is not the link's.
Vec6 LoopCloser::LinkVariance(const Keyframe& keyframe, const Rigid3& world_from_camera) noexcept {
  const Mat6 covariance = AlongWorld(keyframe.covariance, world_from_camera);
  Vec6 variance = Vec6::Ones();
  if (graph_.size() > 0) {
    const Vec3 moved =
        world_from_camera.translation - graph_.world_from_camera(graph_.size() - 1).translation;
    const double step = moved.norm();
    Vec6 sigma;
    sigma << kTurn, kTurn, kTurn, kShift, kShift, kShift;
    if (held_.level) sigma.head<2>().setConstant(kHeldTilt);
    if (held_.depth) sigma[5] = kHeldDepth;
    variance = std::max(step, kMinStep_m) * sigma.cwiseAbs2();
    Mat6 carried = Mat6::Identity();
    carried.bottomLeftCorner<3, 3>() = -Hat(moved);
    const Vec6 growth = (covariance - carried * last_covariance_ * carried.transpose()).diagonal();
    const int grows = held_.depth ? 2 : 3;
    variance.segment(3, grows) = variance.segment(3, grows).cwiseMax(growth.segment(3, grows));
  }
  last_covariance_ = covariance;
  return variance;
}

// Of the way since that node, as seen from its end.
Vec6 LoopCloser::WayVariance(int node) const noexcept {
  Vec6 sum = Vec6::Zero();
  for (int i = node + 1; i < graph_.size(); ++i) sum += graph_.variance(i);
  return AtTheEnd(sum, graph_.world_from_camera(graph_.size() - 1).translation -
                           graph_.world_from_camera(node).translation);
}

// The shifts' variance of WayVariance of each place, once along the way for all of them.
void LoopCloser::SumWays() noexcept {
  const std::span<const PlaceArchive::Place> places = places_.places();
  shift_variances_.TryResize(places.size());
  if (places.empty()) return;
  const Vec3& end = graph_.world_from_camera(graph_.size() - 1).translation;
  Vec6 sum = Vec6::Zero();
  int node = graph_.size() - 1;
  for (std::size_t i = places.size(); i-- > 0;) {
    for (; node > places[i].node; --node) sum += graph_.variance(node);
    const Vec3 between = end - graph_.world_from_camera(places[i].node).translation;
    shift_variances_[i] = AtTheEnd(sum, between).tail<3>().sum();
  }
}

// The oldest quarter of the way is forgotten.
void LoopCloser::MakeRoom() noexcept {
  const int dropped = graph_.capacity() / 4;
  graph_.DropOldest(dropped);
  std::move(known_.begin() + dropped, known_.end(), known_.begin());
  known_.TryResizeForOverwrite(known_.size() - Count(dropped));
  places_.DropNodesBefore(dropped);
  for (Anchored& anchored : anchored_) anchored.loop.a -= dropped;
  ForgetAnchored([](const Anchored& anchored) { return anchored.loop.a < 0; });
}

// The newest node, where it is farther from the last place than they are apart.
void LoopCloser::Keep(const Map& map, SlotId id) noexcept {
  const int node = graph_.size() - 1;
  if (!places_.places().empty()) {
    const Vec3 step = graph_.world_from_camera(node).translation -
                      graph_.world_from_camera(places_.places().back().node).translation;
    if (step.norm() < spacing_m_) return;
  }
  if (places_.full()) {
    places_.ThinOut();
    spacing_m_ *= 2.0;
  }
  places_.Keep(map, id, node);
}

// The places nearest to the newest node, of those that are near enough for what is not known of the
// way between, and that have left the map long ago.
void LoopCloser::FindNear(double reach_m) noexcept {
  near_.clear();
  const int newest = graph_.size() - 1;
  const Rigid3& here = graph_.world_from_camera(newest);
  double variance = 0.0, turn_variance = 0.0;
  const std::span<const PlaceArchive::Place> places = places_.places();
  std::size_t left = places.size();
  std::array<double, 3> distances{};
  for (int node = newest; node >= 0 && left > 0; --node) {
    for (; left > 0 && places[left - 1].node == node; --left) {
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
      near_[at] = places[left - 1];
    }
    variance += graph_.variance(node).tail<3>().sum();
    turn_variance += graph_.variance(node)[2];
  }
}

bool LoopCloser::Match(const Map& map, SlotId id, const PlaceArchive::Place& place,
                       PoseGraph::Loop* loop) noexcept {
  const FrameView frame{map.features(id), map.descriptors(id)};
  const auto seed = options_.seed + static_cast<std::uint64_t>(map.keyframe(id).id);
  const auto seen = places_.Match(frame, place, seed);
  if (!seen) return false;
  *loop = MakeLoop(place.node, *seen);
  loop->b = graph_.size() - 1;
  return true;
}

// What sensors hold is theirs to say.
bool LoopCloser::Close(PoseGraph::Loop loop) noexcept {
  const Vec3 down = graph_.world_from_camera(loop.b).rotation.conjugate() * Vec3::UnitZ();
  const Mat3 along_down = down * down.transpose();
  if (held_.level) {
    loop.covariance.topLeftCorner<3, 3>() +=
        kPassTilt * kPassTilt * (Mat3::Identity() - along_down);
  }
  if (held_.depth)
    loop.covariance.bottomRightCorner<3, 3>() += kPassDepth * kPassDepth * along_down;
  for (std::size_t i = 0; i < known_.size(); ++i)
    known_[i].world_from_camera = graph_.world_from_camera(static_cast<int>(i));
  const bool is_closed = graph_.Close(loop).has_value();
  num_refused_ += !is_closed;
  num_closed_ += is_closed;
  // The newest is told by whoever publishes the keyframe that has left the window.
  if (is_closed) known_.back().told = graph_.world_from_camera(graph_.size() - 1);
  has_moved_ |= is_closed;
  return is_closed;
}

// The link of a keyframe that a place has anchored is what navigation says; the node is where the
// place says.
void LoopCloser::AddNode(const Keyframe& keyframe) noexcept {
  if (graph_.size() == graph_.capacity()) MakeRoom();
  const Rigid3 world_from_camera = keyframe.camera_from_world.Inverse();
  Vec6 variance = LinkVariance(keyframe, world_from_camera);
  Rigid3 as_linked = world_from_camera;
  for (const Anchored& anchored : anchored_) {
    if (anchored.keyframe_id != keyframe.id) continue;
    as_linked = anchored.unmoved_from_world * world_from_camera;
    const Vec6 held = variance;
    variance = variance.cwiseMax(anchored.variance);
    if (held_.level) variance.head<2>() = held.head<2>();
    if (held_.depth) variance[5] = held[5];
  }
  graph_.AddNode(world_from_camera, variance, as_linked);
  known_.TryPushBack({keyframe.id, world_from_camera, world_from_camera});
}

bool LoopCloser::Add(const Map& map, SlotId id, const Held& held) noexcept {
  if (options_.max_places == 0) return false;
  held_ = held;
  const std::int32_t keyframe_id = map.keyframe(id).id;
  AddNode(map.keyframe(id));
  bool is_closed = false;
  for (Anchored& anchored : anchored_) {
    if (anchored.keyframe_id != keyframe_id) continue;
    anchored.loop.b = graph_.size() - 1;
    is_closed = Close(anchored.loop);
  }
  ForgetAnchored([&](const Anchored& anchored) { return anchored.keyframe_id <= keyframe_id; });
  if (is_closed) return true;
  const double range = RangeOf(map, id);
  if (range <= 0.0) return false;
  spacing_m_ = std::max(spacing_m_, kSpacing * range);
  FindNear(kReach * range);
  for (const PlaceArchive::Place& place : near_) {
    PoseGraph::Loop loop;
    if (!Match(map, id, place, &loop)) continue;
    is_closed = Close(loop);
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

// The places that look most like the frame, of those that may be seen from there; most similar
// first.
std::span<const PlaceArchive::Place> LoopCloser::LookAt(const Map& map, const FrameView& frame,
                                                        const KnownPose* expected) noexcept {
  near_.clear();
  std::array<int, kCandidates> similarities{};
  const std::span<const PlaceArchive::Place> places = places_.places();
  const std::size_t count = std::min(places.size(), kPlacesPerLook);
  if (expected != nullptr) SumWays();
  for (std::size_t i = 0; i < count; ++i, ++next_look_) {
    if (next_look_ >= places.size()) next_look_ = 0;
    const PlaceArchive::Place& place = places[next_look_];
    if (expected != nullptr) {
      const Vec3 away = graph_.world_from_camera(place.node).translation -
                        expected->camera_from_world.OriginOfTarget();
      const double variance =
          expected->covariance.bottomRightCorner<3, 3>().trace() + shift_variances_[next_look_];
      if (away.norm() > kReach * place.range_m + 3.0 * std::sqrt(variance)) continue;
    }
    const bool is_in_map =
        std::any_of(map.keyframes().begin(), map.keyframes().end(),
                    [&](SlotId id) { return map.keyframe(id).id == place.keyframe_id; });
    if (is_in_map) continue;
    const int similarity = places_.Similarity(frame, place);
    if (similarity < kMinSimilarity) continue;
    if (near_.full() && similarities[kCandidates - 1] >= similarity) continue;
    if (near_.full()) near_.pop_back();
    near_.TryPushBack(place);
    std::size_t at = near_.size() - 1;
    for (; at > 0 && similarities[at - 1] < similarity; --at) {
      similarities[at] = similarities[at - 1];
      near_[at] = near_[at - 1];
    }
    similarities[at] = similarity;
    near_[at] = place;
  }
  return {near_.begin(), near_.end()};
}

std::optional<LoopCloser::Recognised> LoopCloser::Recognise(const Map& map, const FrameView& frame,
                                                            const KnownPose* expected,
                                                            int min_inliers,
                                                            std::uint64_t seed) noexcept {
  for (const PlaceArchive::Place& place : LookAt(map, frame, expected)) {
    const auto seen = places_.Match(frame, place, seed);
    if (!seen || seen->num_inliers < min_inliers) continue;
    return Recognised{place, graph_.world_from_camera(place.node).Inverse(), *seen,
                      WayVariance(place.node)};
  }
  return std::nullopt;
}

void LoopCloser::Anchor(const Map& map, SlotId id, const Recognised& recognised,
                        const KnownPose* expected) noexcept {
  constexpr double kUnknown_rad = 1.0, kUnknown_m = 100.0;
  const Keyframe& keyframe = map.keyframe(id);
  if (anchored_.full()) return;
  Anchored anchored;
  anchored.keyframe_id = keyframe.id;
  anchored.loop = MakeLoop(recognised.place.node, recognised.sighting);
  anchored.loop.a_from_b = recognised.place_from_world * keyframe.camera_from_world.Inverse();
  anchored.unmoved_from_world = {};
  anchored.variance.head<3>().setConstant(kUnknown_rad * kUnknown_rad);
  anchored.variance.tail<3>().setConstant(kUnknown_m * kUnknown_m);
  if (expected != nullptr) {
    const Rigid3 expected_in_world = expected->camera_from_world.Inverse();
    anchored.unmoved_from_world = expected_in_world * keyframe.camera_from_world;
    anchored.variance = AlongWorld(expected->covariance, expected_in_world).diagonal();
  }
  anchored_.TryPushBack(anchored);
}

}  // namespace rsfm
