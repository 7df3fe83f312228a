#include "rsfm/mapping/nav_reckoning.h"

namespace rsfm {
namespace {

// Takes out of a displacement what the window knows of the log's scale and mounting, and adds how
// well it knows them: nav_factor.h's (D + B m) / (1 + s), to first order in s, for a body that does
// not turn far.
void CorrectVelocity(const NavAid& nav, const NavErrors& errors, CameraMotion* motion) noexcept {
  const Mat6& covariance = errors.covariance;
  const Mat3 camera_from_body = nav.body_from_camera().rotation.conjugate().toRotationMatrix();
  Vec3& moved = motion->start_from_end.translation;
  const Vec3 misalignment = camera_from_body * errors.states.segment<3>(kMisalignment);
  moved = (1.0 - errors.states[kVelocityScale]) * (moved + moved.cross(misalignment));
  const Mat3 lever = Hat(moved) * camera_from_body;
  motion->displacement_covariance_m2 +=
      covariance(kVelocityScale, kVelocityScale) * moved * moved.transpose() +
      lever * covariance.block<3, 3>(kMisalignment, kMisalignment) * lever.transpose();
}

}  // namespace

std::optional<KnownPose> MoveOn(const KnownPose& from, Utime utime, const NavAid& nav,
                                const NavErrors& errors) noexcept {
  auto motion = nav.Motion(from.utime, utime);
  if (!motion) return std::nullopt;
  CorrectVelocity(nav, errors, &*motion);
  const Rigid3 end_from_start = motion->start_from_end.Inverse();
  const Mat6 adjoint = AdjointSe3(end_from_start);
  Mat6 moved = Mat6::Zero();
  moved.topLeftCorner<3, 3>() = motion->rotation_covariance_rad2;
  const Mat3 rotation = end_from_start.rotation.toRotationMatrix();
  moved.bottomRightCorner<3, 3>() =
      rotation * motion->displacement_covariance_m2 * rotation.transpose();
  return KnownPose{utime, end_from_start * from.camera_from_world,
                   adjoint * from.covariance * adjoint.transpose() + moved};
}

}  // namespace rsfm
