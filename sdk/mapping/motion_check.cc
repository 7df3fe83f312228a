#include "rsfm/mapping/motion_check.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace rsfm {
namespace {

constexpr double kMovedPx = 4.0;  // since the keyframe: such points say how the scene moves
constexpr double kStationaryFromPx = 6.0;  // where the scene moves by less nothing is stationary
constexpr double kStationaryPx = 1.0, kStationaryPart = 0.1;
constexpr double kMinMovingPart = 0.4;  // of all points: fewer may be what drifts past
constexpr int kMinPoints = 20;
constexpr int kAffineTrials = 40, kEpipolarTrials = 60;  // the bounds of both searches
constexpr double kMinMotionPx = 1.5;  // median, for the epipolar constraint to say anything
constexpr double kMinEpipolarPart = 0.6;

std::size_t Count(int value) { return static_cast<std::size_t>(value); }
Vec2 ToVec2(const PatchPlace& place) { return {place.x, place.y}; }

// Conjugation that takes places to about one: (p - centre) * scale.
struct Frame {
  Vec2 centre = Vec2::Zero();
  double scale = 1.0;
  Vec3 Of(const Vec2& p) const { return ((p - centre) * scale).homogeneous(); }
  Mat3 Matrix() const {
    Mat3 m = Mat3::Identity() * scale;
    m.topRightCorner<2, 1>() = -scale * centre;
    m(2, 2) = 1.0;
    return m;
  }
};

// Squared distance to the epipolar constraint to first order [Sampson 1982, CVGIP].
double SampsonSquared(const Mat3& fundamental, const Vec2& from, const Vec2& to) {
  const Vec3 line = fundamental * from.homogeneous();
  const Vec3 back = fundamental.transpose() * to.homogeneous();
  const double product = to.homogeneous().dot(line);
  const double norm = line.head<2>().squaredNorm() + back.head<2>().squaredNorm();
  return norm > 0.0 ? product * product / norm : 0.0;
}

using Mat9 = Eigen::Matrix<double, 9, 9>;

// The matrix whose constraint the sums come nearest to; not forced to rank two: what is asked is
// the distance, not the epipole.
bool SolveEpipolar(const Mat9& normal, const Frame& frame, Mat3* fundamental) {
  const Eigen::SelfAdjointEigenSolver<Mat9> solver(normal);
  if (solver.info() != Eigen::Success) return false;
  const Eigen::Matrix<double, 9, 1> least = solver.eigenvectors().col(0);
  Mat3 normalised;
  for (int i = 0; i < 9; ++i) normalised(i / 3, i % 3) = least(i);
  *fundamental = frame.Matrix().transpose() * normalised * frame.Matrix();
  return fundamental->allFinite();
}

void AddConstraint(const Vec3& from, const Vec3& to, Mat9* normal) {
  Eigen::Matrix<double, 9, 1> row;
  for (int i = 0; i < 9; ++i) row(i) = to(i / 3) * from(i % 3);
  normal->noalias() += row * row.transpose();
}

}  // namespace

MotionCheck::MotionCheck(int max_points)
    : motions_(Count(max_points)), moving_(Count(max_points)), errors_(Count(max_points)) {}

void MotionCheck::Judge(std::span<const TrackedPoint> points, std::uint64_t seed,
                        std::span<PointVerdict> verdicts) noexcept {
  std::fill(verdicts.begin(), verdicts.end(), PointVerdict::kScene);
  if (points.size() > motions_.capacity() || points.size() < kMinPoints) return;
  Rng rng(seed);
  FindStationary(points, &rng, verdicts);
  FindDrifting(points, &rng, verdicts);
}

// By three motions at a time; refined on those within a third of the median motion.
bool MotionCheck::FitAffine(Rng* rng, Mat23* to_from_from) const noexcept {
  const auto size = static_cast<std::uint32_t>(moving_.size());
  double mean_motion = 0.0;
  for (const Motion& m : moving_) mean_motion += (m.to - m.from).norm() / size;
  const double tolerance = std::max(3.0, 0.33 * mean_motion);
  int best_count = 0;
  for (int trial = 0; trial < kAffineTrials; ++trial) {
    Mat3 from, to;
    for (int k = 0; k < 3; ++k) {
      const Motion& m = moving_[rng->Index(size)];
      from.col(k) = m.from.homogeneous();
      to.col(k) = m.to.homogeneous();
    }
    if (!(std::abs(from.determinant()) > 1e3)) continue;  // px^2, twice the triangle
    const Mat23 map = (to * from.inverse()).topRows<2>();
    int count = 0;
    for (const Motion& m : moving_)
      count += (map * m.from.homogeneous() - m.to).squaredNorm() <= tolerance * tolerance;
    if (count <= best_count) continue;
    best_count = count;
    *to_from_from = map;
  }
  if (2 * best_count < static_cast<int>(size)) return false;
  Mat3 normal = Mat3::Zero();
  Mat23 right = Mat23::Zero();
  for (const Motion& m : moving_) {
    const Vec3 from = m.from.homogeneous();
    if ((*to_from_from * from - m.to).squaredNorm() > tolerance * tolerance) continue;
    normal += from * from.transpose();
    right += m.to * from.transpose();
  }
  const Mat23 refined = right * normal.inverse();
  if (refined.allFinite()) *to_from_from = refined;
  return true;
}

void MotionCheck::FindStationary(std::span<const TrackedPoint> points, Rng* rng,
                                 std::span<PointVerdict> verdicts) noexcept {
  moving_.clear();
  int num_followed = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec2 from = ToVec2(points[i].at_keyframe), to = ToVec2(points[i].place);
    num_followed += points[i].age > 0;
    if ((to - from).norm() >= kMovedPx) moving_.TryPushBack({from, to, static_cast<int>(i)});
  }
  const auto size = static_cast<double>(moving_.size());
  if (size < kMinPoints || size < kMinMovingPart * num_followed) return;
  Mat23 map;
  if (!FitAffine(rng, &map)) return;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (points[i].age == 0) continue;
    const Vec2 from = ToVec2(points[i].at_keyframe);
    const double own = (ToVec2(points[i].place) - from).norm();
    const double scene = (map * from.homogeneous() - from).norm();
    if (scene >= kStationaryFromPx && own <= std::max(kStationaryPx, kStationaryPart * scene))
      verdicts[i] = PointVerdict::kStationary;
  }
}

int MotionCheck::CountWithin(const Mat3& fundamental, double max_error_px) noexcept {
  int count = 0;
  for (const Motion& m : motions_)
    count += SampsonSquared(fundamental, m.from, m.to) <= max_error_px * max_error_px;
  return count;
}

bool MotionCheck::FitEpipolar(Rng* rng, double max_error_px, Mat3* fundamental) noexcept {
  const auto size = static_cast<std::uint32_t>(motions_.size());
  Frame frame;
  for (const Motion& m : motions_) frame.centre += m.from / size;
  double spread = 0.0;
  for (const Motion& m : motions_) spread += (m.from - frame.centre).norm() / size;
  if (!(spread > 1.0)) return false;
  frame.scale = 1.0 / spread;
  int best_count = 0;
  for (int trial = 0; trial < kEpipolarTrials; ++trial) {
    Mat9 normal = Mat9::Zero();
    for (int k = 0; k < 8; ++k) {
      const Motion& m = motions_[rng->Index(size)];
      AddConstraint(frame.Of(m.from), frame.Of(m.to), &normal);
    }
    Mat3 candidate;
    if (!SolveEpipolar(normal, frame, &candidate)) continue;
    const int count = CountWithin(candidate, max_error_px);
    if (count <= best_count) continue;
    best_count = count;
    *fundamental = candidate;
    if (count >= 0.9 * size) break;
  }
  // Again from all that agree, which settles what eight cannot.
  for (int round = 0; round < 2 && best_count >= 8; ++round) {
    Mat9 normal = Mat9::Zero();
    for (const Motion& m : motions_) {
      if (SampsonSquared(*fundamental, m.from, m.to) <= max_error_px * max_error_px)
        AddConstraint(frame.Of(m.from), frame.Of(m.to), &normal);
    }
    Mat3 refined;
    if (!SolveEpipolar(normal, frame, &refined)) break;
    const int count = CountWithin(refined, max_error_px);
    if (count < best_count) break;
    best_count = count;
    *fundamental = refined;
  }
  return best_count >= kMinEpipolarPart * size;
}

void MotionCheck::FindDrifting(std::span<const TrackedPoint> points, Rng* rng,
                               std::span<PointVerdict> verdicts) noexcept {
  motions_.clear();
  errors_.clear();
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (points[i].age == 0 || verdicts[i] != PointVerdict::kScene) continue;
    motions_.TryPushBack({ToVec2(points[i].before), ToVec2(points[i].place), static_cast<int>(i)});
    errors_.TryPushBack((motions_.back().to - motions_.back().from).norm());
  }
  if (motions_.size() < kMinPoints) return;
  double* middle = errors_.data() + errors_.size() / 2;
  std::nth_element(errors_.data(), middle, errors_.data() + errors_.size());
  const double median_px = *middle;
  if (!(median_px >= kMinMotionPx)) return;
  const double tolerance_px = std::max(0.7, 0.03 * median_px);
  Mat3 fundamental;
  if (!FitEpipolar(rng, tolerance_px, &fundamental)) return;
  for (const Motion& m : motions_) {
    if (SampsonSquared(fundamental, m.from, m.to) > 9.0 * tolerance_px * tolerance_px)
      verdicts[Count(m.point)] = PointVerdict::kDrifting;
  }
}

}  // namespace rsfm
