// The refractive index of sea water from what a CTD measures, and of the glasses that ports are
// made of. All indices are relative to air, as a housing filled with air needs them (index_air =
// 1).
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "rsfm/base/error.h"

namespace rsfm {

struct WaterConditions {
  double temperature_c = 10.0;   // 0 ... 30
  double salinity_psu = 35.0;    // 0 ... 43
  double depth_m = 0.0;          // 0 ... 10700, below the surface
  double wavelength_nm = 530.0;  // 400 ... 700, of the light; green is what the sea lets through
};

// With temperature, salinity, wavelength and pressure.   [Millard & Seaver 1990, Deep-Sea Res.
// 37(12), table 1] Stated accuracy 0.4 to 80 ppm for 500 ... 700 nm; below 500 nm its dispersion is
// an extrapolation, within 1e-4 of Quan & Fry. kInvalidArgument outside the ranges above, `where`
// naming the member.
Expected<double> SeaWaterIndex(const WaterConditions& water) noexcept;

// Without pressure: at the surface.   [Quan & Fry 1995, Applied Optics 34(18), eq. (3)]
// Valid for 0 ... 30 degrees, 0 ... 35 psu, 400 ... 700 nm; accuracy 1.5e-5.
Expected<double> SeaWaterIndexAtSurface(double temperature_c, double salinity_psu,
                                        double wavelength_nm) noexcept;

// Pressure of sea water above the atmosphere's, dbar, at 45 degrees of latitude.   [Saunders 1981,
// JPO 11, eq. (1)]
double PressureFromDepth(double depth_m) noexcept;

enum class Glass : std::uint8_t { kBk7, kFusedSilica, kSapphire, kAcrylic };

std::string_view ToString(Glass glass) noexcept;  // "BK7", "fused_silica", "sapphire", "acrylic"
std::optional<Glass> GlassFromName(std::string_view name) noexcept;

// Sellmeier's equation at 20 degrees, 400 ... 700 nm (else kInvalidArgument). BK7: [Schott, N-BK7
// data sheet]; fused silica: [Malitson 1965, JOSA 55(10)]; sapphire, ordinary ray: [Malitson &
// Dodge 1972, JOSA 62]; acrylic: [Sultanova 2009, Acta Phys. Pol. A 116(4)].
Expected<double> GlassIndex(Glass glass, double wavelength_nm = 530.0) noexcept;

}  // namespace rsfm
