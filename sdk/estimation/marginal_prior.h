// What window adjustment remembers of keyframes and landmarks that have left it: a quadratic cost
// over the poses that stay and the states of the navigation sensors, linearised once, at the first
// estimates.
//
//   cost(x) = c + g' d + d' H d / 2,   d = (Log(T_k T0_k^-1) ..., states - states0)
//
// [Dong-Si & Mourikis 2011, ICRA, "Motion tracking with fixed-lag smoothing: algorithm and
// consistency", sec. III, for the elimination and why a pose that the quadratic knows keeps its
// first estimate in it] The perturbations are the cameras' own (rigid3.h), so that moving or
// turning the whole world changes nothing in H: directions that nothing holds stay free.
#pragma once

#include "rsfm/base/fixed_vector.h"
#include "rsfm/estimation/block_cholesky.h"
#include "rsfm/estimation/nav_factor.h"

namespace rsfm {

struct MarginalPrior {
  MarginalPrior() = default;
  // The only place that allocates.
  explicit MarginalPrior(int max_keyframes);

  // Forgets all: no poses, no states.
  void Clear() noexcept;
  // Only the sensors' states, independent of each other. A sigma of 0 pins a state to its value.
  void StartWithStates(const NavStates& states, const NavStates& sigmas) noexcept;
  // The states wander: between here and the next use their variances grow by this much. What they
  // have in common with the poses fades accordingly.
  void AddNoise(const NavStates& variances) noexcept;
  // The whole world's place becomes uncertain by this variance along a unit direction, m^2.
  void AddTranslationNoise(const Vec3& direction_in_world, double variance_m2) noexcept;
  // The world moves: the first estimates go along.
  void Translate(const Vec3& by_m) noexcept;
  // Moves a first estimate to where the pose is now, where it has gone too far for the quadratic's
  // linearisation: the cost at and around the pose stays.
  void Rebase(int keyframe, const Rigid3& camera_from_world) noexcept;

  int num_keyframes() const { return static_cast<int>(first_estimates.size()); }
  int num_blocks() const { return num_keyframes() + (has_states ? kNavBlocks : 0); }
  std::size_t bytes() const {
    return first_estimates.bytes() + information.bytes() + gradient.bytes() + direction_.bytes() +
           product_.bytes();
  }

  FixedVector<Rigid3> first_estimates;  // camera_from_world
  bool has_states = false;
  NavStates first_states = NavStates::Zero();
  BlockCholesky information;  // H, not factorised: poses, then two blocks of states
  FixedVector<Vec6> gradient;
  double cost = 0.0;

 private:
  void AddNoiseAlongDirection(double variance) noexcept;
  FixedVector<Vec6> direction_, product_;
};

// x such that Exp(x) a = b, and its derivative to a left perturbation of b, to second order in x.
Vec6 PoseDifference(const Rigid3& b, const Rigid3& a, Mat6* d_difference_d_b) noexcept;

}  // namespace rsfm
