// Counts the heap calls of this thread while a trap is alive, those made inside shared libraries
// included.
//
//   MallocTrap trap;
//   function_under_test();
//   EXPECT_EQ(trap.count(), 0);
//
// In sanitizer builds, which bring their own malloc, the trap is absent: count() is then always 0.
#pragma once

#include <cstddef>

namespace rsfm {

class MallocTrap {
 public:
  MallocTrap();
  ~MallocTrap();
  MallocTrap(const MallocTrap&) = delete;
  MallocTrap& operator=(const MallocTrap&) = delete;

  std::size_t count() const;  // malloc, calloc, realloc and aligned allocations since construction
  std::size_t bytes() const;
  static constexpr bool IsActive() {
#ifdef RSFM_SANITIZED
    return false;
#else
    return true;
#endif
  }
};

// Suspends the traps of this thread: for the stated exceptions (OpenCV's own buffers) inside a
// watched section.
class MallocTrapPause {
 public:
  MallocTrapPause();
  ~MallocTrapPause();
};

}  // namespace rsfm
