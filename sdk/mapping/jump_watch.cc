#include "rsfm/mapping/jump_watch.h"

namespace rsfm {
namespace {

constexpr double kSigmas = 3.0;
constexpr double kFloor_m = 0.02, kFloor_rad = 0.005;  // smaller jumps are none for anybody

bool IsOver(const Vec3& by, const Mat3& covariance, double floor) {
  const Mat3 floored = covariance + floor * floor * Mat3::Identity();
  return by.dot(floored.inverse() * by) > kSigmas * kSigmas;
}

bool IsJump(const Rigid3& by, const Mat6& covariance) {
  return IsOver(LogSo3(by.rotation), covariance.topLeftCorner<3, 3>(), kFloor_rad) ||
         IsOver(by.translation, covariance.bottomRightCorner<3, 3>(), kFloor_m);
}

}  // namespace

bool JumpWatch::Publish(const KnownPose& pose, const NavAid* nav,
                        const NavErrors& errors) noexcept {
  bool is_jump = is_expected_;
  if (!is_jump && has_published_ && nav != nullptr) {
    if (const auto expected = MoveOn(published_, pose.utime, *nav, errors))
      is_jump = IsJump(pose.camera_from_world * expected->camera_from_world.Inverse(),
                       expected->covariance);
  }
  published_ = pose;
  has_published_ = true;
  is_expected_ = false;
  return is_jump;
}

}  // namespace rsfm
