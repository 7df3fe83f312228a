#include "rsfm/mapping/body_pose.h"

namespace rsfm {

BodyPose ToBodyPose(const Rigid3& camera_from_world, const Mat6& covariance,
                    const Rigid3& body_from_camera) noexcept {
  BodyPose result;
  const Rigid3 world_from_camera = camera_from_world.Inverse();
  result.world_from_body = world_from_camera * body_from_camera.Inverse();
  // C' = Exp(d) C makes W' = C'^-1 B^-1 = Exp(-Adjoint(C^-1) d) W.
  const Mat6 left =
      AdjointSe3(world_from_camera) * covariance * AdjointSe3(world_from_camera).transpose();
  // (rotation, translation) of a left perturbation moves the position p by translation - [p]x
  // rotation.
  Mat6 position_rotation = Mat6::Zero();
  position_rotation.topLeftCorner<3, 3>() = -Hat(result.world_from_body.translation);
  position_rotation.topRightCorner<3, 3>() = Mat3::Identity();
  position_rotation.bottomLeftCorner<3, 3>() = Mat3::Identity();
  result.covariance = position_rotation * left * position_rotation.transpose();
  return result;
}

}  // namespace rsfm
