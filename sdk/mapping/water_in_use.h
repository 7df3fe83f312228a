// The water before the port, as it is measured during the mission.
#pragma once

#include <optional>

#include "rsfm/mapping/mapper_options.h"
#include "rsfm/navigation/nav_buffer.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

// The water before the port, as the camera has it.
struct WaterInUse {
  double index = 1.334;
  bool is_measured = false;  // else the camera's as it was given; the conditions then mean nothing
  double temperature_c = 0.0, salinity_psu = 0.0, depth_m = 0.0;
};

// The camera in the water as it was last measured, where that differs by water_index_step or more
// from the one in use; `water` is then that.
std::optional<AnyCamera> FollowWater(const MapperOptions& options, const NavBuffer& nav,
                                     Utime utime, const AnyCamera& camera,
                                     WaterInUse* water) noexcept;

}  // namespace rsfm
