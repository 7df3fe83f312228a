// A map in a unit of its own becomes metric, and the world NED, as soon as anything says how long
// it is: the Doppler log, a change of depth, the range to the bottom, two positions.
#pragma once

#include <optional>

#include "rsfm/mapping/map.h"
#include "rsfm/mapping/nav_aid.h"

namespace rsfm {

struct MetricWorld {
  double scale = 1.0;        // metres to the map's unit
  double sigma_scale = 0.0;  // one standard deviation
  Quat ned_from_world = Quat::Identity();
  Vec3 origin_ned_m = Vec3::Zero();  // where the map's origin is: ned = scale R x + origin
  bool has_position = false;         // the origin is that of a fix, not of the first keyframe
};

// From all placed keyframes: the scale by least squares over what navigation has at their times,
// the rotation from their attitudes. Nothing without attitudes, or where the scale's deviation is
// more than `max_part` of it.
std::optional<MetricWorld> FindMetricWorld(const Map& map, const NavAid& nav,
                                           double max_part = 0.05) noexcept;

// Moves all keyframes and landmarks into that world. Covariances of keyframes are scaled along.
void MoveTo(const MetricWorld& world, Map* map) noexcept;

// Moves all keyframes and landmarks by that much; the place of all becomes uncertain by these
// sigmas.
void Translate(const Vec3& by_m, const Vec3& sigma_m, Map* map) noexcept;

}  // namespace rsfm
