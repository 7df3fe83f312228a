// Structure-of-arrays path solvers: many points at once, in loops that the compiler vectorises.
//
// A block runs a fixed number of Halley steps on all its points, without a branch; a point that has not settled by then
// (a wild start, no path) is marked and left to the port's own solver. Statuses are those of the one-by-one functions,
// values agree with theirs to rounding. On x86-64 the functions exist twice, for AVX2 and for the baseline, chosen when
// the program starts; operations and their order are the same in both, and so are the results, bit for bit.
#pragma once

namespace rsfm {

inline constexpr int kPortBlock = 64;

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define RSFM_VECTOR_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define RSFM_VECTOR_CLONES
#endif

// Coordinates of a block of points, and what becomes of them.
struct PortBlock {
  double x[kPortBlock], y[kPortBlock], z[kPortBlock];
  double direction_x[kPortBlock], direction_y[kPortBlock], direction_z[kPortBlock];
  double settled[kPortBlock];  // 1: the direction is good; 0: ask the port's own solver
};

// Constants of a flat port, as FlatPort derives them.
struct FlatBlockParams {
  double normal[3];
  double distance, thickness;
  double invariant_ratio;                                       // index_water / index_lowest
  double apparent_air, apparent_glass;                          // index_water / index of each
  double ratio_glass, ratio_water, excess_glass, excess_water;  // against air, which is the lowest
};
// Precondition: air has the lowest index.
void SolveFlatBlock(const FlatBlockParams& params, PortBlock* block) noexcept;

struct DomeBlockParams {
  double center[3];
  double inner, outer;
  double air_to_glass, air_to_water;
};
void SolveDomeBlock(const DomeBlockParams& params, PortBlock* block) noexcept;

}  // namespace rsfm
