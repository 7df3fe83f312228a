// What of the process is in memory now.
#pragma once

#include <cstdint>

namespace rsfm {

std::int64_t ResidentBytes();  // 0: not known

}  // namespace rsfm
