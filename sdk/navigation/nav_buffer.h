// The recent navigation in fixed memory: one time-ordered ring for each kind of measurement, since
// each sensor has its own rate. Samples are checked as they come in; what is refused is counted by
// reason.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string_view>

#include "rsfm/base/error.h"
#include "rsfm/base/ring_buffer.h"
#include "rsfm/navigation/nav_sample.h"
#include "rsfm/navigation/repeat_watch.h"

namespace rsfm {

struct NavBufferOptions {
  int capacity = 4096;      // of each ring
  double max_gap_s = 2.0;   // samples farther apart than this are not interpolated between
  double max_late_s = 5.0;  // a sample may arrive this much after a newer one of its kind
  double max_speed_mps = 20.0;
  double max_depth_m = 12000.0;
  double min_depth_m = -20.0;       // above the surface: waves, a vehicle on deck
  double max_altitude_m = 12000.0;  // and above 0: a range of 0 is a sensor without an echo

  // kInvalidArgument; `where` is the option's name.
  Status Validate() const noexcept;
};

enum class NavReject : std::uint8_t {
  kNotFinite,      // NaN or infinite value or sigma
  kSentinel,       // the sensor's mark for "none": velocity -32.768, range 0, a negative sigma
  kOutOfRange,     // beyond the option's limit, a quaternion that is not of unit length, a sigma
                   // that no sensor has, or no time
  kRunsBackwards,  // older than the newest of its kind by more than max_late_s
  kRepeated,       // same time as a stored one of its kind
  kTooLate,        // older than the horizon: what it could tell has been summed up already
  kFrozen,         // the value before it, to the last bit, once more than chance allows
  kJump,           // farther from the one before it than a vehicle moves in the time between
};
inline constexpr int kNumNavRejects = 8;
std::string_view ToString(NavReject reason) noexcept;  // "not_finite", ...

// The body's motion between two times. Its rotation is `end * start.conjugate()`.
struct NavMotion {
  Vec3 displacement_ned_m = Vec3::Zero();
  Mat3 covariance_m2 = Mat3::Zero();
  Quat ned_from_body_start = Quat::Identity();
  Quat ned_from_body_end = Quat::Identity();
};

// The sums that a displacement factor needs (nav_factor.h), from body velocity and attitude as
// measured.
struct VelocityIntegral {
  Vec3 displacement_ned_m = Vec3::Zero();   // sum of R_i v_i dt
  Mat3 by_misalignment = Mat3::Zero();      // sum of R_i Hat(v_i) dt
  Mat3 turned = Mat3::Zero();               // R_end - R_start
  Vec3 velocity_change_mps = Vec3::Zero();  // in NED
  Mat3 covariance_m2 = Mat3::Zero();        // NED; noise alone, no biases
};

class NavBuffer {
 public:
  // The only place that allocates.
  static Expected<NavBuffer> Create(const NavBufferOptions& options);

  // Takes the sample's valid fields, each on its own; returns the bits of those taken. Late samples
  // go to their place. A sample older than a full ring is dropped as kRunsBackwards. One that is
  // kFarAheadUs beyond all others of its kind is not believed (kOutOfRange) before the third in a
  // row says so: whatever comes after it would run backwards. The first two of a kind have nothing
  // to be held against: one that is as far from them starts the kind anew.
  // A sensor that has stopped is refused from its third or fourth repeated value on, by
  // RepeatWatch; water may stay as it is. A velocity, depth or attitude that no vehicle reaches
  // from the newest one is refused (kJump) until three in a row agree with each other. Where three
  // in a row run backwards and go on, the newest of their kind was of a wrong time: the kind begins
  // anew with them.
  std::uint32_t Insert(const NavSample& sample) noexcept;
  std::uint64_t rejected(NavReject reason) const {
    return rejected_[static_cast<std::size_t>(reason)];
  }
  std::uint64_t accepted() const { return accepted_; }  // fields, not samples

  // What is known at that time: linear between the neighbouring samples, geodesic for the attitude;
  // a field whose neighbours are farther apart than max_gap_s, or on one side only and farther than
  // a tenth of it, is not valid in the result. Sigmas: the larger of the two neighbours'.
  NavSample At(Utime utime) const noexcept;

  // The water as it was last measured at or before that time, however long ago (it changes slowly):
  // kWater, and kDepth where a depth had been measured by then. Neither before the first.
  NavSample WaterAt(Utime utime) const noexcept;

  // Dead reckoning from body velocity, attitude and, for the vertical, depth, start <= end.
  // Trapezoids between the velocity samples. The covariance sums each sample's noise, an attitude
  // error constant over the interval, and the depth sensor's. Where a source states no sigma,
  // `defaults` has it (its three velocity and attitude sigmas and sigma_depth_m).
  //   kNotEnoughData  velocity or attitude has a gap over max_gap_s in the interval; `where` says
  //                   which
  //   kOutOfOrder     end before start
  Expected<NavMotion> DeadReckon(Utime start, Utime end, const NavSample& defaults) const noexcept;

  // The same sums with what is to be known of the sensors' errors left to a factor. The noise of
  // the velocities is independent from sample to sample, that of the attitudes too. Errors as
  // DeadReckon.
  Expected<VelocityIntegral> IntegrateVelocity(Utime start, Utime end,
                                               const NavSample& defaults) const noexcept;

  // f(utime, position_ned_m, sigma_m) for each position at start <= utime < end, as it was
  // measured.
  template <class F>
  void ForEachPosition(Utime start, Utime end, F&& f) const {
    for (std::size_t i = position_.LowerBound(start);
         i < position_.size() && position_[i].utime < end; ++i)
      f(position_[i].utime, position_[i].value, position_[i].sigma);
  }

  static constexpr Utime kFarAheadUs = 3'600'000'000;

  // From now on samples older than this are refused as kTooLate. Those that are there stay.
  void SetHorizon(Utime horizon) { horizon_ = std::max(horizon_, horizon); }

  // The clock was set back to about `utime`: there is no horizon any more, and kinds of measurement
  // that reach beyond it begin anew.
  void SetClockBack(Utime utime) noexcept;

  // How long its fastest sensor's measurements are kept, from velocity, attitude and depth; what a
  // ring that is not full yet forgets is nothing: the largest number.
  Utime ReachUs() const noexcept;

  std::size_t bytes() const;

 private:
  struct VectorSample {
    Utime utime = 0;
    Vec3 value = Vec3::Zero();
    Vec3 sigma = Vec3::Zero();
  };
  struct AttitudeSample {
    Utime utime = 0;
    Quat value = Quat::Identity();
    Vec3 sigma = Vec3::Zero();
  };
  struct ScalarSample {
    Utime utime = 0;
    double value = 0.0;
    double sigma = 0.0;
  };

  explicit NavBuffer(const NavBufferOptions& options);
  void Reject(NavReject reason) { ++rejected_[static_cast<std::size_t>(reason)]; }
  // The measurements of one kind, and what is known of their clock and of how they repeat.
  template <class Sample>
  struct Series : TimedRingBuffer<Sample> {
    using TimedRingBuffer<Sample>::TimedRingBuffer;
    int num_first = 0;  // taken since the start, as far as that matters
    Utime ahead = 0;    // the last that was too far ahead
    int num_ahead = 0;  // in a row
    RepeatWatch repeats;
    double jump = 0.0;       // that is none, and ...
    double jump_rate = 0.0;  // ... per second since the one before; 0: anything may be
    bool may_stay = false;   // the same for hours: no fault
    Sample jumped;           // the last that was refused as a jump
    int num_jumped = 0;      // in a row, that agree
    Utime behind = 0;        // the last that ran backwards
    int num_behind = 0;      // in a row, ascending
  };
  template <class Sample>
  static void BeginAnew(Series<Sample>* series) noexcept;
  template <class Sample>
  static bool IsBelieved(Utime utime, Series<Sample>* series) noexcept;
  template <class Sample>
  static bool HasJumped(const Sample& sample, Series<Sample>* series) noexcept;
  template <class Sample>
  static bool GoesOnBehind(Utime utime, Series<Sample>* series) noexcept;
  template <class Sample>
  bool Store(const Sample& sample, Series<Sample>* series) noexcept;
  template <class Sample>
  bool Interpolate(const TimedRingBuffer<Sample>& ring, Utime utime, Sample* result) const noexcept;
  bool InsertVector(NavField field, const NavSample& sample) noexcept;
  bool InsertAttitude(const NavSample& sample) noexcept;
  bool InsertScalar(NavField field, const NavSample& sample) noexcept;

  NavBufferOptions options_;
  Series<VectorSample> position_;
  Series<AttitudeSample> attitude_;
  Series<VectorSample> velocity_;
  Series<ScalarSample> depth_;
  Series<ScalarSample> altitude_;
  Series<VectorSample> water_;  // temperature, salinity, 0
  std::array<std::uint64_t, kNumNavRejects> rejected_{};
  std::uint64_t accepted_ = 0;
  Utime horizon_ = 0;
};

}  // namespace rsfm
