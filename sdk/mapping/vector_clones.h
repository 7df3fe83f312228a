// Inner loops in one clone per vector width, chosen when the program is loaded. Whatever is marked
// must give the same bits in every clone: integers, or floats whose order of summation is written
// out (Float8). Private to the layer.
#pragma once

// Not under a sanitizer, whose runtime is not up by the time the clone is chosen.
#if defined(__x86_64__) && defined(__gnu_linux__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define RSFM_VECTOR_CLONES __attribute__((target_clones("avx2", "popcnt", "default")))
#define RSFM_FLOAT_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define RSFM_VECTOR_CLONES
#define RSFM_FLOAT_CLONES
#endif

namespace rsfm {

// Eight lanes, whatever the machine's registers hold; anywhere in memory.
using Float8 = float __attribute__((vector_size(32)));
using Float8InMemory = float __attribute__((vector_size(32), aligned(4), may_alias));
inline constexpr int kLanes = 8;

}  // namespace rsfm

// As macros: a function that returns a Float8 has another ABI in each clone.
#define RSFM_LOAD8(from) (*reinterpret_cast<const ::rsfm::Float8InMemory*>(from))
#define RSFM_STORE8(value, to) (*reinterpret_cast<::rsfm::Float8InMemory*>(to) = (value))
#define RSFM_SUM8(v) \
  ((((v)[0] + (v)[4]) + ((v)[2] + (v)[6])) + (((v)[1] + (v)[5]) + ((v)[3] + (v)[7])))
