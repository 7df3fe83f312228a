// Poses moved on by navigation: between images, through outages, and to judge what vision says.
#pragma once

#include <optional>

#include "rsfm/mapping/nav_aid.h"

namespace rsfm {

struct KnownPose {
  Utime utime = 0;
  Rigid3 camera_from_world;        // metres, a metric world
  Mat6 covariance = Mat6::Zero();  // of the left perturbation (rotation [rad], translation [m])
};

// What the window knows of the navigation sensors' errors, and how well.
struct NavErrors {
  NavStates states = NavStates::Zero();
  Mat6 covariance = Mat6::Zero();
};

// The pose at that time, by the Doppler log (its scale and mounting as they are known), attitude
// and depth, or by positions; nothing where navigation does not span the time between.
std::optional<KnownPose> MoveOn(const KnownPose& from, Utime utime, const NavAid& nav,
                                const NavErrors& errors) noexcept;

}  // namespace rsfm
