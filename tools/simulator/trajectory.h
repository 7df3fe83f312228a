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

// The same survey with fewer legs and shorter ones, about as long as wide as before, so that
// `images` at `rate_hz` cover it: speed, spacing and so the images' overlap stay. As it is where
// that many do not fit or it has no more.
LawnmowerOptions FitToImages(const LawnmowerOptions& options, int images, double rate_hz);

// Rings around a place, spiralling from the upper and outer one to the lower and inner one; the
// camera looks across the middle. The first image is at the start, the last one at the end.
struct OrbitOptions {
  int images = 106;
  double rings = 2.0;
  Vec2 center_ne_m = Vec2::Zero();
  double radius_north_m = 0.70;  // of the camera's path, first ring
  double radius_east_m = 0.27;
  double last_ring_scale = 0.8;   // its radii, relative to the first ring's
  double top_height_m = 0.90;     // above the floor, at the start
  double bottom_height_m = 0.62;  // at the end
  double bob_m = 0.03;
  double look_across = 0.25;      // the target lies beyond the centre by this share of the radius
  double target_height_m = 0.08;  // above the floor
  double target_wander_m = 0.15;
  double roll_deg = 10.0;  // about the optical axis, to either side
};

// Preconditions: images >= 1; rings, heights and rate positive, and the camera is never straight
// above its target.
std::unique_ptr<Trajectory> MakeOrbit(const OrbitOptions& options, const Rigid3& body_from_camera,
                                      double floor_depth_m, double rate_hz);

}  // namespace rsfm::simulator
