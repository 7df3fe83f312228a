// Images and navigation from files through the very on-board mapper, into a mission folder.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "rsfm/base/time.h"
#include "rsfm/io/diagnostic.h"

namespace rsfm {

// Navigation is handed over this much ahead of an image, as it is on a vehicle whose images take
// their time to arrive: interpolation needs a sample on both sides.
inline constexpr Utime kNavLeadUs = 500'000;

struct MapRequest {
  std::filesystem::path images;  // a folder of images, or a mission folder
  std::filesystem::path rig;     // empty: the mission folder's own
  std::filesystem::path out;
  std::optional<std::filesystem::path> times;  // images.csv
  std::optional<double> fps;                   // else 1, where nothing gives times
  std::optional<std::filesystem::path> nav;    // nav.csv
  std::string lcm_url = "memq://";
};

struct MapHooks {
  std::function<void(int done, int total, const std::string& note)> progress;
  std::function<bool()> is_interrupted;
};

struct MapResult {
  int num_images = 0;
  int num_placed = 0;     // at the end, of the last map
  int num_keyframes = 0;  // in the map at the end
  int num_landmarks = 0;
  std::string left_out;  // images that were refused or showed nothing, by reason; or empty
  int num_resets = 0;    // jumps of the world's frame
  bool scale_is_metric = false;
  bool world_is_ned = false;
  bool interrupted = false;                  // nothing was written
  double mean_error_px = 0.0;                // of the last window
  double front_end_s = 0.0, mapper_s = 0.0;  // of one core
  std::size_t memory_plan_bytes = 0;
};

// Writes the mission atomically; an earlier one in its place is replaced.
IoExpected<MapResult> MapImages(const MapRequest& request, const MapHooks& hooks = {});

}  // namespace rsfm
