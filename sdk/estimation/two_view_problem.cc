#include "rsfm/estimation/two_view_problem.h"

#include <Eigen/LU>
#include <array>
#include <cmath>

namespace rsfm::internal {
namespace {

// The depth of the midpoint along bearing a over the baseline, negative when it is behind both; 0
// when the bearings are parallel or the point is behind one of the two.
double DepthRatio(const Mat3& rotation, const Vec3& direction, const RayPair& pair) {
  const Vec3 a = rotation * pair.bearing_a;
  const Vec3 normal = a.cross(pair.bearing_b);
  const double squared_sine = normal.squaredNorm();
  if (!(squared_sine > 1e-20)) return 0.0;
  const double depth_a = pair.bearing_b.cross(direction).dot(normal) / squared_sine;
  const double depth_b = a.cross(direction).dot(normal) / squared_sine;
  return depth_a * depth_b > 0.0 ? depth_a : 0.0;
}

}  // namespace

Vec3 NearestPoint(std::span<const RayPair> pairs, bool of_a) {
  Mat3 matrix = Mat3::Zero();
  Vec3 right_side = Vec3::Zero(), mean = Vec3::Zero();
  for (const RayPair& pair : pairs) {
    const Ray3& ray = of_a ? pair.a.ray : pair.b.ray;
    const Mat3 projector = Mat3::Identity() - ray.direction * ray.direction.transpose();
    matrix += projector;
    right_side += projector * ray.origin;
    mean += ray.origin;
  }
  const double count = static_cast<double>(pairs.size());
  const double weak = 1e-3 * count;
  matrix.diagonal().array() += weak;
  return matrix.inverse() * (right_side + weak * mean / count);
}

EpipolarRefineOptions MakeRefineOptions(const TwoViewOptions& options, double sigma_px) {
  EpipolarRefineOptions refine;
  refine.weighting = options.weighting;
  refine.loss = options.loss;
  refine.loss.scale *= sigma_px;
  refine.sigma_px = sigma_px;
  refine.max_iterations = options.max_refine_iterations;
  refine.min_baseline_m = options.min_baseline_m;
  refine.max_baseline_m = options.max_baseline_m;
  refine.priors.length_m = options.baseline_m;
  refine.priors.sigma_m = options.sigma_baseline_m;
  refine.priors.weak_log_sigma = options.range_log_sigma;
  return refine;
}

void AnchorScale(const StandIn& stand_in, std::span<const int> active,
                 const TwoViewOptions& options, EpipolarRefineOptions* refine, RelativePose* pose) {
  constexpr std::size_t kMaxUsed = 64;
  StaticVector<double, 2 * kMaxUsed> ratios;
  const Vec3 translation =
      pose->direction / pose->inverse_baseline - stand_in.Offset(pose->rotation);
  const double length = translation.norm();
  if (!(length > 0.0)) return;
  int in_front = 0, behind = 0;
  const std::size_t stride = 1 + active.size() / kMaxUsed;
  for (std::size_t i = 0; i < active.size(); i += stride) {
    const double ratio =
        DepthRatio(pose->rotation, translation / length, stand_in.pairs[active[i]]);
    in_front += ratio > 0.0;
    behind += ratio < 0.0;
    if (ratio != 0.0) ratios.TryPushBack(std::abs(ratio));
  }
  if (ratios.empty()) return;
  const auto middle = ratios.begin() + ratios.size() / 2;
  std::nth_element(ratios.begin(), middle, ratios.end());
  const double default_length = options.nominal_range_m / *middle;
  if (behind > in_front) {
    *pose = stand_in.ToPose(pose->rotation, -default_length * translation / length, options);
  }
  refine->min_baseline_m = std::clamp(options.min_range_m / *middle, options.min_baseline_m,
                                      0.5 * options.max_baseline_m);
  refine->priors.weak_length_m = default_length;
  pose->inverse_baseline = std::min(pose->inverse_baseline, 1.0 / refine->min_baseline_m);
}

int TryNominalLength(const StandIn& stand_in, std::span<const int> active,
                     const TwoViewOptions& options, const EpipolarRefineOptions& refine,
                     RelativePose* pose) {
  constexpr double kFar = 3.0;  // about one sigma of the weak prior
  const double ratio = pose->inverse_baseline * refine.priors.weak_length_m;
  if (ratio < kFar && ratio > 1.0 / kFar) return 0;
  const Vec3 translation =
      pose->direction / pose->inverse_baseline - stand_in.Offset(pose->rotation);
  const double length = translation.norm();
  if (!(length > 0.0)) return 0;
  RelativePose other =
      stand_in.ToPose(pose->rotation, refine.priors.weak_length_m / length * translation, options);
  const int iterations = RefineEpipolar(stand_in.pairs, active, refine, &other);
  if (LineariseEpipolar(stand_in.pairs, active, other, refine).cost <
      LineariseEpipolar(stand_in.pairs, active, *pose, refine).cost) {
    *pose = other;
  }
  return iterations;
}

void TwoViewProblem::Solve(std::span<const int, kSampleSize> sample, Models* models) const {
  std::array<Vec3, kSampleSize> a, b;
  for (int i = 0; i < kSampleSize; ++i) {
    a[i] = pairs_[sample[i]].bearing_a;
    b[i] = pairs_[sample[i]].bearing_b;
  }
  for (const Mat3& essential : SolveFivePoint(a, b)) {
    for (const Rigid3& pose : DecomposeEssential(essential)) {
      const Mat3 rotation = pose.rotation.toRotationMatrix();
      std::array<double, kSampleSize> ratios;
      bool is_in_front = true;
      for (int i = 0; i < kSampleSize && is_in_front; ++i) {
        ratios[i] = DepthRatio(rotation, pose.translation, pairs_[sample[i]]);
        is_in_front = ratios[i] > 0.0;
      }
      if (!is_in_front) continue;
      std::nth_element(ratios.begin(), ratios.begin() + kSampleSize / 2, ratios.end());
      const double length = Length(rotation, pose.translation, ratios[kSampleSize / 2]);
      models->TryPushBack(stand_in_.ToPose(rotation, length * pose.translation, options_));
    }
  }
}

bool TwoViewProblem::Refine(std::span<const int> inliers, Model* model) const {
  constexpr std::size_t kMaxUsed = 256;
  StaticVector<int, 2 * kMaxUsed> used;
  const std::size_t stride = 1 + inliers.size() / kMaxUsed;
  for (std::size_t i = 0; i < inliers.size(); i += stride) used.TryPushBack(inliers[i]);
  const std::span<const int> active(used.data(), used.size());
  EpipolarRefineOptions refine = refine_;
  AnchorScale(stand_in_, active, options_, &refine, model);
  RefineEpipolar(pairs_, active, refine, model);
  return true;
}

double TwoViewProblem::Length(const Mat3& rotation, const Vec3& direction,
                              double depth_ratio) const {
  if (options_.sigma_baseline_m > 0.0) return options_.baseline_m;
  constexpr std::size_t kMaxUsed = 64;
  std::array<double, 2 * kMaxUsed> constant, slope;
  std::size_t count = 0;
  const Vec3 offset = stand_in_.Offset(rotation);
  const RelativePose far{rotation, direction, 0.0};
  const std::size_t stride = 1 + pairs_.size() / kMaxUsed;
  for (std::size_t i = 0; i < pairs_.size(); i += stride) {
    const RayPair& pair = pairs_[i];
    const Vec3 normal = (rotation * pair.a.ray.direction).cross(pair.b.ray.direction);
    const double e = direction.dot(normal);
    const double pixels = e != 0.0 ? std::sqrt(SquaredSampsonError(far, pair)) / std::abs(e) : 0.0;
    constant[count] = pixels * e;
    slope[count++] = pixels * normal.dot(offset + rotation * pair.a.ray.origin - pair.b.ray.origin);
  }
  const double max_squared_error = options_.ransac.max_error_px * options_.ransac.max_error_px;
  const auto score = [&](double inverse_length) {
    double sum = 0.0;
    for (std::size_t i = 0; i < count; ++i) {
      const double error = constant[i] + inverse_length * slope[i];
      sum += error * error < max_squared_error ? error * error : max_squared_error;
    }
    return sum;
  };
  // The default stays unless another length is clearly better, as it is where the rays do not
  // meet in a centre.
  double length = options_.nominal_range_m / depth_ratio;
  double best = (1.0 - 1e-3) * score(1.0 / length);
  for (const double range : {100.0, 30.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.25}) {
    const double candidate = score(depth_ratio / range);
    if (range < options_.min_range_m + stand_in_.port_depth_m || !(candidate < best)) continue;
    best = candidate;
    length = range / depth_ratio;
  }
  return length;
}

}  // namespace rsfm::internal
