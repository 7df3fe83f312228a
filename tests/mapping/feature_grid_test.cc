#include "rsfm/mapping/feature_grid.h"

#include <gtest/gtest.h>

#include <set>
#include <vector>

#include "rsfm/base/rng.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

TEST(FeatureGrid, FindsExactlyWhatIsNear) {
  Rng rng(4);
  std::vector<Feature> features(700);
  for (Feature& f : features) {
    f.x_px = static_cast<float>(rng.Uniform(-5.0, 325.0));  // some outside
    f.y_px = static_cast<float>(rng.Uniform(-5.0, 245.0));
  }
  FeatureGrid grid(320, 240, 17, 700);
  grid.Build(std::span(features).first(3));
  grid.Build(features);
  for (int i = 0; i < 500; ++i) {
    const Vec2 pixel(rng.Uniform(-20.0, 340.0), rng.Uniform(-20.0, 260.0));
    const double radius = rng.Uniform(0.5, 60.0);
    std::set<int> expected, found;
    for (int k = 0; k < 700; ++k) {
      if ((features[k].pixel() - pixel).norm() <= radius) expected.insert(k);
    }
    MallocTrap trap;
    int count = 0;
    grid.ForEachNear(pixel, radius, [&](int) { ++count; });
    EXPECT_EQ(trap.count(), 0u);
    grid.ForEachNear(pixel, radius, [&](int k) { found.insert(k); });
    EXPECT_EQ(found, expected);
    EXPECT_EQ(count, static_cast<int>(expected.size()));  // none twice
  }
}

}  // namespace
}  // namespace rsfm
