// Where the simulated vehicle is at any moment.
#pragma once

#include <memory>

#include "rsfm/base/rigid3.h"

namespace rsfm::simulator {

struct BodyMotion {
  Rigid3 world_from_body;                    // world: NED; body: FRD
  Vec3 velocity_in_body_mps = Vec3::Zero();  // over ground
  Vec3 rate_in_body_radps = Vec3::Zero();
};

class Trajectory {
 public:
  virtual ~Trajectory() = default;

  virtual double duration_s() const = 0;
  // Smooth in time; outside [0, duration] the path is held at its ends.
  virtual Rigid3 WorldFromBody(double time_s) const = 0;

  // Velocity and rate by central differences over 2 ms.
  BodyMotion MotionAt(double time_s) const;
};

// Parallel legs, centred on the world's origin, with half turns in between.
struct LawnmowerOptions {
  enum class Turns {
    kRotate,  // the bow follows the path, as a torpedo does
    kStrafe,  // the heading stays, as a hovering vehicle's may
  };

  int legs = 3;
  double leg_length_m = 8.0;
  double leg_spacing_m = 1.2;
  double altitude_m = 2.0;   // above the mean floor
  double heading_deg = 0.0;  // of the first leg; the next legs lie to its right
  double speed_mps = 0.4;
  Turns turns = Turns::kStrafe;
  double turn_radius_m = 0.4;       // at most; half the spacing where that is less
  double max_turn_rate_dps = 12.0;  // slows the vehicle down in its turns
  double max_acceleration_mps2 = 0.1;
  // Slow sway about the plan, standard deviations.
  double roll_deg = 1.5;
  double pitch_deg = 1.5;
  double yaw_deg = 2.0;
  double sway_m = 0.05;  // north and east
  double heave_m = 0.08;
  double sway_period_s = 9.0;
  std::uint64_t seed = 1;
};

// `floor_depth_m` is the depth of the mean floor in the world. Preconditions: legs >= 1, lengths,
// speed, limits and period positive.
std::unique_ptr<Trajectory> MakeLawnmower(const LawnmowerOptions& options, double floor_depth_m);

}  // namespace rsfm::simulator
