#include "rsfm/navigation/nav_buffer.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "rsfm/base/plausible_time.h"
#include "rsfm/base/so3.h"

namespace rsfm {
namespace {

constexpr int kThatConfirm = 3;  // samples of a time that is not expected: then it is the time
constexpr double kOneSidedPart = 0.1;  // of max_gap_s: how far one neighbour alone may be

std::size_t At0(int capacity) { return static_cast<std::size_t>(capacity); }

Vec3 Mix(const Vec3& a, const Vec3& b, double fraction) { return a + fraction * (b - a); }
double Mix(double a, double b, double fraction) { return a + fraction * (b - a); }
Quat Mix(const Quat& a, const Quat& b, double fraction) { return a.slerp(fraction, b); }
Vec3 Larger(const Vec3& a, const Vec3& b) { return a.cwiseMax(b); }
double Larger(double a, double b) { return std::max(a, b); }

double Distance(double a, double b) { return std::abs(a - b); }
double Distance(const Vec3& a, const Vec3& b) { return (a - b).norm(); }
double Distance(const Quat& a, const Quat& b) { return a.angularDistance(b); }
double Largest(double sigma) { return sigma; }
double Largest(const Vec3& sigma) { return sigma.maxCoeff(); }

// 0: none is stated. What lies beyond is no sensor's, and its squares would be no numbers.
bool IsSigma(double sigma) { return sigma == 0.0 || (sigma >= 1e-9 && sigma <= 1e6); }
bool IsSigma(const Vec3& sigma) {
  return IsSigma(sigma.x()) && IsSigma(sigma.y()) && IsSigma(sigma.z());
}

// Of one more that is not expected, and whether it goes on from the one before: enough in a row?
bool IsConfirmed(bool goes_on, int* in_a_row) {
  *in_a_row = *in_a_row > 0 && goes_on ? *in_a_row + 1 : 1;
  return *in_a_row >= kThatConfirm;
}

// What RepeatWatch compares.
Vec4 Bits(double v) { return {v, 0.0, 0.0, 0.0}; }
Vec4 Bits(const Vec3& v) { return {v.x(), v.y(), v.z(), 0.0}; }
Vec4 Bits(const Quat& v) { return v.coeffs(); }

}  // namespace

std::string_view ToString(NavReject reason) noexcept {
  constexpr std::string_view kNames[kNumNavRejects] = {"not_finite",     "sentinel", "out_of_range",
                                                       "runs_backwards", "repeated", "too_late",
                                                       "frozen",         "jump"};
  return kNames[static_cast<int>(reason)];
}

Status NavBufferOptions::Validate() const noexcept {
  if (capacity < 2) return Fail(Errc::kInvalidArgument, "capacity");
  if (!(max_gap_s > 0.0)) return Fail(Errc::kInvalidArgument, "max_gap_s");
  if (!(max_late_s >= 0.0)) return Fail(Errc::kInvalidArgument, "max_late_s");
  if (!(max_speed_mps > 0.0)) return Fail(Errc::kInvalidArgument, "max_speed_mps");
  if (!(max_depth_m > min_depth_m)) return Fail(Errc::kInvalidArgument, "max_depth_m");
  if (!(max_altitude_m > 0.0)) return Fail(Errc::kInvalidArgument, "max_altitude_m");
  return {};
}

Expected<NavBuffer> NavBuffer::Create(const NavBufferOptions& options) {
  if (const Status status = options.Validate(); !status) return tl::unexpected(status.error());
  return NavBuffer(options);
}

NavBuffer::NavBuffer(const NavBufferOptions& options)
    : options_(options),
      position_(At0(options.capacity)),
      attitude_(At0(options.capacity)),
      velocity_(At0(options.capacity)),
      depth_(At0(options.capacity)),
      altitude_(At0(options.capacity)),
      water_(At0(options.capacity)) {
  water_.may_stay = true;
  // A vehicle's limits with plenty to spare: 0.2 m/s and 0.2 g, waves of 3 m/s, 3 rad/s.
  velocity_.jump = 0.2;
  velocity_.jump_rate = 2.0;
  depth_.jump = 0.3;
  depth_.jump_rate = 3.0;
  attitude_.jump = 0.2;
  attitude_.jump_rate = 3.0;
}

std::size_t NavBuffer::bytes() const {
  return position_.bytes() + attitude_.bytes() + velocity_.bytes() + depth_.bytes() +
         altitude_.bytes() + water_.bytes();
}

Utime NavBuffer::ReachUs() const noexcept {
  const auto reach = [](const auto& series) {
    return series.full() ? series.back().utime - series.front().utime
                         : std::numeric_limits<Utime>::max();
  };
  return std::min({reach(velocity_), reach(attitude_), reach(depth_)});
}

template <class Sample>
void NavBuffer::BeginAnew(Series<Sample>* series) noexcept {
  series->clear();
  series->repeats = {};
  series->num_first = series->num_ahead = series->num_jumped = series->num_behind = 0;
}

void NavBuffer::SetClockBack(Utime utime) noexcept {
  constexpr Utime kAheadUs = 2'000'000;  // of an image, that navigation may be as it is
  horizon_ = 0;
  const auto begin_anew = [&](auto* series) {
    if (!series->empty() && series->back().utime > utime + kAheadUs) BeginAnew(series);
  };
  begin_anew(&position_);
  begin_anew(&attitude_);
  begin_anew(&velocity_);
  begin_anew(&depth_);
  begin_anew(&altitude_);
  begin_anew(&water_);
}

template <class Sample>
bool NavBuffer::IsBelieved(Utime utime, Series<Sample>* series) noexcept {
  if (series->empty()) return true;
  const Utime ahead_us = utime - series->back().utime;
  if (series->num_first < kThatConfirm && std::abs(ahead_us) > kFarAheadUs) {
    series->clear();
    return true;
  }
  if (ahead_us <= kFarAheadUs) {
    series->num_ahead = 0;
    return true;
  }
  const bool goes_on = std::abs(utime - series->ahead) <= kFarAheadUs;
  series->ahead = utime;
  return IsConfirmed(goes_on, &series->num_ahead);
}

// Only against newer times: a late sample lies between others, and what comes after a gap may be
// anything.
template <class Sample>
bool NavBuffer::HasJumped(const Sample& sample, Series<Sample>* series) noexcept {
  constexpr double kGap_s = 2.0, kSigmas = 5.0;
  const auto is_far = [&](const Sample& from) {
    const double gone_s = SecondsFromUs(sample.utime - from.utime);
    const double noise = std::max(Largest(sample.sigma), Largest(from.sigma));
    return gone_s > 0.0 && gone_s < kGap_s &&
           Distance(sample.value, from.value) >
               series->jump + series->jump_rate * gone_s + kSigmas * noise;
  };
  if (series->jump_rate == 0.0 || series->empty() || !is_far(series->back())) {
    series->num_jumped = 0;
    return false;
  }
  const bool agrees = !is_far(series->jumped);
  series->jumped = sample;
  return !IsConfirmed(agrees, &series->num_jumped);
}

template <class Sample>
bool NavBuffer::GoesOnBehind(Utime utime, Series<Sample>* series) noexcept {
  const bool goes_on = utime > series->behind;
  series->behind = utime;
  return IsConfirmed(goes_on, &series->num_behind);
}

template <class Sample>
bool NavBuffer::Store(const Sample& sample, Series<Sample>* series) noexcept {
  if (!IsSigma(sample.sigma)) return Reject(NavReject::kOutOfRange), false;
  if (sample.utime < horizon_) return Reject(NavReject::kTooLate), false;
  if (!IsBelieved(sample.utime, series)) return Reject(NavReject::kOutOfRange), false;
  if (!series->empty()) {
    const std::size_t i = series->LowerBound(sample.utime);
    if (i < series->size() && (*series)[i].utime == sample.utime)
      return Reject(NavReject::kRepeated), false;
    const double late_s = SecondsFromUs(series->back().utime - sample.utime);
    if (late_s > options_.max_late_s) {
      if (!GoesOnBehind(sample.utime, series)) return Reject(NavReject::kRunsBackwards), false;
      BeginAnew(series);
    } else {
      series->num_behind = 0;
    }
  }
  if (HasJumped(sample, series)) return Reject(NavReject::kJump), false;
  if (!series->may_stay && !series->repeats.Take(sample.utime, Bits(sample.value)))
    return Reject(NavReject::kFrozen), false;
  if (!series->Insert(sample)) return Reject(NavReject::kRunsBackwards), false;
  ++accepted_;
  series->num_first = std::min(series->num_first + 1, kThatConfirm);
  return true;
}

bool NavBuffer::InsertVector(NavField field, const NavSample& sample) noexcept {
  VectorSample stored{sample.utime, Vec3::Zero(), Vec3::Zero()};
  Series<VectorSample>* series = &position_;
  double limit = 1e9;
  if (field == NavField::kPosition) {
    stored.value = sample.position_ned_m;
    stored.sigma = sample.sigma_position_m;
  } else if (field == NavField::kVelocity) {
    stored.value = sample.velocity_body_mps;
    stored.sigma = sample.sigma_velocity_mps;
    series = &velocity_;
    limit = options_.max_speed_mps;
  } else {
    stored.value = Vec3(sample.temperature_c, sample.salinity_psu, 0.0);
    series = &water_;
    limit = 1e3;
  }
  if (!stored.value.allFinite() || !stored.sigma.allFinite())
    return Reject(NavReject::kNotFinite), false;
  if ((field == NavField::kVelocity && IsVelocitySentinel(stored.value)) ||
      (stored.sigma.array() < 0.0).any())
    return Reject(NavReject::kSentinel), false;
  if (stored.value.norm() > limit) return Reject(NavReject::kOutOfRange), false;
  return Store(stored, series);
}

bool NavBuffer::InsertAttitude(const NavSample& sample) noexcept {
  const Quat& q = sample.ned_from_body;
  if (!q.coeffs().allFinite() || !sample.sigma_attitude_rad.allFinite())
    return Reject(NavReject::kNotFinite), false;
  if ((sample.sigma_attitude_rad.array() < 0.0).any()) return Reject(NavReject::kSentinel), false;
  if (std::abs(q.norm() - 1.0) > 1e-3) return Reject(NavReject::kOutOfRange), false;
  return Store(AttitudeSample{sample.utime, q.normalized(), sample.sigma_attitude_rad}, &attitude_);
}

bool NavBuffer::InsertScalar(NavField field, const NavSample& sample) noexcept {
  const bool is_depth = field == NavField::kDepth;
  const double value = is_depth ? sample.depth_m : sample.altitude_m;
  const double sigma = is_depth ? sample.sigma_depth_m : sample.sigma_altitude_m;
  if (!std::isfinite(value) || !std::isfinite(sigma)) return Reject(NavReject::kNotFinite), false;
  if (sigma < 0.0 || (!is_depth && value <= 0.0)) return Reject(NavReject::kSentinel), false;
  const double low = is_depth ? options_.min_depth_m : 0.0;
  const double high = is_depth ? options_.max_depth_m : options_.max_altitude_m;
  if (value < low || value > high) return Reject(NavReject::kOutOfRange), false;
  return Store(ScalarSample{sample.utime, value, sigma}, is_depth ? &depth_ : &altitude_);
}

std::uint32_t NavBuffer::Insert(const NavSample& sample) noexcept {
  if (!IsTime(sample.utime)) return Reject(NavReject::kOutOfRange), 0;
  NavSample taken;
  for (const NavField field : {NavField::kPosition, NavField::kVelocity, NavField::kWater}) {
    if (sample.Has(field) && InsertVector(field, sample)) taken.Set(field);
  }
  if (sample.Has(NavField::kAttitude) && InsertAttitude(sample)) taken.Set(NavField::kAttitude);
  for (const NavField field : {NavField::kDepth, NavField::kAltitude}) {
    if (sample.Has(field) && InsertScalar(field, sample)) taken.Set(field);
  }
  return taken.valid;
}

template <class Sample>
bool NavBuffer::Interpolate(const TimedRingBuffer<Sample>& ring, Utime utime,
                            Sample* result) const noexcept {
  if (ring.empty()) return false;
  const std::size_t after = ring.LowerBound(utime);
  const bool has_after = after < ring.size();
  if (has_after && ring[after].utime == utime) return *result = ring[after], true;
  if (has_after && after > 0) {
    const Sample& a = ring[after - 1];
    const Sample& b = ring[after];
    const double gap_s = SecondsFromUs(b.utime - a.utime);
    if (gap_s > options_.max_gap_s) return false;
    const double fraction = SecondsFromUs(utime - a.utime) / gap_s;
    *result = {utime, Mix(a.value, b.value, fraction), Larger(a.sigma, b.sigma)};
    return true;
  }
  const Sample& nearest = has_after ? ring[after] : ring.back();
  if (std::abs(SecondsFromUs(utime - nearest.utime)) > kOneSidedPart * options_.max_gap_s)
    return false;
  *result = {utime, nearest.value, nearest.sigma};
  return true;
}

NavSample NavBuffer::At(Utime utime) const noexcept {
  NavSample result;
  result.utime = utime;
  if (VectorSample v; Interpolate(position_, utime, &v)) {
    result.Set(NavField::kPosition);
    result.position_ned_m = v.value;
    result.sigma_position_m = v.sigma;
  }
  if (AttitudeSample a; Interpolate(attitude_, utime, &a)) {
    result.Set(NavField::kAttitude);
    result.ned_from_body = a.value;
    result.sigma_attitude_rad = a.sigma;
  }
  if (VectorSample v; Interpolate(velocity_, utime, &v)) {
    result.Set(NavField::kVelocity);
    result.velocity_body_mps = v.value;
    result.sigma_velocity_mps = v.sigma;
  }
  if (ScalarSample s; Interpolate(depth_, utime, &s)) {
    result.Set(NavField::kDepth);
    result.depth_m = s.value;
    result.sigma_depth_m = s.sigma;
  }
  if (ScalarSample s; Interpolate(altitude_, utime, &s)) {
    result.Set(NavField::kAltitude);
    result.altitude_m = s.value;
    result.sigma_altitude_m = s.sigma;
  }
  if (VectorSample v; Interpolate(water_, utime, &v)) {
    result.Set(NavField::kWater);
    result.temperature_c = v.value.x();
    result.salinity_psu = v.value.y();
  }
  return result;
}

NavSample NavBuffer::WaterAt(Utime utime) const noexcept {
  NavSample result;
  result.utime = utime;
  const std::size_t water = water_.LowerBound(utime + 1), depth = depth_.LowerBound(utime + 1);
  if (water == 0) return result;
  result.Set(NavField::kWater);
  result.temperature_c = water_[water - 1].value.x();
  result.salinity_psu = water_[water - 1].value.y();
  if (depth > 0) {
    result.Set(NavField::kDepth);
    result.depth_m = depth_[depth - 1].value;
    result.sigma_depth_m = depth_[depth - 1].sigma;
  }
  return result;
}

namespace {

// The stated sigma, component by component, or else the default.
Vec3 StatedOr(const Vec3& sigma, const Vec3& fallback) {
  return (sigma.array() > 0.0).select(sigma, fallback);
}

// Replaces the vertical part by what it and the depth difference say together: a Kalman update.
void FuseDepth(double depth_change_m, double variance_m2, NavMotion* motion) {
  const Vec3 gain = motion->covariance_m2.col(2) / (motion->covariance_m2(2, 2) + variance_m2);
  motion->displacement_ned_m += gain * (depth_change_m - motion->displacement_ned_m.z());
  const Mat3 before = motion->covariance_m2;
  motion->covariance_m2 -= gain * before.row(2);
}

}  // namespace

Expected<NavMotion> NavBuffer::DeadReckon(Utime start, Utime end,
                                          const NavSample& defaults) const noexcept {
  if (end < start) return Fail(Errc::kOutOfOrder, "end");
  AttitudeSample attitude;
  VectorSample velocity;
  if (!Interpolate(attitude_, start, &attitude)) return Fail(Errc::kNotEnoughData, "attitude");
  if (!Interpolate(velocity_, start, &velocity)) return Fail(Errc::kNotEnoughData, "velocity");

  NavMotion motion;
  motion.ned_from_body_start = attitude.value;
  Vec3 velocity_ned = attitude.value * velocity.value;
  Utime time = start;
  // Each velocity sample inside the interval, then the end itself: at most the ring's size.
  for (std::size_t i = velocity_.LowerBound(start + 1); time < end; ++i) {
    const Utime next = i < velocity_.size() ? std::min(velocity_[i].utime, end) : end;
    if (!Interpolate(attitude_, next, &attitude)) return Fail(Errc::kNotEnoughData, "attitude");
    if (!Interpolate(velocity_, next, &velocity)) return Fail(Errc::kNotEnoughData, "velocity");
    const double seconds = SecondsFromUs(next - time);
    if (seconds > options_.max_gap_s) return Fail(Errc::kNotEnoughData, "velocity");
    const Vec3 next_velocity_ned = attitude.value * velocity.value;
    motion.displacement_ned_m += 0.5 * seconds * (velocity_ned + next_velocity_ned);
    const Vec3 sigma_m = seconds * StatedOr(velocity.sigma, defaults.sigma_velocity_mps);
    const Mat3 ned_from_body = attitude.value.toRotationMatrix();
    motion.covariance_m2 +=
        ned_from_body * sigma_m.cwiseAbs2().asDiagonal() * ned_from_body.transpose();
    velocity_ned = next_velocity_ned;
    time = next;
  }
  motion.ned_from_body_end = attitude.value;

  // A constant attitude error e turns the displacement d into d + e x d.
  const Vec3 sigma_rad = StatedOr(attitude.sigma, defaults.sigma_attitude_rad);
  const Mat3 lever = Hat(motion.displacement_ned_m);
  motion.covariance_m2 += lever * sigma_rad.cwiseAbs2().asDiagonal() * lever.transpose();

  ScalarSample depth_start, depth_end;
  if (end > start && Interpolate(depth_, start, &depth_start) &&
      Interpolate(depth_, end, &depth_end)) {
    const double sigma = depth_end.sigma > 0.0 ? depth_end.sigma : defaults.sigma_depth_m;
    FuseDepth(depth_end.value - depth_start.value, 2.0 * sigma * sigma, &motion);
  }
  return motion;
}

Expected<VelocityIntegral> NavBuffer::IntegrateVelocity(Utime start, Utime end,
                                                        const NavSample& defaults) const noexcept {
  if (end < start) return Fail(Errc::kOutOfOrder, "end");
  AttitudeSample attitude;
  VectorSample velocity;
  if (!Interpolate(attitude_, start, &attitude)) return Fail(Errc::kNotEnoughData, "attitude");
  if (!Interpolate(velocity_, start, &velocity)) return Fail(Errc::kNotEnoughData, "velocity");

  VelocityIntegral sums;
  Mat3 ned_from_body = attitude.value.toRotationMatrix();
  const Mat3 start_rotation = ned_from_body;
  const Vec3 start_velocity_ned = ned_from_body * velocity.value;
  Vec3 velocity_ned = start_velocity_ned;
  Mat3 turned_hat = ned_from_body * Hat(velocity.value);
  Utime time = start;
  int num_segments = 0;
  // Each velocity sample inside the interval, then the end itself: at most the ring's size.
  for (std::size_t i = velocity_.LowerBound(start + 1); time < end; ++i) {
    const Utime next = i < velocity_.size() ? std::min(velocity_[i].utime, end) : end;
    if (!Interpolate(attitude_, next, &attitude)) return Fail(Errc::kNotEnoughData, "attitude");
    if (!Interpolate(velocity_, next, &velocity)) return Fail(Errc::kNotEnoughData, "velocity");
    const double seconds = SecondsFromUs(next - time);
    if (seconds > options_.max_gap_s) return Fail(Errc::kNotEnoughData, "velocity");
    ned_from_body = attitude.value.toRotationMatrix();
    const Vec3 next_velocity_ned = ned_from_body * velocity.value;
    const Mat3 next_hat = ned_from_body * Hat(velocity.value);
    sums.displacement_ned_m += 0.5 * seconds * (velocity_ned + next_velocity_ned);
    sums.by_misalignment += 0.5 * seconds * (turned_hat + next_hat);
    // A part of the time between two samples has their whole noise: it is shared with the rest.
    double period_s = seconds;
    if (i > 0 && i < velocity_.size())
      period_s = std::max(period_s, SecondsFromUs(velocity_[i].utime - velocity_[i - 1].utime));
    const Vec3 variance =
        StatedOr(velocity.sigma, defaults.sigma_velocity_mps).cwiseAbs2() * seconds * period_s;
    sums.covariance_m2 += ned_from_body * variance.asDiagonal() * ned_from_body.transpose();
    velocity_ned = next_velocity_ned;
    turned_hat = next_hat;
    time = next;
    ++num_segments;
  }
  sums.turned = ned_from_body - start_rotation;
  sums.velocity_change_mps = velocity_ned - start_velocity_ned;
  if (num_segments > 0) {
    const Vec3 sigma_rad = StatedOr(attitude.sigma, defaults.sigma_attitude_rad);
    const Mat3 lever = Hat(sums.displacement_ned_m);
    sums.covariance_m2 += lever * sigma_rad.cwiseAbs2().asDiagonal() * lever.transpose() /
                          static_cast<double>(num_segments);
  }
  return sums;
}

}  // namespace rsfm
