#include "tools/offline/reduced_system.h"

#include <algorithm>

namespace rsfm {

BlockPattern::BlockPattern(int num_poses)
    : num_poses_(num_poses),
      words_((static_cast<std::size_t>(num_poses) + 63) / 64),
      bits_(words_ * static_cast<std::size_t>(num_poses), 0) {
  for (int i = 0; i < num_poses; ++i) Link(i, i);
}

void BlockPattern::Link(int a, int b) {
  const int row = std::max(a, b), column = std::min(a, b);
  bits_[static_cast<std::size_t>(column) * words_ + (row >> 6)] |= std::uint64_t{1} << (row & 63);
}

void BlockPattern::Finish() {
  rank_.resize(bits_.size());
  start_.assign(1, 0);
  int count = 0;
  for (int column = 0; column < num_poses_; ++column) {
    for (std::size_t w = 0; w < words_; ++w) {
      const std::size_t word = static_cast<std::size_t>(column) * words_ + w;
      rank_[word] = count;
      for (std::uint64_t bits = bits_[word]; bits != 0; bits &= bits - 1) {
        rows_.push_back(static_cast<int>(64 * w) + __builtin_ctzll(bits));
        ++count;
      }
    }
    start_.push_back(count);
  }
}

void ReducedSums::Reset(int num_blocks, int num_poses, int num_shared) {
  blocks.assign(static_cast<std::size_t>(num_blocks), Mat6::Zero());
  border.setZero(6 * num_poses, num_shared);
  shared.setZero(num_shared, num_shared);
  pose_gradient.setZero(6 * num_poses);
  shared_gradient.setZero(num_shared);
  pose_diagonal.setZero(6 * num_poses);
  shared_diagonal.setZero(num_shared);
  points_decrease = 0.0;
}

void ReducedSums::Add(const ReducedSums& other) {
  for (std::size_t i = 0; i < blocks.size(); ++i) blocks[i] += other.blocks[i];
  border += other.border;
  shared += other.shared;
  pose_gradient += other.pose_gradient;
  shared_gradient += other.shared_gradient;
  pose_diagonal += other.pose_diagonal;
  shared_diagonal += other.shared_diagonal;
  points_decrease += other.points_decrease;
}

ReducedSystem::ReducedSystem(const BlockPattern& pattern, int num_shared)
    : pattern_(pattern), num_shared_(num_shared) {
  const int size = 6 * pattern.num_poses();
  matrix_.resize(size, size);
  matrix_.resizeNonZeros(36 * pattern.num_blocks() - 15 * pattern.num_poses());
  int place = 0;
  for (int column = 0; column < size; ++column) {
    matrix_.outerIndexPtr()[column] = place;
    for (const int row : pattern.Rows(column / 6))
      for (int r = 6 * row; r < 6 * row + 6; ++r)
        if (r >= column) matrix_.innerIndexPtr()[place++] = r;
  }
  matrix_.outerIndexPtr()[size] = place;
  std::fill_n(matrix_.valuePtr(), place, 1.0);
  if (size > 0) factor_.analyzePattern(matrix_);
}

bool ReducedSystem::Factorise(const ReducedSums& sums, double lambda) {
  const int size = 6 * pattern_.num_poses();
  if (size == 0) return true;
  double* value = matrix_.valuePtr();
  for (int column = 0; column < size; ++column) {
    const int inner = column % 6, start = pattern_.Start(column / 6);
    const int count = static_cast<int>(pattern_.Rows(column / 6).size());
    const Mat6& diagonal = sums.blocks[static_cast<std::size_t>(start)];
    *value++ = diagonal(inner, inner) + lambda * sums.pose_diagonal[column] + 1e-12;
    for (int r = inner + 1; r < 6; ++r) *value++ = diagonal(r, inner);
    for (int b = 1; b < count; ++b) {
      const double* block = sums.blocks[static_cast<std::size_t>(start + b)].col(inner).data();
      value = std::copy_n(block, 6, value);
    }
  }
  factor_.factorize(matrix_);
  return factor_.info() == Eigen::Success;
}

Eigen::MatrixXd ReducedSystem::SolvePoses(const Eigen::MatrixXd& right) const {
  if (right.size() == 0) return right;
  return factor_.solve(right);
}

bool ReducedSystem::Solve(const ReducedSums& sums, double lambda, Eigen::VectorXd* pose_step,
                          Eigen::VectorXd* shared_step) {
  if (!Factorise(sums, lambda)) return false;
  Eigen::MatrixXd right(sums.border.rows(), num_shared_ + 1);
  right.col(0) = sums.pose_gradient;
  right.rightCols(num_shared_) = sums.border;
  const Eigen::MatrixXd solved = SolvePoses(right);
  shared_step->resize(num_shared_);
  *pose_step = -solved.col(0);
  if (num_shared_ > 0) {
    const auto through = solved.rightCols(num_shared_);
    Eigen::MatrixXd information = sums.shared - sums.border.transpose() * through;
    information.diagonal() += lambda * sums.shared_diagonal;
    // Parameters differ by many orders of magnitude: scaled to a unit diagonal.
    const Eigen::VectorXd scale =
        information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    information = scale.asDiagonal() * information * scale.asDiagonal();
    const Eigen::LLT<Eigen::MatrixXd> factor(information);
    if (factor.info() != Eigen::Success) return false;
    const Eigen::VectorXd gradient = sums.shared_gradient - sums.border.transpose() * solved.col(0);
    *shared_step = -(scale.asDiagonal() * factor.solve(scale.asDiagonal() * gradient));
    *pose_step -= through * *shared_step;
  }
  return pose_step->allFinite() && shared_step->allFinite();
}

}  // namespace rsfm
