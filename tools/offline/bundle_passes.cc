#include "tools/offline/bundle_passes.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "tools/common/parallel.h"

namespace rsfm {
namespace {

using Mat63 = Eigen::Matrix<double, 6, 3>;

// How a robust loss weighs a residual and its derivatives so that plain least squares on them has
// the loss's gradient and its second derivative along the residual.   [Triggs 1999, sec. 4.3]
struct LossScale {
  double root = 1.0;   // of the weight
  double along = 0.0;  // share of the derivative along the residual that is taken off, over |r|^2
  double residual = 1.0;  // times root: the residual's

  Mat2 Weigh(const Vec2& r) const {
    Mat2 weigh = (-along * root) * r * r.transpose();
    weigh.diagonal().array() += root;
    return weigh;
  }
};
// The second derivative is negative far out, where the model would be no bowl: at most `most` of
// the curvature along the residual is taken off.
LossScale ScaleOf(const RobustLoss& loss, double squared_norm, double most) {
  LossScale scale;
  if (loss.type == LossType::kNone) return scale;
  const double weight = loss.Weight(squared_norm);
  scale.root = std::sqrt(weight);
  if (!(most > 0.0)) return scale;
  double taken = 0.0;  // -2 s rho'' / rho'
  if (loss.type == LossType::kCauchy) {
    const double s = squared_norm / (loss.scale * loss.scale);
    taken = 2.0 * s / (1.0 + s);
  } else if (squared_norm > loss.scale * loss.scale) {
    taken = 1.0;
  }
  const double left = std::sqrt(1.0 - std::min(taken, most));
  if (squared_norm > 0.0) scale.along = (1.0 - left) / squared_norm;
  scale.residual = 1.0 / left;
  return scale;
}

// The inverse of a point's information, a little above what it is so that a point without depth is
// held where it is.
bool InvertInformation(const Mat3& information, Mat3* inverse) {
  Mat3 held = information;
  held.diagonal() *= 1.0 + 1e-8;
  held.diagonal().array() += 1e-9 * information.trace() * 1e-3 + 1e-12;
  const Eigen::LLT<Mat3> factor(held);
  if (factor.info() != Eigen::Success) return false;
  *inverse = factor.solve(Mat3::Identity());
  return inverse->allFinite();
}

}  // namespace

struct BundlePasses::Workspace {
  struct Term {
    int block = -1;
    int camera = 0;
    Mat26 d_pose;
    Mat23 d_point;
    Vec2 residual;
    CameraColumnsJacobian d_shared;
    Mat63 eliminated;  // cross information with the point, times the root of its inverse
  };
  std::vector<Term> terms;
  Eigen::MatrixXd point_by_shared, root_by_shared;
};

BundlePasses::BundlePasses(const BundleOptions& options, const BundleProblem& problem,
                           const std::vector<PosePrior>& hold, const CameraUnknowns& unknowns)
    : options_(options),
      problem_(problem),
      unknowns_(unknowns),
      pose_block_(problem.images.size(), -1),
      pattern_(0) {
  for (const std::vector<PosePrior>* list : {&problem.priors, &hold})
    for (const PosePrior& prior : *list) priors_.push_back(&prior);
  Sort();
  Split();
  LinkAll();
  eliminated_.resize(problem.points.size());
  current_.resize(problem.observations.size());
  trial_.resize(problem.observations.size());
  point_by_shared_.resize(
      3 * static_cast<Eigen::Index>(unknowns.count() > 0 ? problem.points.size() : 0),
      unknowns.count());
}

void BundlePasses::Sort() {
  const std::vector<BundleObservation>& all = problem_.observations;
  first_.assign(problem_.points.size() + 1, 0);
  for (const BundleObservation& o : all) ++first_[static_cast<std::size_t>(o.point) + 1];
  std::partial_sum(first_.begin(), first_.end(), first_.begin());
  order_.resize(all.size());
  std::vector<int> next(first_.begin(), first_.end() - 1);
  for (std::size_t i = 0; i < all.size(); ++i)
    order_[static_cast<std::size_t>(next[all[i].point]++)] = static_cast<int>(i);
  for (std::size_t p = 0; p < problem_.points.size(); ++p) {
    std::stable_sort(order_.begin() + first_[p], order_.begin() + first_[p + 1],
                     [&all](int a, int b) { return all[a].image < all[b].image; });
  }
}

// Parts of about the same work: that of a point is linear in its observations and quadratic in
// the blocks that it fills.
void BundlePasses::Split() {
  const int num_points = static_cast<int>(problem_.points.size());
  std::vector<double> work(static_cast<std::size_t>(num_points) + 1, 0.0);
  for (int p = 0; p < num_points; ++p) {
    const double n = first_[p + 1] - first_[p];
    work[p + 1] = work[p] + n * (16.0 + n);
  }
  for (int part = 0; part <= kParts; ++part) {
    const double share = work.back() * part / kParts;
    part_start_[part] =
        static_cast<int>(std::lower_bound(work.begin(), work.end() - 1, share) - work.begin());
  }
  part_start_[0] = 0;
  part_start_[kParts] = num_points;
}

void BundlePasses::LinkAll() {
  std::vector<std::uint8_t> used(problem_.images.size(), 0);
  for (const BundleObservation& o : problem_.observations) used[o.image] = 1;
  for (const PosePrior* prior : priors_) {
    used[prior->a] = 1;
    if (prior->IsRelative()) used[prior->b] = 1;
  }
  int count = 0;
  for (std::size_t i = 0; i < problem_.images.size(); ++i)
    if (used[i] != 0 && !problem_.images[i].fixed) pose_block_[i] = count++;
  pattern_ = BlockPattern(count);
  const auto link = [this](int a, int b) {
    if (a >= 0 && b >= 0) pattern_.Link(a, b);
  };
  for (std::size_t p = 0; p < problem_.points.size(); ++p)
    for (int a = first_[p]; a < first_[p + 1]; ++a)
      for (int b = first_[p]; b < a; ++b)
        link(pose_block_[problem_.observations[order_[a]].image],
             pose_block_[problem_.observations[order_[b]].image]);
  for (const PosePrior* prior : priors_)
    if (prior->IsRelative()) link(pose_block_[prior->a], pose_block_[prior->b]);
  pattern_.Finish();
}

const ReducedSums& BundlePasses::Linearise(const BundleState& state) {
  port_columns_.clear();
  for (int c = 0; c < unknowns_.num_cameras(); ++c)
    port_columns_.push_back(unknowns_.PortColumns(c, state.configs[c]));
  ParallelFor(kParts, options_.num_threads, [&](int part) { LinearisePart(state, part); });
  ReducedSums& sums = sums_[0];
  for (int part = 1; part < kParts; ++part) sums.Add(sums_[part]);
  LinearisePriors(state, &sums);
  return sums;
}

void BundlePasses::LinearisePart(const BundleState& state, int part) {
  ReducedSums& sums = sums_[part];
  sums.Reset(pattern_.num_blocks(), pattern_.num_poses(), unknowns_.count());
  Workspace work;
  work.point_by_shared.resize(3, unknowns_.count());
  work.root_by_shared.resize(3, unknowns_.count());
  for (int p = part_start_[part]; p < part_start_[part + 1]; ++p)
    if (first_[p] < first_[p + 1]) EliminatePoint(state, p, &work, &sums);
}

void BundlePasses::EliminatePoint(const BundleState& state, int point, Workspace* work,
                                  ReducedSums* sums) {
  const int num_shared = unknowns_.count(), count = first_[point + 1] - first_[point];
  const double inverse_sigma = 1.0 / options_.sigma_px;
  if (static_cast<int>(work->terms.size()) < count)
    work->terms.resize(static_cast<std::size_t>(count));
  Mat3 information = Mat3::Zero();
  Vec3 gradient = Vec3::Zero();
  Eliminated& eliminated = eliminated_[point];
  eliminated.cost = 0.0;
  work->point_by_shared.setZero();
  int num_terms = 0;
  for (int k = first_[point]; k < first_[point + 1]; ++k) {
    const BundleObservation& o = problem_.observations[order_[k]];
    const int camera = problem_.images[o.image].camera;
    const Evaluated& now = current_[static_cast<std::size_t>(k)];
    if (!now.possible) {
      eliminated.cost += 0.5 * options_.loss.Rho(now.residual.squaredNorm());
      continue;
    }
    Workspace::Term& term = work->terms[static_cast<std::size_t>(num_terms)];
    const int num_columns = unknowns_.camera(camera).count;
    const Rigid3& pose = state.poses[o.image];
    if (num_columns == 0) {
      const Mat3 rotation = pose.rotation.toRotationMatrix();
      const Vec3 in_camera = rotation * state.points[point] + pose.translation;
      const Mat23 j =
          Eigen::Map<const Eigen::Matrix<float, 2, 3>>(now.d_pixel_d_point.data()).cast<double>();
      for (int row = 0; row < 2; ++row)
        term.d_pose.row(row).head<3>() = in_camera.cross(j.row(row).transpose()).transpose();
      term.d_pose.rightCols<3>() = j;
      term.d_point.noalias() = j.lazyProduct(rotation);
      term.d_shared.resize(2, 0);
    } else {
      ReprojectionJacobian all;
      Vec2 error;
      if (ReprojectionError(state.cameras[camera], pose, state.points[point], o.pixel, &error,
                            &all) != Projection::kOk)
        continue;
      term.d_pose = all.d_error_d_pose;
      term.d_point = all.d_error_d_point;
      unknowns_.Columns(camera, all, port_columns_[camera], &term.d_shared);
    }
    term.residual = now.residual;
    term.block = pose_block_[o.image];
    term.camera = camera;
    const double squared = term.residual.squaredNorm();
    eliminated.cost += 0.5 * options_.loss.Rho(squared);
    const LossScale scale = ScaleOf(options_.loss, squared, curvature_taken_);
    const Mat2 weigh = scale.Weigh(term.residual) * inverse_sigma;
    term.residual *= scale.root * scale.residual;
    term.d_pose = weigh * term.d_pose;
    term.d_point = weigh * term.d_point;
    information.noalias() += term.d_point.transpose().lazyProduct(term.d_point);
    gradient.noalias() += term.d_point.transpose().lazyProduct(term.residual);
    if (num_columns > 0) {
      const int first = unknowns_.camera(camera).first;
      term.d_shared = weigh.lazyProduct(term.d_shared).eval();
      work->point_by_shared.middleCols(first, num_columns).noalias() +=
          term.d_point.transpose().lazyProduct(term.d_shared);
      sums->shared.block(first, first, num_columns, num_columns).noalias() +=
          term.d_shared.transpose().lazyProduct(term.d_shared);
      sums->shared_diagonal.segment(first, num_columns) +=
          term.d_shared.colwise().squaredNorm().transpose();
      sums->shared_gradient.segment(first, num_columns).noalias() +=
          term.d_shared.transpose().lazyProduct(term.residual);
    }
    ++num_terms;
  }
  if (!InvertInformation(information, &eliminated.inverse)) {
    eliminated.inverse.setZero();
    eliminated.own_step.setZero();
  }
  eliminated.own_step = eliminated.inverse * gradient;
  sums->points_decrease += 0.5 * gradient.dot(eliminated.own_step);
  // inverse = root root^T
  const Mat3 root = Eigen::LLT<Mat3>(eliminated.inverse).matrixL();
  const bool eliminates = eliminated.inverse(0, 0) > 0.0 && root.allFinite();
  const Vec3 root_gradient = eliminates ? Vec3(root.transpose() * gradient) : Vec3::Zero();
  if (num_shared > 0) {
    if (eliminates) {
      work->root_by_shared.noalias() = root.transpose().lazyProduct(work->point_by_shared);
    } else {
      work->root_by_shared.setZero();
    }
    point_by_shared_.middleRows<3>(3 * static_cast<Eigen::Index>(point)).noalias() =
        eliminated.inverse.lazyProduct(work->point_by_shared);
    sums->shared.noalias() -= work->root_by_shared.transpose().lazyProduct(work->root_by_shared);
    sums->shared_gradient.noalias() -= work->root_by_shared.transpose().lazyProduct(root_gradient);
  }
  for (int a = 0; a < num_terms; ++a) {
    Workspace::Term& term = work->terms[static_cast<std::size_t>(a)];
    if (term.block < 0) continue;
    const int row = 6 * term.block;
    const Mat6 own = term.d_pose.transpose().lazyProduct(term.d_pose);
    sums->blocks[static_cast<std::size_t>(pattern_.Start(term.block))] += own;
    sums->pose_diagonal.segment<6>(row) += own.diagonal();
    sums->pose_gradient.segment<6>(row).noalias() +=
        term.d_pose.transpose().lazyProduct(term.residual);
    if (term.d_shared.cols() > 0 && num_shared > 0) {
      const CameraUnknowns::Camera& c = unknowns_.camera(term.camera);
      sums->border.block(row, c.first, 6, c.count).noalias() +=
          term.d_pose.transpose().lazyProduct(term.d_shared);
    }
    if (!eliminates) continue;
    term.eliminated.noalias() =
        term.d_pose.transpose().lazyProduct(Mat23(term.d_point.lazyProduct(root)));
    sums->pose_gradient.segment<6>(row).noalias() -= term.eliminated.lazyProduct(root_gradient);
    if (num_shared > 0) {
      sums->border.middleRows<6>(row).noalias() -=
          term.eliminated.lazyProduct(work->root_by_shared);
    }
    for (int b = 0; b <= a; ++b) {
      const Workspace::Term& other = work->terms[static_cast<std::size_t>(b)];
      if (other.block < 0) continue;
      Mat6& block = sums->blocks[static_cast<std::size_t>(pattern_.Index(term.block, other.block))];
      block.noalias() -= term.eliminated.lazyProduct(other.eliminated.transpose());
      if (b < a && other.block == term.block)
        block.noalias() -= other.eliminated.lazyProduct(term.eliminated.transpose());
    }
  }
}

void BundlePasses::LinearisePriors(const BundleState& state, ReducedSums* sums) const {
  const auto add = [&](int a, int b, const Mat6& block) {
    if (a < 0 || b < 0) return;
    if (a >= b) {
      sums->blocks[static_cast<std::size_t>(pattern_.Index(a, b))] += block;
    } else {
      sums->blocks[static_cast<std::size_t>(pattern_.Index(b, a))] += block.transpose();
    }
  };
  for (const PosePrior* prior : priors_) {
    const int a = pose_block_[prior->a], b = prior->IsRelative() ? pose_block_[prior->b] : -1;
    const PriorEvaluation e = EvaluatePrior(*prior, state.poses[prior->a],
                                            state.poses[prior->IsRelative() ? prior->b : prior->a]);
    const double weight = prior->loss.Weight(e.residual.squaredNorm());
    for (const auto& [block, d] : {std::pair(a, &e.d_residual_d_a), {b, &e.d_residual_d_b}}) {
      if (block < 0) continue;
      const Mat6 own = weight * d->transpose() * *d;
      add(block, block, own);
      sums->pose_diagonal.segment<6>(6 * block) += own.diagonal();
      sums->pose_gradient.segment<6>(6 * block) += weight * d->transpose() * e.residual;
    }
    add(a, b, weight * e.d_residual_d_a.transpose() * e.d_residual_d_b);
  }
  if (unknowns_.count() == 0) return;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(unknowns_.count(), unknowns_.count());
  unknowns_.AddPriors(state.configs, &information, &sums->shared_gradient);
  sums->shared += information;
  sums->shared_diagonal += information.diagonal();
}

double BundlePasses::PriorCost(const BundleState& state) const {
  double cost = unknowns_.PriorCost(state.configs);
  for (const PosePrior* prior : priors_) {
    const PriorEvaluation e = EvaluatePrior(*prior, state.poses[prior->a],
                                            state.poses[prior->IsRelative() ? prior->b : prior->a]);
    cost += 0.5 * prior->loss.Rho(e.residual.squaredNorm());
  }
  return cost;
}

double BundlePasses::EvaluatePoint(const BundleState& state, int point, const Vec3& xyz,
                                   Mat3* information, Vec3* gradient) {
  const double inverse_sigma = 1.0 / options_.sigma_px;
  double cost = 0.0;
  information->setZero();
  gradient->setZero();
  for (int k = first_[point]; k < first_[point + 1]; ++k) {
    const BundleObservation& o = problem_.observations[order_[k]];
    Evaluated& now = trial_[static_cast<std::size_t>(k)];
    Vec2 error(kImpossibleErrorPx, 0.0);
    Mat26 d_pose;
    Mat23 d_point;
    now.possible =
        ReprojectionError(state.cameras[problem_.images[o.image].camera], state.poses[o.image], xyz,
                          o.pixel, &error, &d_pose, &d_point) == Projection::kOk;
    now.residual = inverse_sigma * error;
    const double squared = now.residual.squaredNorm();
    cost += 0.5 * options_.loss.Rho(squared);
    if (!now.possible) continue;
    Eigen::Map<Eigen::Matrix<float, 2, 3>> kept(now.d_pixel_d_point.data());
    kept = d_pose.rightCols<3>().cast<float>();
    const LossScale scale = ScaleOf(options_.loss, squared, curvature_taken_);
    const Mat2 weigh = scale.Weigh(now.residual) * inverse_sigma;
    const Mat23 j = weigh.lazyProduct(d_point);
    gradient->noalias() += (scale.root * scale.residual) * j.transpose().lazyProduct(now.residual);
    information->noalias() += j.transpose().lazyProduct(j);
  }
  return cost;
}

Vec3 BundlePasses::FollowStep(const BundleState& before, int point,
                              const Eigen::VectorXd& pose_step,
                              const Eigen::VectorXd& shared_step) const {
  // The gradient by the point that the step of the others makes, to first order.
  const double inverse_sigma = 1.0 / options_.sigma_px;
  Vec3 pull = Vec3::Zero();
  for (int k = first_[point]; k < first_[point + 1]; ++k) {
    const int image = problem_.observations[order_[k]].image, block = pose_block_[image];
    const Evaluated& now = current_[static_cast<std::size_t>(k)];
    if (block < 0 || !now.possible) continue;
    const Mat3 rotation = before.poses[image].rotation.toRotationMatrix();
    const Vec3 in_camera = rotation * before.points[point] + before.poses[image].translation;
    const Vec3 moved =
        pose_step.segment<3>(6 * block).cross(in_camera) + pose_step.segment<3>(6 * block + 3);
    const Mat23 j =
        Eigen::Map<const Eigen::Matrix<float, 2, 3>>(now.d_pixel_d_point.data()).cast<double>();
    const Mat2 weigh =
        ScaleOf(options_.loss, now.residual.squaredNorm(), curvature_taken_).Weigh(now.residual) *
        inverse_sigma;
    const Vec2 change = weigh * (weigh * (j * moved));
    pull.noalias() += rotation.transpose() * (j.transpose() * change);
  }
  const Eliminated& eliminated = eliminated_[point];
  Vec3 step = -eliminated.own_step - eliminated.inverse * pull;
  if (shared_step.size() > 0) {
    step.noalias() -= point_by_shared_.middleRows<3>(3 * static_cast<Eigen::Index>(point))
                          .lazyProduct(shared_step);
  }
  return step;
}

// Newton's method on one point; at most kMaxSteps evaluations and one or two more where the first
// or the last was no good.
double BundlePasses::AdjustPoint(const BundleState& state, int point, double cost_before,
                                 Vec3* xyz) {
  // What is left is so little that the next step of all unknowns takes it along.
  constexpr double kSettled = 1e-4;
  const int max_steps = options_.adjust_points_within ? 6 : 0;
  struct At {
    Mat3 information;
    Vec3 gradient;
    double cost;
  } best, there;
  best.cost = EvaluatePoint(state, point, *xyz, &best.information, &best.gradient);
  bool is_kept = true;  // in trial_
  if (best.cost > 2.0 * cost_before + 1.0) {
    // The straight step went astray.
    there.cost =
        EvaluatePoint(state, point, state.points[point], &there.information, &there.gradient);
    is_kept = there.cost < best.cost;
    if (is_kept) {
      *xyz = state.points[point];
      best = there;
    }
  }
  double damping = 0.0;
  for (int i = 0; i < max_steps; ++i) {
    Mat3 damped = best.information, inverse;
    damped.diagonal() *= 1.0 + damping;
    if (!InvertInformation(damped, &inverse)) break;
    const Vec3 step = -inverse * best.gradient;
    if (-0.5 * best.gradient.dot(step) <= kSettled * best.cost) break;
    const Vec3 moved = *xyz + step;
    there.cost = EvaluatePoint(state, point, moved, &there.information, &there.gradient);
    is_kept = there.cost < best.cost;
    if (!is_kept) {
      damping = damping == 0.0 ? 1e-2 : 30.0 * damping;
      continue;
    }
    damping *= 0.1;
    *xyz = moved;
    best = there;
  }
  if (!is_kept) EvaluatePoint(state, point, *xyz, &there.information, &there.gradient);
  return best.cost;
}

double BundlePasses::MovePoints(const BundleState& before, const Eigen::VectorXd& pose_step,
                                const Eigen::VectorXd& shared_step, BundleState* moved) {
  std::array<double, kParts> costs{};
  ParallelFor(kParts, options_.num_threads, [&](int part) {
    double cost = 0.0;
    for (int p = part_start_[part]; p < part_start_[part + 1]; ++p) {
      if (first_[p] == first_[p + 1]) continue;
      Vec3 xyz = before.points[p] + FollowStep(before, p, pose_step, shared_step);
      if (!xyz.allFinite()) xyz = before.points[p];
      // AdjustPoint looks at where the point was.
      moved->points[p] = before.points[p];
      cost += AdjustPoint(*moved, p, eliminated_[p].cost, &xyz);
      moved->points[p] = xyz;
    }
    costs[part] = cost;
  });
  return std::accumulate(costs.begin(), costs.end(), PriorCost(*moved));
}

double BundlePasses::Evaluate(const BundleState& state) {
  std::array<double, kParts> costs{};
  ParallelFor(kParts, options_.num_threads, [&](int part) {
    Mat3 information;
    Vec3 gradient;
    for (int p = part_start_[part]; p < part_start_[part + 1]; ++p)
      costs[part] += EvaluatePoint(state, p, state.points[p], &information, &gradient);
  });
  Accept();
  return std::accumulate(costs.begin(), costs.end(), PriorCost(state));
}

}  // namespace rsfm
