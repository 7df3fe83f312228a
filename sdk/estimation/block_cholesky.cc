#include "rsfm/estimation/block_cholesky.h"

#include <cmath>

namespace rsfm {
namespace {

// In-place lower Cholesky factor of one block; the upper triangle is set to zero.
bool FactoriseBlock(Mat6* block, const double* marked_diagonal, double relative_pivot) {
  Mat6& a = *block;
  for (int j = 0; j < 6; ++j) {
    double pivot = a(j, j);
    for (int k = 0; k < j; ++k) pivot -= a(j, k) * a(j, k);
    // Written so that NaN fails.
    if (!(pivot > relative_pivot * marked_diagonal[j]) || !(pivot > 0.0)) return false;
    const double root = std::sqrt(pivot);
    a(j, j) = root;
    for (int i = j + 1; i < 6; ++i) {
      double value = a(i, j);
      for (int k = 0; k < j; ++k) value -= a(i, k) * a(j, k);
      a(i, j) = value / root;
    }
    for (int i = 0; i < j; ++i) a(i, j) = 0.0;
  }
  return true;
}

}  // namespace

void BlockCholesky::Reset(int num_blocks) {
  num_blocks_ = num_blocks;
  const std::size_t count = static_cast<std::size_t>(num_blocks) * (num_blocks + 1) / 2;
  blocks_.TryResizeForOverwrite(count);
  for (Mat6& block : blocks_) block.setZero();
  diagonal_.TryResizeForOverwrite(static_cast<std::size_t>(num_blocks) * 6);
}

void BlockCholesky::MarkDiagonal() noexcept {
  for (int j = 0; j < num_blocks_; ++j)
    for (int i = 0; i < 6; ++i) diagonal_[6 * j + i] = Block(j, j)(i, i);
}

bool BlockCholesky::Factorise(double relative_pivot) noexcept {
  for (int j = 0; j < num_blocks_; ++j) {
    Mat6& pivot = Block(j, j);
    for (int k = 0; k < j; ++k) pivot.noalias() -= Block(j, k) * Block(j, k).transpose();
    if (!FactoriseBlock(&pivot, &diagonal_[6 * j], relative_pivot)) return false;
    for (int i = j + 1; i < num_blocks_; ++i) {
      Mat6& below = Block(i, j);
      for (int k = 0; k < j; ++k) below.noalias() -= Block(i, k) * Block(j, k).transpose();
      // below := below * pivot^-T, column by column.
      for (int c = 0; c < 6; ++c) {
        for (int k = 0; k < c; ++k) below.col(c) -= pivot(c, k) * below.col(k);
        below.col(c) /= pivot(c, c);
      }
    }
  }
  return true;
}

void BlockCholesky::SolveInPlace(std::span<Vec6> x) const noexcept {
  for (int i = 0; i < num_blocks_; ++i) {
    for (int k = 0; k < i; ++k) x[i].noalias() -= Block(i, k) * x[k];
    const Mat6& pivot = Block(i, i);
    for (int r = 0; r < 6; ++r) {
      for (int k = 0; k < r; ++k) x[i][r] -= pivot(r, k) * x[i][k];
      x[i][r] /= pivot(r, r);
    }
  }
  for (int i = num_blocks_ - 1; i >= 0; --i) {
    for (int k = i + 1; k < num_blocks_; ++k) x[i].noalias() -= Block(k, i).transpose() * x[k];
    const Mat6& pivot = Block(i, i);
    for (int r = 5; r >= 0; --r) {
      for (int k = r + 1; k < 6; ++k) x[i][r] -= pivot(k, r) * x[i][k];
      x[i][r] /= pivot(r, r);
    }
  }
}

}  // namespace rsfm
