#include "rsfm/refraction/sea_water.h"

#include <array>
#include <cmath>

namespace rsfm {
namespace {

// Written so that NaN is outside.
bool IsWithin(double value, double low, double high) { return value >= low && value <= high; }

struct GlassFacts {
  Glass glass;
  std::string_view name;
  std::array<double, 3> strength;       // B_i
  std::array<double, 3> resonance_um2;  // C_i
};

constexpr double Square(double x) { return x * x; }

constexpr std::array kGlasses = {
    GlassFacts{Glass::kBk7,
               "BK7",
               {1.03961212, 0.231792344, 1.01046945},
               {0.00600069867, 0.0200179144, 103.560653}},
    GlassFacts{Glass::kFusedSilica,
               "fused_silica",
               {0.6961663, 0.4079426, 0.8974794},
               {Square(0.0684043), Square(0.1162414), Square(9.896161)}},
    GlassFacts{Glass::kSapphire,
               "sapphire",
               {1.4313493, 0.65054713, 5.3414021},
               {Square(0.0726631), Square(0.1193242), Square(18.028251)}},
    GlassFacts{Glass::kAcrylic, "acrylic", {1.1819, 0.0, 0.0}, {0.011313, 0.0, 0.0}},
};

}  // namespace

double PressureFromDepth(double depth_m) noexcept {
  const double c1 = (5.92 + 5.25 * 0.5) * 1e-3, c2 = 2.21e-6;  // sin^2(45 degrees) = 0.5
  return ((1.0 - c1) - std::sqrt(Square(1.0 - c1) - 4.0 * c2 * depth_m)) / (2.0 * c2);
}

Expected<double> SeaWaterIndex(const WaterConditions& water) noexcept {
  if (!IsWithin(water.temperature_c, 0.0, 30.0))
    return Fail(Errc::kInvalidArgument, "temperature_c");
  if (!IsWithin(water.salinity_psu, 0.0, 43.0)) return Fail(Errc::kInvalidArgument, "salinity_psu");
  if (!IsWithin(water.depth_m, 0.0, 10700.0)) return Fail(Errc::kInvalidArgument, "depth_m");
  if (!IsWithin(water.wavelength_nm, 400.0, 700.0))
    return Fail(Errc::kInvalidArgument, "wavelength_nm");
  const double t = water.temperature_c, s = water.salinity_psu,
               p = PressureFromDepth(water.depth_m);
  const double l = 1e-3 * water.wavelength_nm;  // micrometres
  const double l2 = l * l, u = 1.0 / l2;
  const double pure =
      1.3280657 - 4.5536802e-3 * l2 + u * (2.5471707e-3 + u * (7.501966e-6 + u * 2.802632e-6)) +
      t * (-5.2883907e-6 + t * (-3.0738272e-6 + t * (3.0124687e-8 - t * 2.0883178e-10))) +
      t * l * (1.0508621e-5 + t * (2.1282248e-7 - t * 1.705881e-9));
  const double salt =
      s * (1.9029121e-4 + 2.4239607e-6 * u +
           t * (-7.3960297e-7 + t * (8.9818478e-9 + t * 1.2078804e-10)) - 3.589495e-7 * t * l);
  const double pressure = p * (1.5868383e-6 - 1.574074e-11 * p + 1.0712063e-8 * u +
                               t * (-9.4834486e-9 + t * 1.0100326e-10) + 5.8085198e-15 * p * t * t);
  const double both = p * s * (-1.1177517e-9 + t * (5.7311268e-11 - t * 1.5460458e-12));
  return pure + salt + pressure + both;
}

Expected<double> SeaWaterIndexAtSurface(double t, double s, double wavelength_nm) noexcept {
  if (!IsWithin(t, 0.0, 30.0)) return Fail(Errc::kInvalidArgument, "temperature_c");
  if (!IsWithin(s, 0.0, 35.0)) return Fail(Errc::kInvalidArgument, "salinity_psu");
  if (!IsWithin(wavelength_nm, 400.0, 700.0)) return Fail(Errc::kInvalidArgument, "wavelength_nm");
  const double u = 1.0 / wavelength_nm;
  return 1.31405 + (1.779e-4 - 1.05e-6 * t + 1.6e-8 * t * t) * s - 2.02e-6 * t * t +
         (15.868 + 0.01155 * s - 0.00423 * t) * u - 4382.0 * u * u + 1.1455e6 * u * u * u;
}

std::string_view ToString(Glass glass) noexcept {
  for (const GlassFacts& facts : kGlasses) {
    if (facts.glass == glass) return facts.name;
  }
  return "unknown";
}

std::optional<Glass> GlassFromName(std::string_view name) noexcept {
  for (const GlassFacts& facts : kGlasses) {
    if (facts.name == name) return facts.glass;
  }
  return std::nullopt;
}

Expected<double> GlassIndex(Glass glass, double wavelength_nm) noexcept {
  if (!IsWithin(wavelength_nm, 400.0, 700.0)) return Fail(Errc::kInvalidArgument, "wavelength_nm");
  const double l2 = Square(1e-3 * wavelength_nm);
  for (const GlassFacts& facts : kGlasses) {
    if (facts.glass != glass) continue;
    double square = 1.0;
    for (int i = 0; i < 3; ++i) square += facts.strength[i] * l2 / (l2 - facts.resonance_um2[i]);
    return std::sqrt(square);
  }
  return Fail(Errc::kInvalidArgument, "glass");
}

}  // namespace rsfm
