#include "rsfm/mapping/pose_graph.h"

#include <Eigen/Cholesky>
#include <algorithm>

namespace rsfm {
namespace {

constexpr double kGate = 22.46;        // chi-square, six degrees of freedom, 0.1 %
constexpr double kSmallStep = 1e-7;    // rad and m: converged
constexpr double kSettledPart = 0.25;  // of a link's variance that a settled loop leaves

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

// Of the left perturbation of the world that turns and shifts at `place`.
Mat6 AtPlace(const Vec3& place) {
  Mat6 world_from_local = Mat6::Identity();
  world_from_local.bottomLeftCorner<3, 3>() = Hat(place);
  return world_from_local;
}

}  // namespace

PoseGraph::PoseGraph(const PoseGraphOptions& options)
    : options_(options),
      nodes_(Count(options.max_nodes)),
      loops_(Count(options.max_loops)),
      ends_(2 * Count(options.max_loops)),
      covariance_sums_(2 * Count(options.max_loops)),
      asked_sums_(2 * Count(options.max_loops)),
      dual_(Count(options.max_loops)),
      system_(options.max_loops) {}

std::size_t PoseGraph::bytes() const {
  return nodes_.bytes() + loops_.bytes() + ends_.bytes() + covariance_sums_.bytes() +
         asked_sums_.bytes() + dual_.bytes() + system_.bytes();
}

void PoseGraph::Clear() noexcept {
  nodes_.clear();
  loops_.clear();
}

bool PoseGraph::AddNode(const Rigid3& world_from_camera, const Vec6& variance,
                        const Rigid3& as_linked) noexcept {
  Node node;
  node.world_from_camera = world_from_camera;
  node.variance = variance;
  if (!nodes_.empty())
    node.before_from_this = nodes_.back().world_from_camera.Inverse() * as_linked;
  return nodes_.TryPushBack(node);
}

void PoseGraph::Move(const Rigid3& new_world_from_world) noexcept {
  for (Node& node : nodes_) node.world_from_camera = new_world_from_world * node.world_from_camera;
}

// What the loops have said is in the poses; the links are from now on as they are there.
void PoseGraph::Settle() noexcept {
  for (std::size_t i = 1; i < nodes_.size(); ++i) {
    nodes_[i].before_from_this =
        nodes_[i - 1].world_from_camera.Inverse() * nodes_[i].world_from_camera;
    const int node = static_cast<int>(i);
    if (std::any_of(loops_.begin(), loops_.end(),
                    [node](const Loop& loop) { return loop.a < node && node <= loop.b; }))
      nodes_[i].variance *= kSettledPart;
  }
  loops_.clear();
}

void PoseGraph::DropOldest(int count) noexcept {
  count = std::clamp(count, 0, size());
  if (count == 0) return;
  if (std::any_of(loops_.begin(), loops_.end(), [&](const Loop& l) { return l.a < count; }))
    Settle();
  std::move(nodes_.begin() + count, nodes_.end(), nodes_.begin());
  nodes_.TryResizeForOverwrite(nodes_.size() - Count(count));
  for (Loop& loop : loops_) {
    loop.a -= count;
    loop.b -= count;
  }
}

Mat6 PoseGraph::CovarianceInWorld(const Node& node) const noexcept {
  const Mat6 at = AtPlace(node.world_from_camera.translation);
  return at * node.variance.asDiagonal() * at.transpose();
}

// Where the link's measurement would put the node, from where it is.
Vec6 PoseGraph::Asked(std::size_t i) const noexcept {
  return LogSe3(nodes_[i - 1].world_from_camera * nodes_[i].before_from_this *
                nodes_[i].world_from_camera.Inverse());
}

Vec6 PoseGraph::Discrepancy(const Loop& loop) const noexcept {
  return LogSe3(world_from_camera(loop.a) * loop.a_from_b * world_from_camera(loop.b).Inverse());
}

Mat6 PoseGraph::LinkCovariance(int a, int b) const noexcept {
  Mat6 sum = Mat6::Zero();
  for (int i = a + 1; i <= b; ++i) sum += CovarianceInWorld(nodes_[Count(i)]);
  return sum;
}

bool PoseGraph::IsPlausible(const Loop& loop) const noexcept {
  const Mat6 adjoint = AdjointSe3(world_from_camera(loop.b));
  const Mat6 covariance =
      LinkCovariance(loop.a, loop.b) + adjoint * loop.covariance * adjoint.transpose();
  const Eigen::LLT<Mat6> cholesky(covariance);
  const Vec6 off = Discrepancy(loop);
  return cholesky.info() == Eigen::Success && off.dot(cholesky.solve(off)) < kGate;
}

// The place of a node among the ends.
int PoseGraph::EndOf(int node) const noexcept {
  return static_cast<int>(std::lower_bound(ends_.begin(), ends_.end(), node) - ends_.begin());
}

void PoseGraph::SumLinks() noexcept {
  ends_.clear();
  for (const Loop& loop : loops_) {
    ends_.TryPushBack(loop.a);
    ends_.TryPushBack(loop.b);
  }
  std::sort(ends_.begin(), ends_.end());
  covariance_sums_.TryResizeForOverwrite(ends_.size());
  asked_sums_.TryResizeForOverwrite(ends_.size());
  Mat6 covariance = Mat6::Zero();
  Vec6 asked = Vec6::Zero();
  std::size_t end = 0;
  for (int node = 0; end < ends_.size(); ++node) {
    if (node > 0) {
      covariance += CovarianceInWorld(nodes_[Count(node)]);
      asked += Asked(Count(node));
    }
    for (; end < ends_.size() && ends_[end] == node; ++end) {
      covariance_sums_[end] = covariance;
      asked_sums_[end] = asked;
    }
  }
}

// One linearisation: the dual, and from it the change of every node.
bool PoseGraph::Iterate(double* largest) noexcept {
  SumLinks();
  const int num_loops = this->num_loops();
  system_.Reset(num_loops);
  dual_.TryResizeForOverwrite(loops_.size());
  for (int l = 0; l < num_loops; ++l) {
    const Loop& loop = loops_[Count(l)];
    for (int m = 0; m <= l; ++m) {
      const int begin = std::max(loop.a, loops_[Count(m)].a);
      const int end = std::min(loop.b, loops_[Count(m)].b);
      if (begin < end)
        system_.Block(l, m) =
            covariance_sums_[Count(EndOf(end))] - covariance_sums_[Count(EndOf(begin))];
    }
    const Mat6 adjoint = AdjointSe3(world_from_camera(loop.b));
    system_.Block(l, l) += adjoint * loop.covariance * adjoint.transpose();
    dual_[Count(l)] =
        Discrepancy(loop) - (asked_sums_[Count(EndOf(loop.b))] - asked_sums_[Count(EndOf(loop.a))]);
  }
  system_.MarkDiagonal();
  if (!system_.Factorise(1e-14)) return false;
  system_.SolveInPlace(dual_.span());

  // Pulls of the loops that a link is in change only at their ends.
  Vec6 pull = Vec6::Zero(), change = Vec6::Zero();
  std::size_t end = 0;
  *largest = 0.0;
  Rigid3 before = nodes_[0].world_from_camera;  // as it was
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    Node& node = nodes_[i];
    const Rigid3 was = node.world_from_camera;
    if (i > 0) {
      change +=
          LogSe3(before * node.before_from_this * was.Inverse()) + CovarianceInWorld(node) * pull;
      node.world_from_camera = Perturb(was, change);
      *largest = std::max(*largest, (node.world_from_camera.translation - was.translation).norm());
      *largest = std::max(*largest, AngleBetween(node.world_from_camera.rotation, was.rotation));
    }
    before = was;
    if (end == ends_.size() || ends_[end] != static_cast<int>(i)) continue;
    while (end < ends_.size() && ends_[end] == static_cast<int>(i)) ++end;
    pull.setZero();
    for (std::size_t l = 0; l < loops_.size(); ++l)
      if (loops_[l].a <= static_cast<int>(i) && static_cast<int>(i) < loops_[l].b) pull += dual_[l];
  }
  return true;
}

Status PoseGraph::Close(const Loop& loop) noexcept {
  const bool is_finite = loop.a_from_b.rotation.coeffs().allFinite() &&
                         loop.a_from_b.translation.allFinite() && loop.covariance.allFinite();
  if (loop.a < 0 || loop.a >= loop.b || loop.b >= size() || !is_finite)
    return Fail(Errc::kInvalidArgument, "loop");
  if (!IsPlausible(loop)) return Fail(Errc::kNotEnoughInliers, "loop");
  if (loops_.full()) Settle();
  if (!loops_.TryPushBack(loop)) return Fail(Errc::kOutOfCapacity, "loops");
  for (int iteration = 0; iteration < options_.max_iterations; ++iteration) {
    double largest = 0.0;
    if (!Iterate(&largest)) {
      if (iteration > 0) break;
      loops_.pop_back();
      return Fail(Errc::kDegenerate, "loop");
    }
    if (largest < kSmallStep) break;
  }
  return {};
}

}  // namespace rsfm
