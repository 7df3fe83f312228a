// Rings around a scene that look inwards.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "tools/simulator/trajectory.h"

namespace rsfm::simulator {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr double kRad = std::numbers::pi / 180.0;

class Orbit final : public Trajectory {
 public:
  Orbit(const OrbitOptions& options, const Rigid3& body_from_camera, double floor_depth_m,
        double rate_hz)
      : options_(options),
        camera_from_body_(body_from_camera.Inverse()),
        floor_depth_m_(floor_depth_m),
        duration_s_(std::max(1, options.images - 1) / rate_hz) {}

  double duration_s() const override { return duration_s_; }

  Rigid3 WorldFromBody(double time_s) const override {
    const double share = std::clamp(time_s / duration_s_, 0.0, 1.0);
    const OrbitOptions& o = options_;
    const double angle = kTurn * o.rings * share;
    // From the outer and upper ring to the inner and lower one, steadily; a little up and down.
    const double height = o.top_height_m + share * (o.bottom_height_m - o.top_height_m) +
                          o.bob_m * std::sin(2.7 * angle);
    const double size = 1.0 + share * (o.last_ring_scale - 1.0);
    const Vec3 center(o.center_ne_m.x(), o.center_ne_m.y(), floor_depth_m_);
    const Vec3 arm(size * o.radius_north_m * std::cos(angle),
                   size * o.radius_east_m * std::sin(angle), -height);
    const Vec3 wander(0.6 * std::sin(1.7 * angle + 0.4), 0.6 * std::sin(2.3 * angle + 1.9), 0.0);
    const Vec3 target =
        Vec3(-o.look_across * arm.x(), -o.look_across * arm.y(), -o.target_height_m) +
        o.target_wander_m * wander;
    // Camera axes: z to the target, x to the right of it and level, then rolled about z.
    const Vec3 forward = (target - arm).normalized();
    const Vec3 right = Vec3::UnitZ().cross(forward).normalized();
    Mat3 world_from_camera;
    world_from_camera << right, forward.cross(right), forward;
    const double roll = o.roll_deg * kRad * std::sin(3.1 * angle + 0.7);
    const Rigid3 camera(Quat(world_from_camera) * Quat(Eigen::AngleAxisd(roll, Vec3::UnitZ())),
                        center + arm);
    return camera * camera_from_body_;
  }

 private:
  OrbitOptions options_;
  Rigid3 camera_from_body_;
  double floor_depth_m_;
  double duration_s_;
};

}  // namespace

std::unique_ptr<Trajectory> MakeOrbit(const OrbitOptions& options, const Rigid3& body_from_camera,
                                      double floor_depth_m, double rate_hz) {
  return std::make_unique<Orbit>(options, body_from_camera, floor_depth_m, rate_hz);
}

}  // namespace rsfm::simulator
