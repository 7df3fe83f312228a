// The normal equations of a bundle adjustment after the points are eliminated: sparse in the poses,
// bordered by the few columns that all observations share (lens, port).
//
//   [ S   B ] [ poses  ]     [ gradient of the poses  ]
//   [ B^T C ] [ shared ] = - [ gradient of the shared ]
//
// S is held as 6 x 6 blocks, lower triangle, one for each pair of poses that see a common point or
// share a prior. Sums are made in a fixed number of parts and added in order, so that the result
// does not depend on how many threads there are.
#pragma once

#include <Eigen/CholmodSupport>
#include <Eigen/Dense>
#include <cstdint>
#include <span>
#include <vector>

#include "rsfm/base/linear.h"

namespace rsfm {

// Which pairs of poses have a block, and where.
class BlockPattern {
 public:
  explicit BlockPattern(int num_poses);
  void Link(int a, int b);  // in any order
  void Finish();            // after the last Link, once

  int num_poses() const { return num_poses_; }
  int num_blocks() const { return start_.empty() ? 0 : start_.back(); }
  // Precondition: row >= column, linked.
  int Index(int row, int column) const {
    const std::size_t word = static_cast<std::size_t>(column) * words_ + (row >> 6);
    const std::uint64_t below = bits_[word] & ((std::uint64_t{1} << (row & 63)) - 1);
    return rank_[word] + __builtin_popcountll(below);
  }
  // The rows of the blocks of a column, ascending, the first on the diagonal; they lie together
  // from Index(column, column) on.
  std::span<const int> Rows(int column) const {
    return {rows_.data() + start_[column],
            static_cast<std::size_t>(start_[column + 1] - start_[column])};
  }
  int Start(int column) const { return start_[column]; }

 private:
  int num_poses_;
  std::size_t words_;
  std::vector<std::uint64_t> bits_;  // by column
  std::vector<int> rank_;            // blocks before each word
  std::vector<int> start_, rows_;
};

// One part of the sums.
struct ReducedSums {
  std::vector<Mat6> blocks;  // by BlockPattern
  Eigen::MatrixXd border;    // 6 poses x shared
  Eigen::MatrixXd shared;    // shared x shared
  Eigen::VectorXd pose_gradient, shared_gradient;
  Eigen::VectorXd pose_diagonal, shared_diagonal;  // of the information before elimination
  double points_decrease = 0.0;  // what the points' own gradients promise, poses held

  void Reset(int num_blocks, int num_poses, int num_shared);
  void Add(const ReducedSums& other);
};

class ReducedSystem {
 public:
  ReducedSystem(const BlockPattern& pattern, int num_shared);

  // Solves with the diagonal damped: + lambda * (diagonal before elimination). False when that is
  // not positive definite.
  bool Solve(const ReducedSums& sums, double lambda, Eigen::VectorXd* pose_step,
             Eigen::VectorXd* shared_step);

  // The inverse's shared block, and S^-1 B for whatever else is wanted; undamped.
  bool Factorise(const ReducedSums& sums, double lambda);
  Eigen::MatrixXd SolvePoses(const Eigen::MatrixXd& right) const;

 private:
  const BlockPattern& pattern_;
  int num_shared_;
  Eigen::SparseMatrix<double, Eigen::ColMajor, int> matrix_;  // lower triangle
  Eigen::CholmodSupernodalLLT<Eigen::SparseMatrix<double, Eigen::ColMajor, int>, Eigen::Lower>
      factor_;
};

}  // namespace rsfm
