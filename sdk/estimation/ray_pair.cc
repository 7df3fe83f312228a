#include "rsfm/estimation/ray_pair.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

namespace rsfm {
namespace {

// The constraint at a pose with the products that its derivatives share.
struct Constraint {
  Vec3 v;  // R d_a
  Vec3 w;  // R o_a
  Vec3 m;  // u + s (w - o_b)
  Vec3 n;  // v x d_b
  double e;

  Constraint(const RelativePose& pose, const RayPair& pair)
      : v(pose.rotation * pair.a.ray.direction),
        w(pose.rotation * pair.a.ray.origin),
        m(pose.direction + pose.inverse_baseline * (w - pair.b.ray.origin)),
        n(v.cross(pair.b.ray.direction)),
        e(m.dot(n)) {}
};

// Squared length of d e / d(pixel_a, pixel_b).
inline double SquaredPixelGradient(const RelativePose& pose, const RayPair& pair,
                                   const Constraint& c) {
  const Vec3 d_direction_a = pose.rotation.transpose() * pair.b.ray.direction.cross(c.m);
  const Vec3 d_direction_b = c.m.cross(c.v);
  const Vec3 d_origin_b = -pose.inverse_baseline * c.n;
  const Vec3 d_origin_a = -(pose.rotation.transpose() * d_origin_b);
  const Vec2 in_a = pair.a.d_direction_d_pixel.transpose() * d_direction_a +
                    pair.a.d_origin_d_pixel.transpose() * d_origin_a;
  const Vec2 in_b = pair.b.d_direction_d_pixel.transpose() * d_direction_b +
                    pair.b.d_origin_d_pixel.transpose() * d_origin_b;
  return in_a.squaredNorm() + in_b.squaredNorm();
}

// What e is multiplied with to be in pixels.
inline double Weight(const RelativePose& pose, const RayPair& pair, const Constraint& c,
                     EpipolarWeighting weighting) {
  if (weighting == EpipolarWeighting::kSampson)
    return 1.0 / std::sqrt(SquaredPixelGradient(pose, pair, c));
  // e of (x, y, 1) coordinates; one such unit is about 1 / |d direction / d pixel| pixels at the
  // image centre.
  const double pixels = std::sqrt(2.0) / pair.a.d_direction_d_pixel.norm();
  return pixels / std::abs(pair.a.ray.direction.z() * pair.b.ray.direction.z());
}

double Cost(std::span<const RayPair> pairs, std::span<const int> active, const RelativePose& pose,
            const EpipolarRefineOptions& options) {
  double cost = AddBaselinePriors(pose, options, nullptr);
  for (const int i : active) {
    const Constraint c(pose, pairs[i]);
    const double error = c.e * Weight(pose, pairs[i], c, options.weighting);
    cost += options.loss.Rho(error * error);
  }
  return cost;
}

}  // namespace

bool BackprojectDifferentiated(const AnyCamera& camera, const Vec2& pixel,
                               DifferentiatedRay* result) noexcept {
  DifferentiatedRay ray;
  if (!pixel.allFinite() || camera.Backproject(pixel, &ray.ray) != Projection::kOk) return false;
  for (int k = 0; k < 2; ++k) {
    double step = 0.01;
    Ray3 other;
    if (camera.Backproject(pixel + step * Vec2::Unit(k), &other) != Projection::kOk) {
      step = -step;
      if (camera.Backproject(pixel + step * Vec2::Unit(k), &other) != Projection::kOk) return false;
    }
    ray.d_origin_d_pixel.col(k) = (other.origin - ray.ray.origin) / step;
    ray.d_direction_d_pixel.col(k) = (other.direction - ray.ray.direction) / step;
  }
  *result = ray;
  return true;
}

Eigen::Matrix<double, 3, 2> TangentBasis(const Vec3& direction) noexcept {
  Eigen::Index smallest = 0;
  direction.cwiseAbs().minCoeff(&smallest);
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = direction.cross(Vec3::Unit(smallest)).normalized();
  basis.col(1) = direction.cross(basis.col(0));
  return basis;
}

double SquaredSampsonError(const RelativePose& pose, const RayPair& pair) noexcept {
  const Constraint c(pose, pair);
  return c.e * c.e / SquaredPixelGradient(pose, pair, c);
}

RelativePose Perturb(const RelativePose& pose, const Vec6& step,
                     const EpipolarRefineOptions& options) noexcept {
  RelativePose result;
  result.rotation = Quat(ExpSo3(step.head<3>()).toRotationMatrix() * pose.rotation)
                        .normalized()
                        .toRotationMatrix();
  result.direction =
      (pose.direction + TangentBasis(pose.direction) * step.segment<2>(3)).normalized();
  result.inverse_baseline = std::clamp(pose.inverse_baseline + step[5],
                                       1.0 / options.max_baseline_m, 1.0 / options.min_baseline_m);
  return result;
}

double AddBaselinePriors(const RelativePose& pose, const EpipolarRefineOptions& options,
                         EpipolarNormal* normal) noexcept {
  const BaselinePriors& priors = options.priors;
  const double s = pose.inverse_baseline;
  const double variance = options.sigma_px * options.sigma_px;
  double cost = 0.0;
  if (priors.sigma_m > 0.0) {
    const double residual = (1.0 / s - priors.length_m) / priors.sigma_m;
    const double slope = -1.0 / (s * s * priors.sigma_m);
    cost += variance * residual * residual;
    if (normal != nullptr) {
      normal->information(5, 5) += variance * slope * slope;
      normal->gradient[5] += variance * slope * residual;
    }
  }
  const double residual = std::log(s * priors.weak_length_m) / priors.weak_log_sigma;
  const double slope = 1.0 / (s * priors.weak_log_sigma);
  cost += variance * residual * residual;
  if (normal != nullptr) {
    normal->weak_information(5, 5) += variance * slope * slope;
    normal->gradient[5] += variance * slope * residual;
  }
  return cost;
}

void AddEpipolar(const RelativePose& pose, const Eigen::Matrix<double, 3, 2>& tangent_basis,
                 const RayPair& pair, const EpipolarRefineOptions& options,
                 EpipolarNormal* normal) noexcept {
  const Constraint c(pose, pair);
  const double weight = Weight(pose, pair, c, options.weighting);
  Vec6 jacobian;
  jacobian.head<3>() =
      pose.inverse_baseline * c.w.cross(c.n) + c.v.cross(pair.b.ray.direction.cross(c.m));
  jacobian.segment<2>(3) = tangent_basis.transpose() * c.n;
  jacobian[5] = (c.w - pair.b.ray.origin).dot(c.n);
  jacobian *= weight;
  const double error = weight * c.e;
  if (!std::isfinite(error)) return;
  const double squared_error = error * error;
  const double robust_weight = options.loss.Weight(squared_error);
  normal->cost += options.loss.Rho(squared_error);
  normal->information.noalias() += robust_weight * jacobian * jacobian.transpose();
  normal->gradient.noalias() += robust_weight * error * jacobian;
}

double ParallaxNoise(const RayPair& pair, double sigma_px) noexcept {
  return 4.0 * sigma_px * (pair.a.d_direction_d_pixel.norm() + pair.b.d_direction_d_pixel.norm()) /
         2.0;
}

EpipolarNormal LineariseEpipolar(std::span<const RayPair> pairs, std::span<const int> active,
                                 const RelativePose& pose,
                                 const EpipolarRefineOptions& options) noexcept {
  EpipolarNormal normal;
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(pose.direction);
  for (const int i : active) AddEpipolar(pose, basis, pairs[i], options, &normal);
  normal.cost += AddBaselinePriors(pose, options, &normal);
  return normal;
}

std::optional<Vec6> DampedStep(const EpipolarNormal& normal, double damping) noexcept {
  Mat6 damped = normal.information + normal.weak_information;
  damped.diagonal() *= 1.0 + damping;
  damped.diagonal().array() += 1e-14 * damped.diagonal().maxCoeff();
  const Eigen::LLT<Mat6> factor(damped);
  if (factor.info() != Eigen::Success) return std::nullopt;
  return factor.solve(-normal.gradient);
}

int RefineEpipolar(std::span<const RayPair> pairs, std::span<const int> active,
                   const EpipolarRefineOptions& options, RelativePose* pose) noexcept {
  EpipolarNormal normal = LineariseEpipolar(pairs, active, *pose, options);
  double damping = 1e-4;
  int iteration = 0;
  while (iteration < options.max_iterations) {
    ++iteration;
    const std::optional<Vec6> solved = DampedStep(normal, damping);
    if (!solved) {
      damping *= 10.0;
      continue;
    }
    const Vec6& step = *solved;
    if (!step.allFinite()) return iteration;
    if (-step.dot(normal.gradient) < 1e-10 * normal.cost) break;
    const RelativePose candidate = Perturb(*pose, step, options);
    if (Cost(pairs, active, candidate, options) < normal.cost) {
      *pose = candidate;
      normal = LineariseEpipolar(pairs, active, *pose, options);
      damping = std::max(1e-9, damping * 0.1);
    } else {
      damping = std::max(1e-4, damping * 10.0);
    }
  }
  return iteration;
}

bool MeetingRanges(const RelativePose& pose, const RayPair& pair, double* range_a, double* range_b,
                   double* angle_rad) noexcept {
  const Vec3 d_a = pose.rotation * pair.a.ray.direction;
  const Vec3& d_b = pair.b.ray.direction;
  const Vec3 between = pose.rotation * pair.a.ray.origin + pose.direction / pose.inverse_baseline -
                       pair.b.ray.origin;
  const Vec3 normal = d_a.cross(d_b);
  const double squared_sine = normal.squaredNorm();
  if (!(squared_sine > 1e-24)) return false;
  // between + r_a d_a - r_b d_b is parallel to the normal.
  *range_a = d_b.cross(between).dot(normal) / squared_sine;
  *range_b = d_a.cross(between).dot(normal) / squared_sine;
  *angle_rad = std::atan2(std::sqrt(squared_sine), d_a.dot(d_b));
  return true;
}

}  // namespace rsfm
