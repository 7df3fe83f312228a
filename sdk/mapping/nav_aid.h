// What navigation contributes to mapping: where the camera should be, how far it has moved, and
// factors for window adjustment.
#pragma once

#include <optional>

#include "rsfm/base/rigid3.h"
#include "rsfm/estimation/nav_factor.h"
#include "rsfm/mapping/mapper_options.h"
#include "rsfm/navigation/nav_buffer.h"

namespace rsfm {

// A camera's motion in its own frame at the start.
struct CameraMotion {
  Rigid3 start_from_end;
  Mat3 displacement_covariance_m2 = Mat3::Zero();  // axes of the start camera
  Mat3 rotation_covariance_rad2 = Mat3::Zero();

  double baseline_m() const { return start_from_end.translation.norm(); }
  // Standard deviation along the displacement.
  double sigma_baseline_m() const;
};

class NavAid {
 public:
  // kInvalidArgument as NavBuffer::Create. The only place that allocates.
  static Expected<NavAid> Create(const MapperOptions& options, const Rigid3& body_from_camera);

  NavBuffer& buffer() { return buffer_; }
  const NavBuffer& buffer() const { return buffer_; }

  // From velocity, attitude and depth, or else from two positions and attitudes; whichever is more
  // certain. Nothing when neither spans the interval.
  std::optional<CameraMotion> Motion(Utime start, Utime end) const noexcept;

  // world_from_camera of a sample that has an attitude, where the world is NED: position 0 (and
  // depth) where the sample has none. Nothing without an attitude.
  std::optional<Rigid3> CameraFromNed(const NavSample& sample) const noexcept;

  // How uncertain that is, of the left perturbation (rotation, translation) of camera_from_world;
  // zero in what defines where the world is. `heading_bias_rad` is the compass's, one sigma.
  Mat6 CovarianceFromNed(const NavSample& sample, double heading_bias_rad) const noexcept;

  // Factors for window adjustment, as far as there are measurements; robust where the sensor may be
  // wrong for once. `rate_radps` and `velocity_mps` are the body's about and along the world's
  // axes, as the window has them: the clock's lever.
  std::optional<NavFactor> AttitudeFactor(int keyframe, const NavSample& sample,
                                          const Vec3& rate_radps) const noexcept;
  std::optional<NavFactor> DepthFactor(int keyframe, const NavSample& sample,
                                       const Vec3& velocity_mps) const noexcept;
  // Of the body between two keyframes, a before b.
  std::optional<NavFactor> DisplacementFactor(int a, int b, Utime start, Utime end) const noexcept;
  // The position nearest to the keyframe's time among those at begin <= time < end, moved to that
  // time along `velocity_mps`.
  std::optional<NavFactor> PositionFactor(int keyframe, Utime utime, Utime begin, Utime end,
                                          const Vec3& velocity_mps) const noexcept;

  // What is used where a sample does not state its own sigmas.
  const NavSample& defaults() const { return defaults_; }
  const Rigid3& body_from_camera() const { return body_from_camera_; }
  std::size_t bytes() const { return buffer_.bytes(); }

 private:
  NavAid(const MapperOptions& options, const Rigid3& body_from_camera, NavBuffer buffer);
  std::optional<NavMotion> BodyMotion(Utime start, Utime end) const noexcept;

  Rigid3 body_from_camera_;
  NavSample defaults_;
  NavBuffer buffer_;
};

}  // namespace rsfm
