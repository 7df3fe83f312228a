// What two views alone can do: the first pair of a map, and a frame whose neighbour shows the same
// scene but few landmarks yet, as where stills overlap by half.
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

  // The same camera in other water; allocates nothing.
  void SetCamera(const AnyCamera& camera) noexcept { camera_ = camera; }

  // The best pair of `newer` with one of `placer`'s matched keyframes (see MatchWith). The
  // baseline's length is navigation's where `nav` gives it to better than a fifth.
  //   kNotEnoughInliers  no pair has init_min_inliers; `detail` is the most there were
  //   kDegenerate        too little parallax, or the geometry does not determine the pose
  //   kNotEnoughData     the other keyframes are from before navigation came: with them the map
  //                      would be without scale for good
  Expected<InitialPair> FindPair(const Map& map, SlotId newer,
                                 std::span<const KeyframeMatches> matches,
                                 const NavAid& nav) noexcept;

  // The pose of a frame from its matches with a placed keyframe: the relative pose from all of
  // them, the baseline's length from the landmarks among them or else from navigation (only where
  // `scale_is_metric`). `reference` is that keyframe, num_inliers counts matches.
  //   kNotEnoughInliers, kDegenerate  as FindPair; kNotEnoughData  nothing gives the length
  Expected<Placement> PlaceBeside(const Map& map, const FrameView& frame, Utime utime,
                                  std::span<const KeyframeMatches> matches, const NavAid& nav,
                                  bool scale_is_metric) noexcept;

  std::size_t bytes() const { return two_view_.bytes() + pixels_a_.bytes() + pixels_b_.bytes(); }

 private:
  Expected<TwoViewReport> Relate(const Map& map, std::span<const Feature> features,
                                 const KeyframeMatches& with, const CameraMotion* motion) noexcept;
  // The baseline's length that puts the matched landmarks on their rays: the median over those that
  // agree with it. 0 where fewer than eight do.
  double ScaleFromLandmarks(const Map& map, const FrameView& frame, const KeyframeMatches& with,
                            const Rigid3& frame_from_keyframe) noexcept;

  MapperOptions options_;
  AnyCamera camera_;
  TwoViewEstimator two_view_;
  FixedVector<Vec2> pixels_a_, pixels_b_;
  FixedVector<double> scales_;
};

}  // namespace rsfm
