// Navigation brought to a scene, and with it, where asked for, what of the vehicle is known less
// well than its map: how the camera is mounted, and how far the two clocks are apart.
#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "tools/offline/navigation.h"
#include "tools/offline/observability.h"

namespace rsfm {

// What is estimated beside the map, and one standard deviation of what the rig says of it.
struct MountOptions {
  bool mount = false;  // body_from_camera: lever arm and angles
  bool clock = false;  // by how much navigation's clock is ahead of the images'
  double sigma_lever_arm_m = 0.3;
  double sigma_angle_rad = 0.05;
  double sigma_clock_s = 0.3;

  bool Any() const { return mount || clock; }
};

class NavigationFit {
 public:
  NavigationFit(NavigationInput given, const MountOptions& options)
      : given_(std::move(given)), options_(options), now_(given_) {}

  // As it is used: the samples' times and body_from_camera as estimated last.
  const NavigationInput& input() const { return now_; }

  // Places the scene in navigation's frame (AlignToNavigation), estimates what was asked for, and
  // gives the scene its priors; none where its attitude is not known.
  NavigationAlignment Apply(Scene* scene);

  // What the last Apply found: the lever arm [m], the mount's turn from where the rig has it, a
  // rotation vector in body axes [rad], and the clock [s]. Empty where nothing was asked for, or
  // fewer than six images are placed. Sigmas take the map's shape as known.
  const std::vector<ParameterEstimate>& estimates() const { return estimates_; }

 private:
  void Estimate(Scene scene, bool has_scale);
  void Describe(const Eigen::MatrixXd& covariance);

  NavigationInput given_;
  MountOptions options_;
  NavigationInput now_;
  double clock_s_ = 0.0;
  std::vector<ParameterEstimate> estimates_;
};

}  // namespace rsfm
