// Eight floats at a time, whatever the machine's registers hold: sums whose order is written out,
// so that every clone of a function (base/vector_clones.h) gives the same bits. Private to the
// layer.
#pragma once

#include "rsfm/base/vector_clones.h"

namespace rsfm {

// Eight lanes; anywhere in memory.
using Float8 = float __attribute__((vector_size(32)));
using Float8InMemory = float __attribute__((vector_size(32), aligned(4), may_alias));
inline constexpr int kLanes = 8;

}  // namespace rsfm

// As macros: a function that returns a Float8 has another ABI in each clone.
#define RSFM_LOAD8(from) (*reinterpret_cast<const ::rsfm::Float8InMemory*>(from))
#define RSFM_STORE8(value, to) (*reinterpret_cast<::rsfm::Float8InMemory*>(to) = (value))
#define RSFM_SUM8(v) \
  ((((v)[0] + (v)[4]) + ((v)[2] + (v)[6])) + (((v)[1] + (v)[5]) + ((v)[3] + (v)[7])))
