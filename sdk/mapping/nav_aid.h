// What navigation contributes to mapping: where the camera should be, how far it has moved, and
// priors for bundle adjustment.
#pragma once

#include <optional>

#include "rsfm/base/rigid3.h"
#include "rsfm/estimation/pose_prior.h"
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

  // Position, attitude and depth of one keyframe, as far as the sample has them; each call of
  // f(const PosePrior&) is one prior.
  template <class F>
  void ForEachPrior(int keyframe, const NavSample& sample, F&& f) const {
    if (const auto p = PositionPrior(keyframe, sample)) f(*p);
    if (const auto p = AttitudePrior(keyframe, sample)) f(*p);
    if (const auto p = DepthPrior(keyframe, sample)) f(*p);
  }
  // The displacement between two keyframes, when velocity and attitude give it.
  std::optional<PosePrior> DisplacementPrior(int a, int b, Utime start, Utime end) const noexcept;

  // What is used where a sample does not state its own sigmas.
  const NavSample& defaults() const { return defaults_; }
  const Rigid3& body_from_camera() const { return body_from_camera_; }
  std::size_t bytes() const { return buffer_.bytes(); }

 private:
  NavAid(const MapperOptions& options, const Rigid3& body_from_camera, NavBuffer buffer);
  std::optional<NavMotion> BodyMotion(Utime start, Utime end) const noexcept;
  std::optional<PosePrior> PositionPrior(int keyframe, const NavSample& sample) const noexcept;
  std::optional<PosePrior> AttitudePrior(int keyframe, const NavSample& sample) const noexcept;
  std::optional<PosePrior> DepthPrior(int keyframe, const NavSample& sample) const noexcept;

  Rigid3 body_from_camera_;
  NavSample defaults_;
  NavBuffer buffer_;
};

}  // namespace rsfm
