#include "rsfm/mapping/mapper_options.h"

#include <cmath>
#include <iterator>

namespace rsfm {
namespace {

constexpr std::string_view kRhythmNames[] = {"stills", "video"};
constexpr std::string_view kDescriptorNames[] = {"none", "orb", "sift", "akaze"};
constexpr int kDescriptorBytes[] = {0, 32, 128, 61};

template <class Enum, std::size_t N>
bool Find(const std::string_view (&names)[N], std::string_view name, Enum* value) {
  for (std::size_t i = 0; i < N; ++i) {
    if (names[i] != name) continue;
    *value = static_cast<Enum>(i);
    return true;
  }
  return false;
}

// Nothing (an empty name, no bytes) for a value that the enumeration does not have.
template <class Enum, class Value, std::size_t N>
Value At(const Value (&values)[N], Enum value) {
  const auto i = static_cast<std::size_t>(value);
  return i < N ? values[i] : Value();
}

}  // namespace

std::string_view ToString(Rhythm rhythm) noexcept { return At(kRhythmNames, rhythm); }
std::string_view ToString(DescriptorType type) noexcept { return At(kDescriptorNames, type); }
bool FromString(std::string_view name, Rhythm* rhythm) noexcept {
  return Find(kRhythmNames, name, rhythm);
}
bool FromString(std::string_view name, DescriptorType* type) noexcept {
  return Find(kDescriptorNames, name, type);
}
int DescriptorBytes(DescriptorType type) noexcept { return At(kDescriptorBytes, type); }

OptionRanges MapperOptions::Ranges() const noexcept {
  const OptionRange ranges[] = {
      {"max_features", static_cast<double>(max_features), 50, 20000},
      {"contrast_limit", contrast_limit, 0, 100},
      {"sift_first_octave", static_cast<double>(sift_first_octave), -1, 0},
      {"grid_cell_px", static_cast<double>(grid_cell_px), 8, 1024},
      {"max_tracks", static_cast<double>(max_tracks), 50, 20000},
      {"track_window_px", static_cast<double>(track_window_px), 5, 101},
      {"track_check_px", track_check_px, 0.05, 10},
      {"keyframe_motion", keyframe_motion, 0.001, 1},
      {"keyframe_min_tracked", keyframe_min_tracked, 0, 1},
      {"keyframe_max_frames", static_cast<double>(keyframe_max_frames), 1, 1e6},
      {"max_ratio", max_ratio, 0.1, 1},
      {"guided_radius_px", guided_radius_px, 1, 1000},
      {"max_speed_mps", max_speed_mps, 0, 100},
      {"match_keyframes", static_cast<double>(match_keyframes), 1, 64},
      {"relocalise_keyframes", static_cast<double>(relocalise_keyframes), 0, 64},
      {"water_index_step", water_index_step, 0, 0.1},
      {"light_wavelength_nm", light_wavelength_nm, 400, 700},
      {"pixel_sigma", pixel_sigma, 1e-3, 100},
      {"max_error_px", max_error_px, 0.1, 100},
      {"min_inliers", static_cast<double>(min_inliers), 6, 10000},
      {"ransac_iterations", static_cast<double>(ransac_iterations), 10, 1e6},
      {"min_angle_deg", min_angle_deg, 0, 45},
      {"init_min_angle_deg", init_min_angle_deg, 0, 45},
      {"init_min_inliers", static_cast<double>(init_min_inliers), 10, 10000},
      {"lost_frames_before_restart", static_cast<double>(lost_frames_before_restart), 1, 1e6},
      {"window_keyframes", static_cast<double>(window_keyframes), 3, 64},
      {"window_landmarks", static_cast<double>(window_landmarks), 100, 100000},
      {"window_iterations", static_cast<double>(window_iterations), 1, 100},
      {"max_keyframes", static_cast<double>(max_keyframes), 8, 4096},
      {"max_landmarks", static_cast<double>(max_landmarks), 200, 1000000},
      {"nav_samples", static_cast<double>(nav_samples), 2, 1e7},
      {"max_places", static_cast<double>(max_places), 0, 10000},
      {"max_way_nodes", static_cast<double>(max_way_nodes), 16, 1e6},
      {"max_loops", static_cast<double>(max_loops), 1, 256},
      {"nav_max_gap_s", nav_max_gap_s, 0.01, 3600},
      {"depth_sigma_m", depth_sigma_m, 1e-4, 100},
      {"position_sigma_m", position_sigma_m, 1e-4, 1e6},
      {"attitude_sigma_deg", attitude_sigma_deg, 1e-3, 180},
      {"velocity_sigma_mps", velocity_sigma_mps, 1e-4, 100},
      {"altitude_sigma_m", altitude_sigma_m, 1e-4, 100},
      {"heading_bias_sigma_deg", heading_bias_sigma_deg, 0, 180},
      {"heading_drift_deg", heading_drift_deg, 0, 180},
      {"velocity_scale_sigma", velocity_scale_sigma, 0, 0.5},
      {"misalignment_sigma_deg", misalignment_sigma_deg, 0, 30},
      {"velocity_lever_sigma_m", velocity_lever_sigma_m, 0, 10},
      {"clock_sigma_s", clock_sigma_s, 0, 1},
  };
  OptionRanges result;
  for (const OptionRange& range : ranges) result.TryPushBack(range);
  return result;
}

Status MapperOptions::Validate() const noexcept {
  for (const OptionRange& range : Ranges()) {
    if (!range.is_met()) return Fail(Errc::kInvalidArgument, range.name);
  }
  if (descriptor == DescriptorType::kNone) return Fail(Errc::kInvalidArgument, "descriptor");
  if (track_window_px % 2 == 0) return Fail(Errc::kInvalidArgument, "track_window_px");
  // Beside the window, one that has left it and is told of with the next frame, and that frame.
  if (window_keyframes + 2 > max_keyframes)
    return Fail(Errc::kInvalidArgument, "window_keyframes");
  if (max_places > max_way_nodes) return Fail(Errc::kInvalidArgument, "max_places");
  for (const MaskRectangle& rectangle : mask) {
    if (rectangle.right <= rectangle.left || rectangle.bottom <= rectangle.top)
      return Fail(Errc::kInvalidArgument, "mask");
  }
  return {};
}

}  // namespace rsfm
