#include "tests/support/malloc_trap.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace rsfm {
namespace {

TEST(MallocTrap, CountsWhatAllocatesAndNothingElse) {
  if (!MallocTrap::IsActive()) GTEST_SKIP() << "sanitizer build";
  MallocTrap trap;
  EXPECT_EQ(trap.count(), 0u);
  auto p = std::make_unique<int>(3);
  std::vector<double> v(100, 1.0);
  EXPECT_GE(trap.count(), 2u);
  EXPECT_GE(trap.bytes(), 804u);
  const std::size_t before = trap.count();
  {
    MallocTrapPause pause;
    v.resize(1000);
  }
  EXPECT_EQ(trap.count(), before);
}

}  // namespace
}  // namespace rsfm
