// Everything that can be set about the front end and the mapper, in the rig file's `mapper`
// section.
#pragma once

#include <cstdint>
#include <string_view>

#include "rsfm/base/error.h"
#include "rsfm/base/static_vector.h"

namespace rsfm {

// How images come: a video is tracked from frame to frame, strobed stills are matched by
// appearance.
enum class Rhythm : std::uint8_t { kStills, kVideo };
enum class DescriptorType : std::uint8_t { kNone, kOrb, kSift, kAkaze };  // values as in keyframe_t

std::string_view ToString(Rhythm rhythm) noexcept;        // "stills", "video"
std::string_view ToString(DescriptorType type) noexcept;  // "none", "orb", "sift", "akaze"
bool FromString(std::string_view name, Rhythm* rhythm) noexcept;
bool FromString(std::string_view name, DescriptorType* type) noexcept;
int DescriptorBytes(DescriptorType type) noexcept;  // 0, 32, 128, 61

// A part of the image without the scene: a time stamp burnt in, the vehicle itself. Half-open,
// pixels; it may reach beyond the image.
struct MaskRectangle {
  int left = 0, top = 0, right = 0, bottom = 0;
};
inline constexpr int kMaxMaskRectangles = 16;
using ImageMask = StaticVector<MaskRectangle, kMaxMaskRectangles>;

// The closed range of one option; NaN lies in none.
struct OptionRange {
  const char* name;
  double value, low, high;
  bool is_met() const { return value >= low && value <= high; }
};
using OptionRanges = StaticVector<OptionRange, 64>;

struct MapperOptions {
  // Front end.
  Rhythm rhythm = Rhythm::kStills;
  DescriptorType descriptor = DescriptorType::kSift;
  int max_features = 2000;        // kept of an image
  double contrast_limit = 0.0;    // CLAHE's clip limit for murky water; 0 leaves the image as it is
  // Stills with SIFT: the octave that the search begins in. -1 doubles the image first, as Lowe did;
  // 0 takes it as it is, for half the time, and doubles it only where it shows less than three
  // quarters of max_features: details of two or three pixels are not found.
  int sift_first_octave = 0;
  int grid_cell_px = 64;          // video: at least one point is sought in every cell
  int max_tracks = 600;           // video: points followed, at most max_features
  int track_window_px = 21;       // video: KLT patch
  double track_check_px = 0.5;    // video: a track is kept when tracking back returns this near
  double keyframe_motion = 0.08;  // video: median track motion since the keyframe, in widths
  double keyframe_min_tracked = 0.6;  // video: or this part of the keyframe's tracks is left
  int keyframe_max_frames = 30;       // video: or this many frames have gone by
  ImageMask mask;

  // Matching.
  double max_ratio = 0.85;         // best to second-best descriptor distance (not squared)
  double guided_radius_px = 16.0;  // search radius about a projected landmark
  double max_speed_mps = 3.0;      // where navigation says nothing of the motion; 0: no bound
  int match_keyframes = 4;         // newest keyframes a frame is matched with
  int relocalise_keyframes = 4;    // older ones, most similar first, when those do not suffice

  // Water. Behind a port its index follows temperature, salinity and depth as they are measured.
  // The camera takes a new index when that differs by this much from the one it has; 0: the rig
  // file's stays. The default is 0.6 degrees, 0.26 psu or 35 m, 0.04 px at 1000 px from the centre.
  double water_index_step = 5e-5;
  double light_wavelength_nm = 530.0;  // rig.yaml: of the port's wavelength_nm, where it has one

  // Estimation.
  double pixel_sigma = 1.0;         // standard deviation of a feature's position, px
  double max_error_px = 4.0;        // an observation farther from its landmark is an outlier
  int min_inliers = 20;             // fewer do not place a frame
  int ransac_iterations = 1000;     // the most of one robust estimate: bounds the latency
  double min_angle_deg = 0.3;       // of a landmark's widest pair of rays
  double init_min_angle_deg = 2.0;  // median over the first two views
  int init_min_inliers = 60;
  int lost_frames_before_restart = 12;  // lost that long, a new map may begin (announced)
  int window_keyframes = 8;  // the newest that are adjusted; at most max_keyframes - 2
  int window_landmarks = 3000;          // the most landmarks it moves
  int window_iterations = 10;
  std::uint64_t seed = 1;

  // Capacities: all memory is taken from them when the mapper is made.
  int max_keyframes = 64;
  int max_landmarks = 12000;
  int nav_samples = 4096;
  // Places that are recognised after their keyframes have left the map, the way between them, and
  // the loops that still move each other in it. Without places nothing of the three is kept.
  int max_places = 400;
  int max_way_nodes = 20000;
  int max_loops = 64;

  // Navigation.
  double nav_max_gap_s = 2.0;   // samples farther apart are not interpolated between
  double depth_sigma_m = 0.05;  // used where a sample does not state its own
  double position_sigma_m = 1.0;
  double attitude_sigma_deg = 1.0;
  double velocity_sigma_mps = 0.02;
  double altitude_sigma_m = 0.05;
  // What is not known of the sensors: one standard deviation at the start, and how far the heading
  // wanders in ten minutes.
  double heading_bias_sigma_deg = 2.0;
  double heading_drift_deg = 1.0;
  double velocity_scale_sigma = 0.005;
  double misalignment_sigma_deg = 0.3;
  double velocity_lever_sigma_m = 0.02;
  double clock_sigma_s = 0.05;

  // Of every number but the seed.
  OptionRanges Ranges() const noexcept;
  // kInvalidArgument; `where` is the name of an option that is out of its range, or contradicts
  // another.
  Status Validate() const noexcept;
};

// f(name, member) for every option but `mask`, in the order of the rig file; members are int,
// double, std::uint64_t, Rhythm or DescriptorType. Options may be const.
template <class Options, class F>
void ForEachOption(Options& o, F&& f) {
  f("rhythm", o.rhythm);
  f("descriptor", o.descriptor);
  f("max_features", o.max_features);
  f("contrast_limit", o.contrast_limit);
  f("sift_first_octave", o.sift_first_octave);
  f("grid_cell_px", o.grid_cell_px);
  f("max_tracks", o.max_tracks);
  f("track_window_px", o.track_window_px);
  f("track_check_px", o.track_check_px);
  f("keyframe_motion", o.keyframe_motion);
  f("keyframe_min_tracked", o.keyframe_min_tracked);
  f("keyframe_max_frames", o.keyframe_max_frames);
  f("max_ratio", o.max_ratio);
  f("guided_radius_px", o.guided_radius_px);
  f("max_speed_mps", o.max_speed_mps);
  f("match_keyframes", o.match_keyframes);
  f("relocalise_keyframes", o.relocalise_keyframes);
  f("water_index_step", o.water_index_step);
  f("light_wavelength_nm", o.light_wavelength_nm);
  f("pixel_sigma", o.pixel_sigma);
  f("max_error_px", o.max_error_px);
  f("min_inliers", o.min_inliers);
  f("ransac_iterations", o.ransac_iterations);
  f("min_angle_deg", o.min_angle_deg);
  f("init_min_angle_deg", o.init_min_angle_deg);
  f("init_min_inliers", o.init_min_inliers);
  f("lost_frames_before_restart", o.lost_frames_before_restart);
  f("window_keyframes", o.window_keyframes);
  f("window_landmarks", o.window_landmarks);
  f("window_iterations", o.window_iterations);
  f("seed", o.seed);
  f("max_keyframes", o.max_keyframes);
  f("max_landmarks", o.max_landmarks);
  f("nav_samples", o.nav_samples);
  f("max_places", o.max_places);
  f("max_way_nodes", o.max_way_nodes);
  f("max_loops", o.max_loops);
  f("nav_max_gap_s", o.nav_max_gap_s);
  f("depth_sigma_m", o.depth_sigma_m);
  f("position_sigma_m", o.position_sigma_m);
  f("attitude_sigma_deg", o.attitude_sigma_deg);
  f("velocity_sigma_mps", o.velocity_sigma_mps);
  f("altitude_sigma_m", o.altitude_sigma_m);
  f("heading_bias_sigma_deg", o.heading_bias_sigma_deg);
  f("heading_drift_deg", o.heading_drift_deg);
  f("velocity_scale_sigma", o.velocity_scale_sigma);
  f("misalignment_sigma_deg", o.misalignment_sigma_deg);
  f("velocity_lever_sigma_m", o.velocity_lever_sigma_m);
  f("clock_sigma_s", o.clock_sigma_s);
}

}  // namespace rsfm
