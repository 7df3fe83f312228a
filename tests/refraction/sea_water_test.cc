#include "rsfm/refraction/sea_water.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

// [Austin & Halikas 1976, as printed by Mobley 1994, Light and Water, table 3.7]: pressure 1.01e5
// and 1.08e8 Pa.
struct TableRow {
  double pressure_pa, temperature_c, salinity_psu, index_400, index_700;
};
constexpr TableRow kTable[] = {
    {1.01e5, 0, 0, 1.344186, 1.331084},  {1.01e5, 0, 35, 1.351415, 1.337906},
    {1.01e5, 30, 0, 1.342081, 1.329128}, {1.01e5, 30, 35, 1.348752, 1.335316},
    {1.08e8, 0, 0, 1.360076, 1.346604},  {1.08e8, 0, 35, 1.366885, 1.352956},
    {1.08e8, 30, 0, 1.356281, 1.342958}, {1.08e8, 30, 35, 1.362842, 1.348986},
};

double DepthOf(double pressure_pa) {
  const double dbar = (pressure_pa - 1.01325e5) * 1e-4;
  double depth = dbar;  // fixed point of the monotone PressureFromDepth
  for (int i = 0; i < 50; ++i) depth += dbar - PressureFromDepth(depth);
  return std::max(depth, 0.0);
}

TEST(SeaWater, AgreesWithThePublishedTable) {
  for (const TableRow& row : kTable) {
    for (const auto& [wavelength, expected] :
         {std::pair{400.0, row.index_400}, {700.0, row.index_700}}) {
      const auto index = SeaWaterIndex(
          {row.temperature_c, row.salinity_psu, DepthOf(row.pressure_pa), wavelength});
      ASSERT_TRUE(index) << index.error().where;
      // Below 500 nm the formula is beyond its data.
      EXPECT_NEAR(*index, expected, wavelength < 500.0 ? 5e-4 : 3e-4)
          << row.pressure_pa << " Pa " << row.temperature_c << " C " << wavelength;
      if (row.pressure_pa > 1e6) continue;
      EXPECT_NEAR(*SeaWaterIndexAtSurface(row.temperature_c, row.salinity_psu, wavelength),
                  expected, 2e-4);
    }
  }
}

TEST(SeaWater, PureWaterAtTheSodiumLine) {
  // 1.33299: the handbook value at 20 degrees, relative to air [Tilton & Taylor 1938].
  EXPECT_NEAR(*SeaWaterIndex({20.0, 0.0, 0.0, 589.3}), 1.33299, 1e-5);
  EXPECT_NEAR(*SeaWaterIndexAtSurface(20.0, 0.0, 589.3), 1.33299, 3e-5);
}

TEST(SeaWater, TheTwoFormulasAgreeAtTheSurface) {
  for (double t = 0; t <= 30; t += 5) {
    for (double s = 0; s <= 35; s += 7) {
      for (double l = 450; l <= 700; l += 25) {
        EXPECT_NEAR(*SeaWaterIndex({t, s, 0, l}), *SeaWaterIndexAtSurface(t, s, l), 1e-4)
            << t << " " << s << " " << l;
      }
    }
  }
}

TEST(SeaWater, GrowsWithDepthAndSaltAndFallsWithWarmth) {
  const double here = *SeaWaterIndex({10, 35, 100, 530});
  EXPECT_GT(*SeaWaterIndex({10, 35, 1000, 530}), here);
  EXPECT_GT(*SeaWaterIndex({10, 38, 100, 530}), here);
  EXPECT_LT(*SeaWaterIndex({20, 35, 100, 530}), here);
  EXPECT_GT(*SeaWaterIndex({10, 35, 100, 450}), here);
}

TEST(SeaWater, NamesWhatIsOutOfRange) {
  const auto where = [](const WaterConditions& water) {
    const auto index = SeaWaterIndex(water);
    return std::string(index ? "accepted" : index.error().where);
  };
  EXPECT_EQ(where({-3, 35, 0, 530}), "temperature_c");
  EXPECT_EQ(where({std::nan(""), 35, 0, 530}), "temperature_c");
  EXPECT_EQ(where({10, 50, 0, 530}), "salinity_psu");
  EXPECT_EQ(where({10, 35, -1, 530}), "depth_m");
  EXPECT_EQ(where({10, 35, 12000, 530}), "depth_m");
  EXPECT_EQ(where({10, 35, 0, 900}), "wavelength_nm");
}

TEST(SeaWater, PressureOfSaundersExample) {
  EXPECT_EQ(PressureFromDepth(0.0), 0.0);
  // About one dbar a metre, a little more with depth: 10 dbar at 9.92 m, 10,000 dbar near 9,700 m
  // at mid latitudes.
  EXPECT_NEAR(PressureFromDepth(9.92), 10.0, 0.01);
  EXPECT_NEAR(PressureFromDepth(9713.7), 10000.0, 30.0);
}

TEST(Glass, IndicesAtTheHeliumLine) {
  EXPECT_NEAR(*GlassIndex(Glass::kBk7, 587.56), 1.51680, 1e-5);
  EXPECT_NEAR(*GlassIndex(Glass::kFusedSilica, 587.56), 1.45846, 1e-5);
  EXPECT_NEAR(*GlassIndex(Glass::kSapphire, 587.56), 1.7682, 2e-4);
  EXPECT_NEAR(*GlassIndex(Glass::kAcrylic, 587.56), 1.4906, 5e-4);
  EXPECT_FALSE(GlassIndex(Glass::kBk7, 300.0));
  for (const Glass glass : {Glass::kBk7, Glass::kFusedSilica, Glass::kSapphire, Glass::kAcrylic}) {
    EXPECT_EQ(GlassFromName(ToString(glass)), glass);
  }
  EXPECT_FALSE(GlassFromName("jelly"));
}

TEST(SeaWater, DoesNotAllocate) {
  MallocTrap trap;
  EXPECT_TRUE(SeaWaterIndex({}));
  EXPECT_TRUE(GlassIndex(Glass::kSapphire));
  EXPECT_EQ(trap.count(), 0u);
}

}  // namespace
}  // namespace rsfm
