// The way the camera went as a chain of relative poses, and the loops in it: what a revisit says of
// everything between. Fixed memory, a bounded number of steps.
//
// Of all chains the most likely one is sought: links as measured but for their noise, loops too,
//   min  sum_i |x_i - u_i|^2_(S_i)  +  sum_l |d_l - sum_(i in l) x_i|^2_(R_l),
// where x_i is the change of link i, u_i what its measurement asks for, d_l what the loop does; all
// of them left perturbations of world_from_camera, so that along the chain they add up. It is the
// dual that is solved, whose size is that of the loops and not of the chain:
//   (J S J' + R) y = d - J u,   x = u + S J' y,
// with J the sums over each loop [generalised least squares; Golub & Van Loan 2013, sec. 6.1.2].
// J S J' are sums of S over the stretches that two loops share. Linearised anew a few times.
#pragma once

#include "rsfm/base/error.h"
#include "rsfm/base/fixed_vector.h"
#include "rsfm/base/rigid3.h"
#include "rsfm/estimation/block_cholesky.h"

namespace rsfm {

struct PoseGraphOptions {
  int max_nodes = 20000;
  int max_loops = 64;
  int max_iterations = 4;
};

class PoseGraph {
 public:
  // A measured pose of node b's camera in node a's, a < b.
  struct Loop {
    int a = 0, b = 0;
    Rigid3 a_from_b;
    Mat6 covariance = Mat6::Zero();  // of a right perturbation of a_from_b: (rotation, translation)
  };

  // The only place that allocates.
  explicit PoseGraph(const PoseGraphOptions& options);

  void Clear() noexcept;
  // The next pose. `variance`: of the link from the node before, of a turn about the world's axes
  // at the camera and of a shift along them, rad^2 and m^2, each > 0; of the first it means
  // nothing. False when full. The link is measured as it is, or, given `as_linked`, as it would be
  // to there.
  bool AddNode(const Rigid3& world_from_camera, const Vec6& variance) noexcept {
    return AddNode(world_from_camera, variance, world_from_camera);
  }
  bool AddNode(const Rigid3& world_from_camera, const Vec6& variance,
               const Rigid3& as_linked) noexcept;
  // Where the world's frame moves, links stay.
  void Move(const Rigid3& new_world_from_world) noexcept;
  // Forgets the oldest `count` nodes; loops that reach into them are taken for settled (as Settle).
  void DropOldest(int count) noexcept;

  int size() const { return static_cast<int>(nodes_.size()); }
  int capacity() const { return static_cast<int>(nodes_.capacity()); }
  int num_loops() const { return static_cast<int>(loops_.size()); }
  const Rigid3& world_from_camera(int node) const {
    return nodes_[static_cast<std::size_t>(node)].world_from_camera;
  }
  const Vec6& variance(int node) const { return nodes_[static_cast<std::size_t>(node)].variance; }
  // Of the left perturbation from a to b, by the links alone.
  Mat6 LinkCovariance(int a, int b) const noexcept;

  // Adds a loop and finds all poses anew; node 0 stays where it is. Where there is no room for it,
  // the loops there are become part of the links first.
  //   kInvalidArgument   no such nodes, a >= b, or a pose or covariance that is not finite
  //   kNotEnoughInliers  contradicts the chain: beyond chi-square's 0.1 %; nothing is changed
  //   kDegenerate        the covariances do not determine it; nothing is changed
  Status Close(const Loop& loop) noexcept;

  std::size_t bytes() const;

 private:
  struct Node {
    Rigid3 world_from_camera;
    Rigid3 before_from_this;       // as measured
    Vec6 variance = Vec6::Zero();  // of that
  };
  Mat6 CovarianceInWorld(const Node& node) const noexcept;
  Vec6 Asked(std::size_t node) const noexcept;
  Vec6 Discrepancy(const Loop& loop) const noexcept;
  bool IsPlausible(const Loop& loop) const noexcept;
  void Settle() noexcept;
  void SumLinks() noexcept;
  int EndOf(int node) const noexcept;
  bool Iterate(double* largest) noexcept;

  PoseGraphOptions options_;
  FixedVector<Node> nodes_;
  FixedVector<Loop> loops_;
  // Where loops begin and end, ascending; the sums over the links up to there.
  FixedVector<int> ends_;
  FixedVector<Mat6> covariance_sums_;
  FixedVector<Vec6> asked_sums_;
  FixedVector<Vec6> dual_;
  BlockCholesky system_;
};

}  // namespace rsfm
