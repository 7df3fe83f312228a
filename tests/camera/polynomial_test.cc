#include "rsfm/camera/polynomial.h"

#include <gtest/gtest.h>

#include <array>
#include <limits>

namespace rsfm {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(FirstPositiveRoot, KnownRoots) {
  EXPECT_DOUBLE_EQ(FirstPositiveRoot(std::array{1.0, -0.5}, kInfinity), 2.0);
  EXPECT_NEAR(FirstPositiveRoot(std::array{2.0, -3.0, 1.0}, kInfinity), 1.0, 1e-15);  // (x-1)(x-2)
  EXPECT_NEAR(FirstPositiveRoot(std::array{6.0, -11.0, 6.0, -1.0}, kInfinity), 1.0,
              1e-14);  // (1-x)(2-x)(3-x)
  EXPECT_NEAR(FirstPositiveRoot(std::array{24.0, -50.0, 35.0, -10.0, 1.0}, kInfinity), 1.0, 1e-13);
  EXPECT_NEAR(FirstPositiveRoot(std::array{1.0, 0.0, 0.0, 0.0, -1e-8}, kInfinity), 100.0, 1e-11);
}

TEST(FirstPositiveRoot, NoneGivesTheUpperEnd) {
  EXPECT_EQ(FirstPositiveRoot(std::array{1.0}, kInfinity), kInfinity);
  EXPECT_EQ(FirstPositiveRoot(std::array{1.0, 0.3, 0.1}, kInfinity), kInfinity);
  EXPECT_EQ(FirstPositiveRoot(std::array{1.0, 0.0, 0.0}, 9.0), 9.0);
  EXPECT_EQ(FirstPositiveRoot(std::array{1.0, -0.01}, 9.0), 9.0);  // the root at 100 is beyond
  EXPECT_EQ(FirstPositiveRoot(std::array{1.0, -1.0, 1.0}, kInfinity), kInfinity);
}

}  // namespace
}  // namespace rsfm
