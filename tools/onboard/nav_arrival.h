// Navigation on its way from the bus, or a replayed table, to the mapper.
#pragma once

#include <array>
#include <cstdint>

#include "rsfm/base/time.h"
#include "rsfm/navigation/nav_sample.h"

namespace rsfm {

// A message as it came, and the sample in it where there is one. The mapper logs it when it takes
// the sample: so the log has navigation in the mapper's own order, and replays to the same bytes.
struct NavArrival {
  // More than any message of navigation has: a longer one is logged where it is received.
  static constexpr std::size_t kMaxBytes = 1024;

  bool has_sample = false;
  std::uint16_t input = 0;  // of rig.bus.inputs
  std::uint16_t size = 0;   // of data; 0: nothing to log
  Utime received_utime = 0;
  NavSample sample;
  std::array<std::uint8_t, kMaxBytes> data;
};

}  // namespace rsfm
