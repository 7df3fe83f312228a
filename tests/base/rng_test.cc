#include "rsfm/base/rng.h"

#include <gtest/gtest.h>

namespace rsfm {
namespace {

TEST(Rng, SameSeedSameStreamOtherSeedOtherStream) {
  Rng a(1), b(1), c(2);
  bool differs = false;
  for (int i = 0; i < 100; ++i) {
    const std::uint64_t value = a.Next();
    EXPECT_EQ(value, b.Next());
    differs |= value != c.Next();
  }
  EXPECT_TRUE(differs);
}

TEST(Rng, MomentsOfUniformAndGaussian) {
  Rng rng(3);
  const int n = 200'000;
  double mean = 0, gaussian_mean = 0, gaussian_square = 0;
  for (int i = 0; i < n; ++i) {
    const double u = rng.Uniform();
    ASSERT_GE(u, 0.0);
    ASSERT_LT(u, 1.0);
    mean += u / n;
    const double g = rng.Gaussian();
    gaussian_mean += g / n;
    gaussian_square += g * g / n;
  }
  EXPECT_NEAR(mean, 0.5, 4.0 * 0.2887 / std::sqrt(n));
  EXPECT_NEAR(gaussian_mean, 0.0, 4.0 / std::sqrt(n));
  EXPECT_NEAR(gaussian_square, 1.0, 4.0 * std::sqrt(2.0 / n));
}

TEST(Rng, IndexCoversItsRangeEvenly) {
  Rng rng(4);
  int counts[7] = {};
  for (int i = 0; i < 70'000; ++i) ++counts[rng.Index(7)];
  for (const int count : counts) EXPECT_NEAR(count, 10'000, 400);
}

}  // namespace
}  // namespace rsfm
