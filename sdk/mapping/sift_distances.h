// Squared distances between SIFT descriptors, a block of rows at a time, by the widest vector unit
// there is. All kernels give the same integers.
#pragma once

#include <cstdint>

namespace rsfm {

enum class SiftKernel : std::uint8_t {
  kPortable,    // plain loops, which compilers vectorise
  kAvx2,        // x86: sums of two products of 16 bits
  kAvx512Vnni,  // x86: sums of four products of 8 bits
};
bool IsSupported(SiftKernel kernel) noexcept;  // by this processor and build
SiftKernel BestSiftKernel() noexcept;

class SiftBlock {
 public:
  static constexpr int kBytes = 128;  // of a descriptor
  static constexpr int kRows = 64;    // of train at a time: they stay in the nearest cache
  static constexpr int kQueries = 4;  // at a time: each load of a train row serves them all
  using Distances = std::int32_t[kQueries][kRows];

  explicit SiftBlock(SiftKernel kernel) noexcept : kernel_(kernel) {}

  // What Measure wants to know of a query beside its bytes.
  std::int32_t Constant(const std::uint8_t* query) const noexcept;

  // At most kRows rows, one after the other.
  void Load(const std::uint8_t* rows, int count) noexcept;
  // |a - b|^2 = |a|^2 + |b|^2 - 2 a.b of at most kQueries rows `a` with those loaded; what lies
  // beyond the counts in `distances` is undefined. `constants` of the queries.
  void Measure(const std::uint8_t* queries, const std::int32_t* constants, int num_queries,
               Distances& distances) const noexcept;

 private:
  SiftKernel kernel_;
  int count_ = 0;
  alignas(64) std::int16_t wide_[kRows * kBytes] = {};  // by row, or pairs of columns of all rows
  alignas(64) std::int8_t quads_[kRows * kBytes] = {};  // four columns of all rows, less 128
  alignas(64) std::int32_t squared_norms_[kRows] = {};
};

}  // namespace rsfm
