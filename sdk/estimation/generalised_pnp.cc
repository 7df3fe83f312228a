#include "rsfm/estimation/generalised_pnp.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <array>
#include <cmath>
#include <limits>

namespace rsfm {
namespace {

using Vec9 = Eigen::Matrix<double, 9, 1>;
using Mat9 = Eigen::Matrix<double, 9, 9>;
using Mat39 = Eigen::Matrix<double, 3, 9>;
using Mat93 = Eigen::Matrix<double, 9, 3>;

// The cost as r' omega r + 2 g . r + c for r = R row by row, and t = slope r + offset. The points
// are taken about their mean.
struct Quadratic {
  Mat9 omega = Mat9::Zero();
  Vec9 linear = Vec9::Zero();
  double constant = 0.0;
  Mat39 slope;
  Vec3 offset;

  double At(const Vec9& r) const { return r.dot(omega * r) + 2.0 * linear.dot(r) + constant; }
};

// R X as a product with the entries of R.
Mat39 Spread(const Vec3& point) {
  Mat39 result = Mat39::Zero();
  for (int r = 0; r < 3; ++r) result.block<1, 3>(r, 3 * r) = point.transpose();
  return result;
}

Mat3 Projector(const Ray3& ray) {
  return Mat3::Identity() - ray.direction * ray.direction.transpose();
}

bool MakeQuadratic(std::span<const Ray3> rays, std::span<const Vec3> points, const Vec3& mean,
                   Quadratic* quadratic) {
  Mat3 sum = Mat3::Zero();
  Mat39 of_rotation = Mat39::Zero();
  Vec3 of_origins = Vec3::Zero();
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Mat3 projector = Projector(rays[i]);
    sum += projector;
    of_rotation += projector * Spread(points[i] - mean);
    of_origins += projector * rays[i].origin;
  }
  const double trace = sum.trace();
  if (!(sum.determinant() > 1e-14 * trace * trace * trace)) return false;  // parallel rays
  const Mat3 inverse = sum.inverse();
  quadratic->slope = -inverse * of_rotation;
  quadratic->offset = inverse * of_origins;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Mat3 projector = Projector(rays[i]);
    const Mat39 a = projector * (Spread(points[i] - mean) + quadratic->slope);
    const Vec3 b = projector * (quadratic->offset - rays[i].origin);
    quadratic->omega += a.transpose() * a;
    quadratic->linear += a.transpose() * b;
    quadratic->constant += b.squaredNorm();
  }
  return true;
}

Mat3 ToMatrix(const Vec9& r) {
  Mat3 result;
  result << r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8];
  return result;
}

Vec9 ToVector(const Mat3& rotation) {
  Vec9 result;
  for (int r = 0; r < 3; ++r) result.segment<3>(3 * r) = rotation.row(r).transpose();
  return result;
}

Mat3 NearestRotation(const Mat3& matrix) {
  const Eigen::JacobiSVD<Mat3> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Vec3 signs = Vec3::Ones();
  signs[2] = svd.matrixU().determinant() * svd.matrixV().determinant() < 0.0 ? -1.0 : 1.0;
  return svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
}

// d r / d w for R <- Exp(w) R: column k is Hat(e_k) R.
Mat93 Tangent(const Mat3& rotation) {
  Mat93 result;
  for (int k = 0; k < 3; ++k) result.col(k) = ToVector(Hat(Vec3::Unit(k)) * rotation);
  return result;
}

// Gauss-Newton with damping; leaves the rotation at the lowest cost found, which is returned.
double Minimise(const Quadratic& quadratic, Mat3* rotation, Mat3* information) {
  double cost = quadratic.At(ToVector(*rotation));
  double damping = 1e-6;
  for (int step = 0; step < 15; ++step) {
    const Vec9 r = ToVector(*rotation);
    const Mat93 tangent = Tangent(*rotation);
    *information = tangent.transpose() * quadratic.omega * tangent;
    const Vec3 gradient = tangent.transpose() * (quadratic.omega * r + quadratic.linear);
    Mat3 damped = *information;
    damped.diagonal().array() += damping * information->trace() + 1e-300;
    const Vec3 change = damped.ldlt().solve(-gradient);
    if (!change.allFinite()) break;
    const Mat3 candidate = ExpSo3(change).toRotationMatrix() * *rotation;
    const double next = quadratic.At(ToVector(candidate));
    if (next < cost) {
      *rotation = candidate;
      cost = next;
      damping = std::max(1e-12, 0.1 * damping);
    } else {
      damping *= 10.0;
    }
    if (change.squaredNorm() < 1e-20) break;
  }
  return cost;
}

}  // namespace

Expected<GeneralisedPnpReport> SolveGeneralisedPnp(std::span<const Ray3> rays_in_camera,
                                                   std::span<const Vec3> points_in_world) noexcept {
  const std::size_t size = rays_in_camera.size();
  if (points_in_world.size() != size) return Fail(Errc::kInvalidArgument, "points_in_world");
  if (size < kMinGeneralisedPnpPoints)
    return Fail(Errc::kNotEnoughData, "rays_in_camera", static_cast<int>(size));
  Vec3 mean = Vec3::Zero();
  for (std::size_t i = 0; i < size; ++i) {
    if (!rays_in_camera[i].origin.allFinite() || !rays_in_camera[i].direction.allFinite() ||
        !points_in_world[i].allFinite()) {
      return Fail(Errc::kInvalidArgument, "rays_in_camera", static_cast<int>(i));
    }
    mean += points_in_world[i] / static_cast<double>(size);
  }
  Mat3 spread = Mat3::Zero();
  for (const Vec3& point : points_in_world) spread += (point - mean) * (point - mean).transpose();
  const Vec3 extents = Eigen::SelfAdjointEigenSolver<Mat3>(spread).eigenvalues();
  // A line, or a single point: the second extent is below 1e-6 of the first.
  if (!(extents[1] > 1e-12 * extents[2])) return Fail(Errc::kDegenerate, "points_in_world");
  Quadratic quadratic;
  if (!MakeQuadratic(rays_in_camera, points_in_world, mean, &quadratic))
    return Fail(Errc::kDegenerate, "rays_in_camera");

  const Eigen::SelfAdjointEigenSolver<Mat9> solver(quadratic.omega);
  GeneralisedPnpReport best;
  double best_cost = std::numeric_limits<double>::infinity();
  Mat3 best_information = Mat3::Zero();
  best.num_behind = std::numeric_limits<int>::max();
  for (int k = 0; k < 3; ++k) {
    for (const double sign : {1.0, -1.0}) {
      Mat3 rotation = NearestRotation(sign * ToMatrix(solver.eigenvectors().col(k)));
      Mat3 information = Mat3::Zero();
      const double cost = Minimise(quadratic, &rotation, &information);
      const Vec3 translation =
          quadratic.slope * ToVector(rotation) + quadratic.offset - rotation * mean;
      if (!std::isfinite(cost) || !translation.allFinite()) continue;
      int behind = 0;
      for (std::size_t i = 0; i < size; ++i)
        behind += !(rays_in_camera[i].RangeTo(rotation * points_in_world[i] + translation) > 0.0);
      if (behind > best.num_behind || (behind == best.num_behind && cost >= best_cost)) continue;
      best_cost = cost;
      best_information = information;
      best.num_behind = behind;
      best.camera_from_world = Rigid3(Quat(rotation).normalized(), translation);
    }
  }
  if (!std::isfinite(best_cost)) return Fail(Errc::kDegenerate, "points_in_world");
  const Vec3 certainty = Eigen::SelfAdjointEigenSolver<Mat3>(best_information).eigenvalues();
  if (!(certainty[0] > 1e-12 * certainty[2])) return Fail(Errc::kDegenerate, "points_in_world");
  best.rms_distance_m = std::sqrt(std::max(0.0, best_cost) / static_cast<double>(size));
  return best;
}

}  // namespace rsfm
