// What navigation says of each image, and whether images and navigation agree.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rsfm/navigation/nav_buffer.h"
#include "tools/offline/navigation.h"

namespace rsfm {

// How far a map that was turned, moved and scaled to navigation lies from it.
struct NavigationResiduals {
  int num_positions = 0, num_attitudes = 0, num_depths = 0;  // compared
  double position_rms_m = 0.0, position_max_m = 0.0;
  double position_sigma_m = 0.0;  // that navigation claims, mean
  double attitude_median_deg = 0.0;
  double attitude_sigma_deg = 0.0;
  double depth_rms_m = 0.0;
  double extent_m = 0.0;  // of the images' places, as navigation has them
};

// The length of the way between two cameras [m], and its sigma.
struct KnownBaseline {
  double length_m = 0.0, sigma_m = 0.0;
};

class ImageNavigation {
 public:
  // `utimes` of the images; 0: not known.
  ImageNavigation(const NavigationInput& input, const std::vector<Utime>& utimes);

  int num_covered() const { return num_covered_; }  // images with position, attitude or depth
  // Why no image is covered; empty when some are.
  const std::string& why_not() const { return why_not_; }

  // Where each image was taken: position, or failing that dead-reckoned since the first image.
  std::vector<std::optional<Vec3>> Places() const;
  // ned_from_camera of every image by velocity, attitude and depth alone, each from the one before;
  // the first body is the origin. Empty where these do not span the images, which must be in order
  // of time.
  std::vector<Rigid3> DeadReckoned() const;
  // The length of the way between two images' cameras, where navigation is sure of it to a fifth.
  std::optional<KnownBaseline> BaselineOf(int a, int b) const;

  // Of the images of the constructor that are placed; poses in navigation's frame.
  NavigationResiduals Compare(const std::vector<std::optional<Rigid3>>& camera_from_world) const;

 private:
  std::optional<Vec3> CameraPlace(int image) const;

  const NavigationInput& input_;
  std::vector<Utime> utimes_;
  std::optional<NavBuffer> buffer_;
  NavSample defaults_;
  std::vector<NavSample> samples_;
  int num_covered_ = 0;
  std::string why_not_;
};

// The poses of the placed images of a scene.
std::vector<std::optional<Rigid3>> PlacedPoses(const Scene& scene);

// What contradicts, said to the user: empty when nothing does. Attitudes or positions must be off
// by five of their sigmas and by more than a sound rig explains (5 degrees, a tenth of the extent).
std::string Contradiction(const NavigationResiduals& residuals,
                          const NavigationAlignment& alignment);

}  // namespace rsfm
