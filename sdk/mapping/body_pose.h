// The pose that is published: the body's, from the camera's.
#pragma once

#include "rsfm/base/rigid3.h"

namespace rsfm {

// The covariance is of (position along, small rotation about) the world's axes.
struct BodyPose {
  Rigid3 world_from_body;
  Mat6 covariance;
};
// From the covariance of the camera's left perturbation (rotation [rad], translation [m]).
BodyPose ToBodyPose(const Rigid3& camera_from_world, const Mat6& covariance,
                    const Rigid3& body_from_camera) noexcept;

}  // namespace rsfm
