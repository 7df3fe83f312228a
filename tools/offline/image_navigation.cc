#include "tools/offline/image_navigation.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "rsfm/base/so3.h"

namespace rsfm {
namespace {

constexpr double kDegPerRad = 180.0 / std::numbers::pi;

std::string Format(const char* format, double a, double b) {
  char text[256];
  std::snprintf(text, sizeof text, format, a, b);
  return text;
}

// Why navigation says nothing about the images.
std::string Explain(const std::vector<NavSample>& samples, const std::vector<Utime>& utimes) {
  if (samples.empty()) return "navigation is empty";
  const auto [first, last] = std::minmax_element(utimes.begin(), utimes.end());
  const double nav_start = SecondsFromUs(samples.front().utime);
  const double nav_end = SecondsFromUs(samples.back().utime);
  return Format("navigation runs from %.3f s to %.3f s", nav_start, nav_end) +
         Format(", the images from %.3f s to %.3f s: no image lies within", SecondsFromUs(*first),
                SecondsFromUs(*last)) +
         Format("; its clock may be off by %.0f s, or the images' times are missing (images.csv)",
                nav_start - SecondsFromUs(*first), 0.0);
}

}  // namespace

ImageNavigation::ImageNavigation(const NavigationInput& input, const std::vector<Utime>& utimes)
    : input_(input), utimes_(utimes), samples_(utimes.size()) {
  const MapperOptions& d = input.defaults;
  defaults_.sigma_position_m = Vec3::Constant(d.position_sigma_m);
  defaults_.sigma_attitude_rad = Vec3::Constant(d.attitude_sigma_deg / kDegPerRad);
  defaults_.sigma_velocity_mps = Vec3::Constant(d.velocity_sigma_mps);
  defaults_.sigma_depth_m = d.depth_sigma_m;
  if (input.samples.empty() || utimes.empty()) return;
  NavBufferOptions options;
  options.capacity = static_cast<int>(input.samples.size()) + 1;
  options.max_gap_s = d.nav_max_gap_s;
  options.max_late_s = 1e9;
  auto buffer = NavBuffer::Create(options);
  if (!buffer) return;
  for (const NavSample& sample : input.samples) buffer->Insert(sample);
  buffer_ = std::move(*buffer);
  for (std::size_t i = 0; i < utimes.size(); ++i) {
    samples_[i] = buffer_->At(utimes[i]);
    num_covered_ += samples_[i].Has(NavField::kPosition) || samples_[i].Has(NavField::kAttitude) ||
                            samples_[i].Has(NavField::kDepth)
                        ? 1
                        : 0;
  }
  if (num_covered_ == 0) why_not_ = Explain(input.samples, utimes);
}

std::optional<Vec3> ImageNavigation::CameraPlace(int image) const {
  const NavSample& s = samples_[image];
  if (!s.Has(NavField::kPosition)) return std::nullopt;
  if (!s.Has(NavField::kAttitude)) return s.position_ned_m;
  return Vec3(s.position_ned_m + s.ned_from_body * input_.body_from_camera.translation);
}

std::vector<std::optional<Vec3>> ImageNavigation::Places() const {
  std::vector<std::optional<Vec3>> places(samples_.size());
  int num_positions = 0;
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    places[i] = CameraPlace(static_cast<int>(i));
    num_positions += places[i] ? 1 : 0;
  }
  if (num_positions > 0) return places;
  const std::vector<Rigid3> reckoned = DeadReckoned();
  for (std::size_t i = 0; i < reckoned.size(); ++i) places[i] = reckoned[i].translation;
  return places;
}

std::vector<Rigid3> ImageNavigation::DeadReckoned() const {
  std::vector<Rigid3> ned_from_camera;
  if (!buffer_) return ned_from_camera;
  Vec3 place = Vec3::Zero();
  for (std::size_t i = 1; i < utimes_.size(); ++i) {
    const auto motion = buffer_->DeadReckon(utimes_[i - 1], utimes_[i], defaults_);
    if (!motion) return {};  // two halves without a common origin
    if (i == 1)
      ned_from_camera.push_back(Rigid3(motion->ned_from_body_start, place) *
                                input_.body_from_camera);
    place += motion->displacement_ned_m;
    ned_from_camera.push_back(Rigid3(motion->ned_from_body_end, place) * input_.body_from_camera);
  }
  return ned_from_camera;
}

std::optional<KnownBaseline> ImageNavigation::BaselineOf(int a, int b) const {
  KnownBaseline baseline;
  if (buffer_ && utimes_[a] != utimes_[b]) {
    const auto [start, end] = std::minmax(utimes_[a], utimes_[b]);
    if (const auto motion = buffer_->DeadReckon(start, end, defaults_)) {
      const Vec3& lever = input_.body_from_camera.translation;
      baseline.length_m = (motion->displacement_ned_m + motion->ned_from_body_end * lever -
                           motion->ned_from_body_start * lever)
                              .norm();
      baseline.sigma_m = std::sqrt(motion->covariance_m2.trace() / 3.0) + 1e-4;
      if (baseline.sigma_m < 0.2 * baseline.length_m) return baseline;
    }
  }
  const auto place_a = CameraPlace(a), place_b = CameraPlace(b);
  if (!place_a || !place_b) return std::nullopt;
  const auto sigma = [this](int i) {
    const Vec3& s = samples_[i].sigma_position_m;
    return (s.array() > 0.0).all() ? s.mean() : defaults_.sigma_position_m.mean();
  };
  baseline.length_m = (*place_a - *place_b).norm();
  baseline.sigma_m = std::hypot(sigma(a), sigma(b));
  if (!(baseline.sigma_m < 0.2 * baseline.length_m)) return std::nullopt;
  return baseline;
}

NavigationResiduals ImageNavigation::Compare(
    const std::vector<std::optional<Rigid3>>& camera_from_world) const {
  NavigationResiduals r;
  std::vector<double> attitudes;
  double positions = 0.0, depths = 0.0;
  Vec3 low = Vec3::Constant(1e30), high = Vec3::Constant(-1e30);
  for (int i = 0; i < static_cast<int>(camera_from_world.size()); ++i) {
    if (!camera_from_world[i]) continue;
    const NavSample& s = samples_[i];
    const Rigid3 world_from_body =
        camera_from_world[i]->Inverse() * input_.body_from_camera.Inverse();
    if (const auto place = CameraPlace(i)) {
      const double error = (camera_from_world[i]->OriginOfTarget() - *place).norm();
      ++r.num_positions;
      positions += error * error;
      r.position_max_m = std::max(r.position_max_m, error);
      const bool stated = (s.sigma_position_m.array() > 0.0).all();
      r.position_sigma_m += (stated ? s.sigma_position_m : defaults_.sigma_position_m).mean();
      low = low.cwiseMin(*place);
      high = high.cwiseMax(*place);
    }
    if (s.Has(NavField::kAttitude)) {
      ++r.num_attitudes;
      attitudes.push_back(kDegPerRad * AngleBetween(world_from_body.rotation, s.ned_from_body));
      const bool stated = (s.sigma_attitude_rad.array() > 0.0).all();
      r.attitude_sigma_deg +=
          kDegPerRad * (stated ? s.sigma_attitude_rad : defaults_.sigma_attitude_rad).maxCoeff();
    }
    if (s.Has(NavField::kDepth)) {
      ++r.num_depths;
      const double error = world_from_body.translation.z() - s.depth_m;
      depths += error * error;
    }
  }
  if (r.num_positions > 0) {
    r.position_rms_m = std::sqrt(positions / r.num_positions);
    r.position_sigma_m /= r.num_positions;
    r.extent_m = (high - low).norm();
  }
  if (!attitudes.empty()) {
    const auto middle = attitudes.begin() + static_cast<std::ptrdiff_t>(attitudes.size() / 2);
    std::nth_element(attitudes.begin(), middle, attitudes.end());
    r.attitude_median_deg = *middle;
    r.attitude_sigma_deg /= r.num_attitudes;
  }
  if (r.num_depths > 0) r.depth_rms_m = std::sqrt(depths / r.num_depths);
  return r;
}

std::vector<std::optional<Rigid3>> PlacedPoses(const Scene& scene) {
  std::vector<std::optional<Rigid3>> poses;
  for (const SceneImage& image : scene.images)
    poses.push_back(image.placed ? std::optional(image.camera_from_world) : std::nullopt);
  return poses;
}

std::string Contradiction(const NavigationResiduals& r, const NavigationAlignment& alignment) {
  if (r.num_attitudes >= 3 && r.attitude_median_deg > std::max(5.0, 5.0 * r.attitude_sigma_deg)) {
    return Format("attitudes differ from the images' by %.1f degrees in the median (%.1f claimed)",
                  r.attitude_median_deg, r.attitude_sigma_deg) +
           ": wrong times, another frame, or a wrong body_from_camera";
  }
  if (r.num_positions >= 3 && alignment.attitude &&
      (!alignment.scale ||
       r.position_rms_m > std::max(0.1 * r.extent_m, 5.0 * r.position_sigma_m)) &&
      r.extent_m > 5.0 * r.position_sigma_m) {
    return Format("positions differ from the images' by %.2f m RMS over an extent of %.2f m",
                  r.position_rms_m, r.extent_m) +
           ": wrong times, or positions in another frame than the attitudes (NED is expected)";
  }
  return {};
}

}  // namespace rsfm
