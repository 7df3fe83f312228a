#include "rsfm/mapping/metric_scale.h"

#include <array>
#include <cmath>

namespace rsfm {
namespace {

constexpr int kMinKeyframes = 3;

// One unknown by weighted least squares over rows measured = scale * modelled.
struct ScaleSum {
  double information = 0.0, product = 0.0;

  void Add(double modelled, double measured, double sigma) {
    const double weight = 1.0 / (sigma * sigma);
    information += weight * modelled * modelled;
    product += weight * modelled * measured;
  }
};

// Rows measured = scale * modelled + offset, the offset eliminated.
struct OffsetSum {
  double weight = 0.0, modelled = 0.0, measured = 0.0, squares = 0.0, products = 0.0;

  void Add(double model, double measurement, double sigma) {
    const double w = 1.0 / (sigma * sigma);
    weight += w;
    modelled += w * model;
    measured += w * measurement;
    squares += w * model * model;
    products += w * model * measurement;
  }
  void AddTo(ScaleSum* sum) const {
    if (!(weight > 0.0)) return;
    sum->information += squares - modelled * modelled / weight;
    sum->product += products - modelled * measured / weight;
  }
};

struct Placed {
  const Keyframe* keyframe = nullptr;
  NavSample nav;
  Vec3 camera = Vec3::Zero();  // NED axes, the map's unit
  Vec3 lever = Vec3::Zero();   // of the camera from the body, NED, m
};

Placed Place(const Keyframe& keyframe, const NavAid& nav, const Quat& ned_from_world) {
  Placed placed;
  placed.keyframe = &keyframe;
  placed.nav = nav.buffer().At(keyframe.utime);
  placed.camera = ned_from_world * keyframe.camera_from_world.OriginOfTarget();
  placed.lever = placed.nav.ned_from_body * nav.body_from_camera().translation;
  return placed;
}

// The rotation that the attitudes agree on: the mean of quaternions of one sign.
std::optional<Quat> MeanRotation(const Map& map, const NavAid& nav) {
  Vec4 sum = Vec4::Zero();
  int count = 0;
  for (const SlotId id : map.keyframes()) {
    const Keyframe& keyframe = map.keyframe(id);
    const NavSample sample = nav.buffer().At(keyframe.utime);
    if (!keyframe.is_placed || !sample.Has(NavField::kAttitude)) continue;
    const Quat rotation = sample.ned_from_body * nav.body_from_camera().rotation *
                          keyframe.camera_from_world.rotation;
    sum += sum.dot(rotation.coeffs()) < 0.0 ? Vec4(-rotation.coeffs()) : Vec4(rotation.coeffs());
    ++count;
  }
  if (count < kMinKeyframes || !(sum.norm() > 0.5 * count)) return std::nullopt;
  return Quat(Vec4(sum.normalized()));
}

double Stated(double sigma, double fallback) { return sigma > 0.0 ? sigma : fallback; }

// What the log says of the way between two keyframes.
void AddDisplacement(const Placed& a, const Placed& b, const NavAid& nav, ScaleSum* sum) {
  const auto moved =
      nav.buffer().IntegrateVelocity(a.keyframe->utime, b.keyframe->utime, nav.defaults());
  if (!moved) return;
  const Vec3 between = b.camera - a.camera;
  const Vec3 measured = moved->displacement_ned_m + b.lever - a.lever;
  for (int axis = 0; axis < 3; ++axis)
    sum->Add(between[axis], measured[axis], std::sqrt(moved->covariance_m2(axis, axis)) + 1e-3);
}

// The range to the bottom against the mean height of the landmarks about the vertical.
void AddAltitude(const Map& map, SlotId id, const Placed& placed, const NavAid& nav,
                 const Quat& ned_from_world, ScaleSum* sum) {
  if (!placed.nav.Has(NavField::kAltitude)) return;
  constexpr double kMaxAside = 0.3, kPart = 0.05;
  double total = 0.0;
  int count = 0;
  for (const SlotId landmark : map.landmarks_of(id)) {
    const Landmark* point = map.landmarks().Find(landmark);
    if (point == nullptr) continue;
    const Vec3 below = ned_from_world * point->point_in_world - placed.camera;
    if (!(below.head<2>().norm() < kMaxAside * below.z())) continue;
    total += below.z();
    ++count;
  }
  if (count < 3) return;
  const double sensor = Stated(placed.nav.sigma_altitude_m, nav.defaults().sigma_altitude_m);
  sum->Add(total / count, placed.nav.altitude_m - placed.lever.z(),
           std::hypot(sensor, kPart * placed.nav.altitude_m));
}

}  // namespace

std::optional<MetricWorld> FindMetricWorld(const Map& map, const NavAid& nav,
                                           double max_part) noexcept {
  const std::optional<Quat> rotation = MeanRotation(map, nav);
  if (!rotation) return std::nullopt;
  ScaleSum sum;
  OffsetSum depths;
  std::array<OffsetSum, 3> positions;
  MetricWorld world;
  world.ned_from_world = *rotation;
  Placed first, before, first_fix;
  for (const SlotId id : map.keyframes()) {
    const Keyframe& keyframe = map.keyframe(id);
    if (!keyframe.is_placed) continue;
    const Placed placed = Place(keyframe, nav, *rotation);
    if (!placed.nav.Has(NavField::kAttitude)) continue;
    AddAltitude(map, id, placed, nav, *rotation, &sum);
    if (before.keyframe != nullptr) AddDisplacement(before, placed, nav, &sum);
    if (placed.nav.Has(NavField::kDepth))
      depths.Add(placed.camera.z(), placed.nav.depth_m + placed.lever.z(),
                 Stated(placed.nav.sigma_depth_m, nav.defaults().sigma_depth_m));
    if (placed.nav.Has(NavField::kPosition)) {
      for (int axis = 0; axis < 3; ++axis)
        positions[static_cast<std::size_t>(axis)].Add(
            placed.camera[axis], placed.nav.position_ned_m[axis] + placed.lever[axis],
            Stated(placed.nav.sigma_position_m[axis], nav.defaults().sigma_position_m[axis]));
      if (first_fix.keyframe == nullptr) first_fix = placed;
    }
    if (first.keyframe == nullptr) first = placed;
    before = placed;
  }
  depths.AddTo(&sum);
  for (const OffsetSum& axis : positions) axis.AddTo(&sum);
  if (first.keyframe == nullptr || !(sum.information > 0.0)) return std::nullopt;
  world.scale = sum.product / sum.information;
  world.sigma_scale = 1.0 / std::sqrt(sum.information);
  if (!(world.scale > 0.0) || !(world.sigma_scale < max_part * world.scale)) return std::nullopt;
  world.has_position = first_fix.keyframe != nullptr;
  const Placed& known = world.has_position ? first_fix : first;
  Vec3 body = world.has_position ? known.nav.position_ned_m : Vec3::Zero();
  if (known.nav.Has(NavField::kDepth)) body.z() = known.nav.depth_m;
  world.origin_ned_m = body + known.lever - world.scale * known.camera;
  return world;
}

void MoveTo(const MetricWorld& world, Map* map) noexcept {
  for (const SlotId id : map->keyframes()) {
    Keyframe& keyframe = map->keyframe(id);
    Rigid3& pose = keyframe.camera_from_world;
    const Quat rotation = (pose.rotation * world.ned_from_world.conjugate()).normalized();
    pose = Rigid3(rotation, world.scale * pose.translation - rotation * world.origin_ned_m);
    keyframe.covariance.topRightCorner<3, 3>() *= world.scale;
    keyframe.covariance.bottomLeftCorner<3, 3>() *= world.scale;
    keyframe.covariance.bottomRightCorner<3, 3>() *= world.scale * world.scale;
  }
  map->landmarks().ForEach([&](SlotId, Landmark& landmark) {
    landmark.point_in_world =
        world.ned_from_world * (world.scale * landmark.point_in_world) + world.origin_ned_m;
    landmark.is_changed = true;
    landmark.fresh_from = 0;
  });
}

void Translate(const Vec3& by_m, const Vec3& sigma_m, Map* map) noexcept {
  const Mat3 variance = sigma_m.cwiseAbs2().asDiagonal();
  for (const SlotId id : map->keyframes()) {
    Keyframe& keyframe = map->keyframe(id);
    const Mat3 camera_from_world = keyframe.camera_from_world.rotation.toRotationMatrix();
    keyframe.camera_from_world.translation -= camera_from_world * by_m;
    keyframe.covariance.bottomRightCorner<3, 3>() +=
        camera_from_world * variance * camera_from_world.transpose();
  }
  map->landmarks().ForEach([&](SlotId, Landmark& landmark) {
    landmark.point_in_world += by_m;
    landmark.is_changed = true;
  });
}

}  // namespace rsfm
