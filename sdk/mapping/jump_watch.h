// Which poses are jumps: those that are not where the pose before and navigation put them, by their
// covariance, and those that the owner knows to be.
#pragma once

#include "rsfm/mapping/nav_reckoning.h"

namespace rsfm {

class JumpWatch {
 public:
  // A new world: what was published before says nothing of the next pose.
  void BeginWorld() noexcept { has_published_ = is_expected_ = false; }
  // The next pose is one, whatever its covariance says: a loop was closed.
  void Expect() noexcept { is_expected_ = true; }

  // The next pose to be published; `nav` is null where the world is not metric. True for a jump: of
  // place or of rotation by more than three sigmas, and more than anybody notices.
  bool Publish(const KnownPose& pose, const NavAid* nav, const NavErrors& errors) noexcept;

 private:
  KnownPose published_;  // the last
  bool has_published_ = false;
  bool is_expected_ = false;
};

}  // namespace rsfm
