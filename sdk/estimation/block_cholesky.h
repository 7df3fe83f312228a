// A symmetric positive definite matrix of 6 x 6 blocks in fixed memory, and its Cholesky factor.
#pragma once

#include <span>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/base/linear.h"

namespace rsfm {

// Only blocks on and below the diagonal are used. The only allocation is the constructor's.
class BlockCholesky {
 public:
  BlockCholesky() = default;
  explicit BlockCholesky(int max_blocks)
      : blocks_(static_cast<std::size_t>(max_blocks) * (max_blocks + 1) / 2),
        diagonal_(static_cast<std::size_t>(max_blocks) * 6) {}

  // Sets all to zero. Precondition: num_blocks <= max_blocks.
  void Reset(int num_blocks);
  int num_blocks() const { return num_blocks_; }
  std::size_t bytes() const { return blocks_.bytes() + diagonal_.bytes(); }

  // Precondition: row >= column.
  Mat6& Block(int row, int column) { return blocks_[row * (row + 1) / 2 + column]; }
  const Mat6& Block(int row, int column) const { return blocks_[row * (row + 1) / 2 + column]; }

  // Remembers the diagonal as it is now: what pivots are compared with. Called before other
  // unknowns are eliminated, whose subtraction leaves rounding errors of that size.
  void MarkDiagonal() noexcept;

  // Replaces the matrix by its factor. False when a pivot falls to or below `relative_pivot` times
  // its marked diagonal entry: not positive definite, or not determined.
  bool Factorise(double relative_pivot) noexcept;

  // x := A^-1 x with the factor. Precondition: Factorise() was true, x has num_blocks() entries.
  void SolveInPlace(std::span<Vec6> x) const noexcept;

 private:
  FixedVector<Mat6> blocks_;
  FixedVector<double> diagonal_;
  int num_blocks_ = 0;
};

}  // namespace rsfm
