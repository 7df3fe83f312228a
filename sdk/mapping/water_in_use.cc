#include "rsfm/mapping/water_in_use.h"

#include <algorithm>
#include <cmath>

#include "rsfm/refraction/sea_water.h"

namespace rsfm {

std::optional<AnyCamera> FollowWater(const MapperOptions& options, const NavBuffer& nav,
                                     Utime utime, const AnyCamera& camera,
                                     WaterInUse* water) noexcept {
  CameraConfig config = camera.config();
  if (options.water_index_step <= 0.0 || config.port.type == PortType::kNone) return std::nullopt;
  const NavSample measured = nav.WaterAt(utime);
  if (!measured.Has(NavField::kWater)) return std::nullopt;
  WaterInUse next;
  next.is_measured = true;
  next.temperature_c = measured.temperature_c;
  next.salinity_psu = measured.salinity_psu;
  next.depth_m = measured.Has(NavField::kDepth) ? std::max(measured.depth_m, 0.0) : 0.0;
  const auto index = SeaWaterIndex(
      {next.temperature_c, next.salinity_psu, next.depth_m, options.light_wavelength_nm});
  if (!index) return std::nullopt;  // a measurement outside the sea's range
  next.index = config.port.index_air * *index;
  if (!(std::abs(next.index - water->index) >= options.water_index_step)) return std::nullopt;
  config.port.index_water = next.index;
  const auto created = AnyCamera::Create(config);
  if (!created) return std::nullopt;
  *water = next;
  return *created;
}

}  // namespace rsfm
