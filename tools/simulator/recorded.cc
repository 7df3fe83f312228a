#include "tools/simulator/recorded.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "rsfm/io/tables.h"
#include "rsfm/io/trajectory.h"

namespace rsfm::simulator {
namespace {

using Vec7 = Eigen::Matrix<double, 7, 1>;

// Position and quaternion (x y z w) of the body at a time.
struct Knot {
  double time_s = 0.0;
  Vec7 value = Vec7::Zero();
};

Knot MakeKnot(double time_s, const Rigid3& pose) {
  Knot knot;
  knot.time_s = time_s;
  knot.value << pose.translation, pose.rotation.coeffs();
  return knot;
}

// Neighbouring quaternions on the same side of the sphere.
void AlignSigns(std::vector<Knot>* knots) {
  for (std::size_t i = 1; i < knots->size(); ++i) {
    auto q = (*knots)[i].value.tail<4>();
    if (q.dot((*knots)[i - 1].value.tail<4>()) < 0.0) q = (-q).eval();
  }
}

// Triangular averages at half the window's spacing.
std::vector<Knot> Smoothed(const std::vector<Knot>& knots, double window_s) {
  const double step = 0.5 * window_s;
  const double end = knots.back().time_s;
  std::vector<Knot> smooth;
  std::size_t first = 0;
  for (int k = 0; k * step <= end; ++k) {
    const double time = k * step;
    while (first < knots.size() && knots[first].time_s < time - window_s) ++first;
    Knot sum;
    sum.time_s = time;
    double weight = 0.0;
    for (std::size_t i = first; i < knots.size() && knots[i].time_s < time + window_s; ++i) {
      const double w = std::max(0.0, 1.0 - std::abs(knots[i].time_s - time) / window_s);
      sum.value += w * knots[i].value;
      weight += w;
    }
    if (weight <= 0.0) continue;  // a gap: bridged by the curve
    sum.value /= weight;
    smooth.push_back(sum);
  }
  return smooth;
}

class Recorded final : public Trajectory {
 public:
  explicit Recorded(std::vector<Knot> knots) : knots_(std::move(knots)) {}

  double duration_s() const override { return knots_.back().time_s; }

  // Hermite with the slopes of the neighbours on both sides.
  Rigid3 WorldFromBody(double time_s) const override {
    const double time = std::clamp(time_s, 0.0, duration_s());
    const auto next = std::upper_bound(knots_.begin() + 1, knots_.end() - 1, time,
                                       [](double t, const Knot& knot) { return t < knot.time_s; });
    const auto i = static_cast<std::size_t>(next - knots_.begin()) - 1;
    const Knot& a = knots_[i];
    const Knot& b = knots_[i + 1];
    const double span = b.time_s - a.time_s;
    const double u = (time - a.time_s) / span;
    const double uu = u * u;
    const double uuu = uu * u;
    const Vec7 value = (2.0 * uuu - 3.0 * uu + 1.0) * a.value +
                       span * (uuu - 2.0 * uu + u) * Slope(i) + (3.0 * uu - 2.0 * uuu) * b.value +
                       span * (uuu - uu) * Slope(i + 1);
    return {Quat(Eigen::Vector4d(value.tail<4>())).normalized(), value.head<3>()};
  }

 private:
  Vec7 Slope(std::size_t i) const {
    const Knot& before = knots_[i > 0 ? i - 1 : 0];
    const Knot& after = knots_[std::min(i + 1, knots_.size() - 1)];
    return (after.value - before.value) / (after.time_s - before.time_s);
  }

  std::vector<Knot> knots_;  // two or more, strictly later each
};

IoExpected<std::vector<Knot>> ReadTumKnots(const RecordedOptions& options,
                                           const Rigid3& body_from_camera) {
  const auto poses = ReadTum(options.file);
  if (!poses) return Fail(poses.error());
  std::vector<Knot> knots;
  const Rigid3 camera_from_body = body_from_camera.Inverse();
  for (const TrajectoryPose& pose : *poses) {
    const double time = SecondsFromUs(pose.utime - poses->front().utime);
    const Rigid3 body =
        options.poses_are_body ? pose.world_from_camera : pose.world_from_camera * camera_from_body;
    knots.push_back(MakeKnot(time, body));
  }
  return knots;
}

// The attitude at a time, between the two measured ones next to it.
Quat AttitudeAt(const std::vector<const NavSample*>& attitudes, Utime utime) {
  const auto next =
      std::lower_bound(attitudes.begin(), attitudes.end(), utime,
                       [](const NavSample* sample, Utime time) { return sample->utime < time; });
  if (next == attitudes.begin()) return attitudes.front()->ned_from_body;
  if (next == attitudes.end()) return attitudes.back()->ned_from_body;
  const NavSample& a = **(next - 1);
  const NavSample& b = **next;
  const double share =
      static_cast<double>(utime - a.utime) / static_cast<double>(b.utime - a.utime);
  return a.ned_from_body.slerp(share, b.ned_from_body);
}

IoExpected<std::vector<Knot>> ReadNavKnots(const RecordedOptions& options) {
  const auto table = ReadNavTable(options.file);
  if (!table) return Fail(table.error());
  std::vector<const NavSample*> attitudes;
  for (const NavSample& sample : table->samples) {
    const bool is_later = attitudes.empty() || attitudes.back()->utime < sample.utime;
    if (sample.Has(NavField::kAttitude) && is_later) attitudes.push_back(&sample);
  }
  const auto lacks = [&](const char* what, const char* columns) {
    return Fail({Errc::kInvalidArgument, options.file.string(), columns,
                 std::string("the path has no ") + what,
                 std::string("give the columns ") + columns});
  };
  if (attitudes.empty()) return lacks("attitude", "roll_rad pitch_rad heading_rad");
  std::vector<Knot> knots;
  Utime start = 0;
  for (const NavSample& sample : table->samples) {
    if (!sample.Has(NavField::kPosition)) continue;
    if (knots.empty()) start = sample.utime;
    knots.push_back(MakeKnot(SecondsFromUs(sample.utime - start),
                             {AttitudeAt(attitudes, sample.utime), sample.position_ned_m}));
  }
  if (knots.empty()) return lacks("position", "north_m east_m down_m");
  return knots;
}

// The part asked for, from time 0 on; times strictly increasing.
std::vector<Knot> Cut(const std::vector<Knot>& knots, double start_s, double duration_s) {
  std::vector<Knot> part;
  for (const Knot& knot : knots) {
    if (knot.time_s < start_s || (duration_s > 0.0 && knot.time_s > start_s + duration_s)) continue;
    if (!part.empty() && knot.time_s <= part.back().time_s) continue;
    part.push_back(knot);
  }
  const double first = part.empty() ? 0.0 : part.front().time_s;
  for (Knot& knot : part) knot.time_s -= first;
  return part;
}

}  // namespace

IoExpected<std::unique_ptr<Trajectory>> LoadRecorded(const RecordedOptions& options,
                                                     const Rigid3& body_from_camera,
                                                     double floor_depth_m,
                                                     double* mean_altitude_m) {
  const bool is_table = options.file.extension() == ".csv";
  auto read = is_table ? ReadNavKnots(options) : ReadTumKnots(options, body_from_camera);
  if (!read) return Fail(read.error());
  std::vector<Knot> knots = Cut(*read, options.start_s, options.duration_s);
  AlignSigns(&knots);
  const double smooth_s = options.smooth_s >= 0.0 ? options.smooth_s : (is_table ? 1.0 : 0.0);
  if (smooth_s > 0.0 && !knots.empty()) knots = Smoothed(knots, smooth_s);
  if (knots.size() < 2) {
    return Fail({Errc::kInvalidArgument, options.file.string(), "",
                 "has fewer than two poses in the time asked for",
                 "set trajectory.start_s and duration_s to times within the recording"});
  }
  Vec3 low = knots.front().value.head<3>();
  Vec3 high = low;
  double mean_depth = 0.0;
  for (const Knot& knot : knots) {
    low = low.cwiseMin(knot.value.head<3>());
    high = high.cwiseMax(knot.value.head<3>());
    mean_depth += knot.value[2] / static_cast<double>(knots.size());
  }
  Vec3 shift = Vec3::Zero();
  if (options.center) shift.head<2>() = -0.5 * (low + high).head<2>();
  if (options.altitude_m > 0.0) shift.z() = floor_depth_m - options.altitude_m - mean_depth;
  for (Knot& knot : knots) knot.value.head<3>() += shift;
  *mean_altitude_m = floor_depth_m - mean_depth - shift.z();
  return std::make_unique<Recorded>(std::move(knots));
}

}  // namespace rsfm::simulator
