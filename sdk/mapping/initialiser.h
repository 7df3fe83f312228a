// The first two views of a map: a pair with enough parallax among the keyframes that have no pose
// yet.
#pragma once

#include "rsfm/estimation/two_view.h"
#include "rsfm/mapping/frame_placer.h"
#include "rsfm/mapping/nav_aid.h"

namespace rsfm {

struct InitialPair {
  SlotId first, second;  // second is the newer
  Rigid3 second_from_first;
  Mat6 covariance = Mat6::Zero();  // of its left perturbation, length of the baseline apart
  bool is_metric = false;          // the length comes from navigation, or from the port's geometry
  int num_inliers = 0;
};

class Initialiser {
 public:
  // The only place that allocates.
  Initialiser(const MapperOptions& options, const AnyCamera& camera);

  // The best pair of `newer` with one of `placer`'s matched keyframes (see MatchWith). The
  // baseline's length is navigation's where `nav` gives it to better than a fifth.
  //   kNotEnoughInliers  no pair has init_min_inliers; `detail` is the most there were
  //   kDegenerate        too little parallax, or the geometry does not determine the pose
  Expected<InitialPair> FindPair(const Map& map, SlotId newer,
                                 std::span<const KeyframeMatches> matches,
                                 const NavAid& nav) noexcept;

  std::size_t bytes() const { return two_view_.bytes() + pixels_a_.bytes() + pixels_b_.bytes(); }

 private:
  MapperOptions options_;
  AnyCamera camera_;
  TwoViewEstimator two_view_;
  FixedVector<Vec2> pixels_a_, pixels_b_;
};

}  // namespace rsfm
