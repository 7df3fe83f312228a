#include "tools/simulator/trajectory.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "rsfm/base/rng.h"

namespace rsfm::simulator {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kRad = kPi / 180.0;
constexpr double kStepM = 0.005;  // of the tabulated speed profile

// A few sinusoids of unrelated periods: smooth, bounded, of unit standard deviation.
class Sway {
 public:
  Sway(double period_s, Rng* rng) {
    constexpr std::array<double, 4> kPeriod = {2.3, 1.0, 0.61, 0.37};
    constexpr std::array<double, 4> kPower = {0.35, 0.40, 0.18, 0.07};
    for (std::size_t i = 0; i < waves_.size(); ++i) {
      waves_[i] = {2.0 * kPi / (period_s * kPeriod[i] * rng->Uniform(0.85, 1.15)),
                   rng->Uniform(0.0, 2.0 * kPi), std::sqrt(2.0 * kPower[i])};
    }
  }
  double At(double time_s) const {
    double sum = 0.0;
    for (const Wave& wave : waves_)
      sum += wave.amplitude * std::sin(wave.rate * time_s + wave.phase);
    return sum;
  }

 private:
  struct Wave {
    double rate, phase, amplitude;
  };
  std::array<Wave, 4> waves_;
};

// A line of constant curvature.
struct Segment {
  Vec2 start = Vec2::Zero();  // along the first leg, to its right
  double course = 0.0;        // rad from the first leg, to the right
  double length = 0.0;
  double curvature = 0.0;  // 1/m, positive to the right

  Vec2 PointAt(double s) const {
    if (curvature == 0.0) return start + s * Vec2(std::cos(course), std::sin(course));
    const double end = course + curvature * s;
    return start +
           Vec2(std::sin(end) - std::sin(course), std::cos(course) - std::cos(end)) / curvature;
  }
};

class Lawnmower final : public Trajectory {
 public:
  Lawnmower(const LawnmowerOptions& options, double floor_depth_m)
      : options_(options), depth_m_(floor_depth_m - options.altitude_m) {
    Rng rng(options.seed ^ 0x7261696Cu);
    sways_.reserve(6);
    for (int i = 0; i < 6; ++i) sways_.emplace_back(options.sway_period_s, &rng);
    PlanPath();
    PlanSpeed();
  }

  double duration_s() const override { return time_at_.back(); }

  Rigid3 WorldFromBody(double time_s) const override {
    const double time = std::clamp(time_s, 0.0, duration_s());
    const double s = DistanceAt(time);
    const std::size_t i = SegmentAt(s);
    const Segment& segment = segments_[i];
    const double along = s - start_of_[i];
    const Vec2 plan = segment.PointAt(along) - center_;
    const double bow = options_.turns == LawnmowerOptions::Turns::kRotate
                           ? segment.course + segment.curvature * along
                           : 0.0;
    const double first_heading = options_.heading_deg * kRad;
    const double c = std::cos(first_heading);
    const double n = std::sin(first_heading);
    const Vec3 position(c * plan.x() - n * plan.y() + options_.sway_m * sways_[3].At(time),
                        n * plan.x() + c * plan.y() + options_.sway_m * sways_[4].At(time),
                        depth_m_ + options_.heave_m * sways_[5].At(time));
    const double heading = first_heading + bow + options_.yaw_deg * kRad * sways_[2].At(time);
    const Quat rotation =
        Eigen::AngleAxisd(heading, Vec3::UnitZ()) *
        Eigen::AngleAxisd(options_.pitch_deg * kRad * sways_[1].At(time), Vec3::UnitY()) *
        Eigen::AngleAxisd(options_.roll_deg * kRad * sways_[0].At(time), Vec3::UnitX());
    return {rotation, position};
  }

 private:
  void Add(double length, double turn_rad) {
    if (length <= 0.0) return;
    Segment segment;
    if (!segments_.empty()) {
      const Segment& last = segments_.back();
      segment.start = last.PointAt(last.length);
      segment.course = last.course + last.curvature * last.length;
    }
    segment.length = length;
    segment.curvature = turn_rad / length;
    start_of_.push_back(path_length_);
    path_length_ += length;
    segments_.push_back(segment);
  }

  void PlanPath() {
    const double radius = std::min(options_.turn_radius_m, 0.5 * options_.leg_spacing_m);
    for (int leg = 0; leg < options_.legs; ++leg) {
      Add(options_.leg_length_m, 0.0);
      if (leg + 1 == options_.legs) break;
      const double side = leg % 2 == 0 ? 1.0 : -1.0;
      Add(0.5 * kPi * radius, 0.5 * kPi * side);
      Add(options_.leg_spacing_m - 2.0 * radius, 0.0);
      Add(0.5 * kPi * radius, 0.5 * kPi * side);
    }
    center_ = 0.5 * Vec2(options_.leg_length_m, (options_.legs - 1) * options_.leg_spacing_m);
  }

  std::size_t SegmentAt(double s) const {
    const auto next = std::upper_bound(start_of_.begin() + 1, start_of_.end(), s);
    return static_cast<std::size_t>(next - start_of_.begin()) - 1;
  }

  double LimitAt(double s) const {
    const double curvature = std::abs(segments_[SegmentAt(s)].curvature);
    if (curvature == 0.0) return options_.speed_mps;
    const double by_drift = std::sqrt(options_.max_acceleration_mps2 / curvature);
    const double by_rate = options_.turns == LawnmowerOptions::Turns::kRotate
                               ? options_.max_turn_rate_dps * kRad / curvature
                               : options_.speed_mps;
    return std::min({options_.speed_mps, by_drift, by_rate});
  }

  // Of the steps to both sides, as the speed changes linearly in between.
  double SpeedLimit(double s) const {
    return std::min({LimitAt(s - step_m_), LimitAt(s), LimitAt(s + step_m_)});
  }

  // The fastest profile within the limits of speed and acceleration, tabulated over the path.
  void PlanSpeed() {
    const auto steps = static_cast<std::size_t>(std::ceil(path_length_ / kStepM));
    step_m_ = path_length_ / static_cast<double>(steps);
    speed_at_.resize(steps + 1);
    for (std::size_t i = 0; i <= steps; ++i)
      speed_at_[i] = SpeedLimit(static_cast<double>(i) * step_m_);
    const double gain = 2.0 * options_.max_acceleration_mps2 * step_m_;
    const auto limit = [&](std::size_t i, std::size_t from) {
      speed_at_[i] = std::min(speed_at_[i], std::sqrt(speed_at_[from] * speed_at_[from] + gain));
    };
    for (std::size_t i = 1; i <= steps; ++i) limit(i, i - 1);
    for (std::size_t i = steps; i-- > 0;) limit(i, i + 1);
    time_at_.resize(steps + 1, 0.0);
    for (std::size_t i = 1; i <= steps; ++i) {
      time_at_[i] = time_at_[i - 1] + 2.0 * step_m_ / (speed_at_[i - 1] + speed_at_[i]);
    }
  }

  // Constant acceleration within a step of the table.
  double DistanceAt(double time) const {
    const auto next = std::upper_bound(time_at_.begin() + 1, time_at_.end() - 1, time);
    const auto i = static_cast<std::size_t>(next - time_at_.begin()) - 1;
    const double span = time_at_[i + 1] - time_at_[i];
    const double dt = time - time_at_[i];
    const double acceleration = (speed_at_[i + 1] - speed_at_[i]) / span;
    return static_cast<double>(i) * step_m_ + dt * (speed_at_[i] + 0.5 * acceleration * dt);
  }

  LawnmowerOptions options_;
  double depth_m_;
  std::vector<Sway> sways_;  // roll, pitch, yaw, north, east, down
  std::vector<Segment> segments_;
  std::vector<double> start_of_;
  double path_length_ = 0.0;
  Vec2 center_ = Vec2::Zero();
  double step_m_ = kStepM;
  std::vector<double> speed_at_;
  std::vector<double> time_at_;
};

}  // namespace

BodyMotion Trajectory::MotionAt(double time_s) const {
  constexpr double kHalf = 1e-3;
  BodyMotion motion;
  motion.world_from_body = WorldFromBody(time_s);
  const Rigid3 before = WorldFromBody(time_s - kHalf);
  const Rigid3 after = WorldFromBody(time_s + kHalf);
  const Quat body_from_world = motion.world_from_body.rotation.conjugate();
  // At the ends of the path one of the two is held: the difference is then over half the time.
  const double span = std::min(time_s + kHalf, duration_s()) - std::max(time_s - kHalf, 0.0);
  if (span <= 0.0) return motion;
  motion.velocity_in_body_mps = body_from_world * (after.translation - before.translation) / span;
  motion.rate_in_body_radps = LogSo3(before.rotation.conjugate() * after.rotation) / span;
  return motion;
}

std::unique_ptr<Trajectory> MakeLawnmower(const LawnmowerOptions& options, double floor_depth_m) {
  return std::make_unique<Lawnmower>(options, floor_depth_m);
}

LawnmowerOptions FitToImages(const LawnmowerOptions& options, int images, double rate_hz) {
  const auto count = [&](const LawnmowerOptions& plan) {
    return static_cast<int>(Lawnmower(plan, 0.0).duration_s() * rate_hz) + 1;
  };
  const int all = count(options);
  if (images < 1 || images >= all) return options;
  LawnmowerOptions plan = options;
  const double scale = std::sqrt(static_cast<double>(images) / all);
  plan.legs = std::clamp(static_cast<int>(std::lround(scale * options.legs)), 1, options.legs);
  for (; plan.legs <= options.legs; ++plan.legs) {
    plan.leg_length_m = options.leg_length_m;
    if (count(plan) < images) continue;  // even at full length
    double low = kStepM;
    double high = options.leg_length_m;
    for (int i = 0; i < 30; ++i) {
      plan.leg_length_m = 0.5 * (low + high);
      (count(plan) < images ? low : high) = plan.leg_length_m;
    }
    plan.leg_length_m = high;
    return plan;
  }
  return options;
}

}  // namespace rsfm::simulator
