#include "rsfm/navigation/local_frame.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "rsfm/base/rng.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

TEST(LocalFrame, AxesAreNorthEastDown) {
  const LocalFrame frame = LocalFrame::Create({54.3, 10.1, 12.0}).value();
  EXPECT_LT(frame.NedFromGeodetic({54.3, 10.1, 12.0}).norm(), 1e-9);
  const Vec3 north = frame.NedFromGeodetic({54.301, 10.1, 12.0});
  const Vec3 east = frame.NedFromGeodetic({54.3, 10.101, 12.0});
  const Vec3 down = frame.NedFromGeodetic({54.3, 10.1, 2.0});
  // Radii of curvature of WGS84 in the meridian and in the prime vertical.
  const double a = 6378137.0, e2 = 0.00669437999014, rad = std::numbers::pi / 180.0;
  const double w = std::sqrt(1.0 - e2 * std::pow(std::sin(54.3 * rad), 2));
  EXPECT_NEAR(north.x(), 0.001 * rad * (a * (1 - e2) / (w * w * w) + 12.0), 2e-3);
  EXPECT_NEAR(east.y(), 0.001 * rad * (a / w + 12.0) * std::cos(54.3 * rad), 2e-3);
  EXPECT_NEAR(down.z(), 10.0, 1e-6);
  EXPECT_NEAR(north.y(), 0.0, 1e-6);
  EXPECT_NEAR(east.x(), 0.0, 2e-3);
}

TEST(LocalFrame, BackAndForthIsTheIdentity) {
  Rng rng(3);
  for (int i = 0; i < 200; ++i) {
    const LocalFrame frame =
        LocalFrame::Create({rng.Uniform(-89, 89), rng.Uniform(-180, 180), rng.Uniform(-4000, 100)})
            .value();
    const Vec3 ned(rng.Uniform(-5e4, 5e4), rng.Uniform(-5e4, 5e4), rng.Uniform(-100, 6000));
    MallocTrap trap;
    const Vec3 again = frame.NedFromGeodetic(frame.GeodeticFromNed(ned));
    EXPECT_EQ(trap.count(), 0u);
    EXPECT_LT((again - ned).norm(), 1e-6);
  }
}

TEST(LocalFrame, RefusesPlacesThatAreNone) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_STREQ(LocalFrame::Create({90.5, 0, 0}).error().where, "latitude_deg");
  EXPECT_STREQ(LocalFrame::Create({nan, 0, 0}).error().where, "latitude_deg");
  EXPECT_STREQ(LocalFrame::Create({0, nan, 0}).error().where, "longitude_deg");
  EXPECT_STREQ(LocalFrame::Create({0, 0, nan}).error().where, "height_m");
}

}  // namespace
}  // namespace rsfm
