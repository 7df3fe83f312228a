#include "rsfm/estimation/two_view_checks.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

namespace rsfm::internal {
namespace {

inline double PixelsPerRadian(const DifferentiatedRay& ray) {
  return std::sqrt(2.0) / ray.d_direction_d_pixel.norm();
}

// Normal equations of three unknowns with Cauchy's weights.
struct Normal3 {
  Mat3 information = Mat3::Zero();
  Vec3 gradient = Vec3::Zero();

  void Add(const Mat3& jacobian, const Vec3& error, double scale) {
    const double weight = 1.0 / (1.0 + error.squaredNorm() / (scale * scale));
    information.noalias() += weight * jacobian.transpose() * jacobian;
    gradient.noalias() += weight * jacobian.transpose() * error;
  }
  Vec3 Step() const {
    Mat3 damped = information;
    damped.diagonal() *= 1.0 + 1e-9;
    return damped.ldlt().solve(-gradient);
  }
};

// The point where a's ray meets the plane, from b's ray origin, in camera b; false behind either
// camera.
bool TransferThroughPlane(const RelativePose& pose, const RayPair& pair, const Vec3& plane,
                          Vec3* point_in_a, Vec3* from_origin_b) {
  const double approach = plane.dot(pair.a.ray.direction);
  const double range = (1.0 - plane.dot(pair.a.ray.origin)) / approach;
  if (!(range > 0.0) || !std::isfinite(range)) return false;
  *point_in_a = pair.a.ray.At(range);
  *from_origin_b =
      pose.rotation * *point_in_a + pose.direction / pose.inverse_baseline - pair.b.ray.origin;
  return pair.b.ray.direction.dot(*from_origin_b) > 0.0;
}

}  // namespace

double ThinnestSpreadPx(std::span<const RayPair> pairs, std::span<const int> active) noexcept {
  if (active.empty()) return 0.0;
  Mat3 moment_a = Mat3::Zero(), moment_b = Mat3::Zero();
  for (const int i : active) {
    moment_a += pairs[i].bearing_a * pairs[i].bearing_a.transpose();
    moment_b += pairs[i].bearing_b * pairs[i].bearing_b.transpose();
  }
  // Points on a line have coplanar bearings. The smallest singular value, from the eigenvalues of
  // the moments.
  const double count = static_cast<double>(active.size());
  const auto spread = [count](const Mat3& moment) {
    return std::sqrt(
        std::max(0.0, Eigen::SelfAdjointEigenSolver<Mat3>(moment / count).eigenvalues()[0]));
  };
  const RayPair& any = pairs[active[0]];
  return std::min(spread(moment_a) * PixelsPerRadian(any.a),
                  spread(moment_b) * PixelsPerRadian(any.b));
}

double RotationOnlyRatio(std::span<const RayPair> pairs, std::span<const int> active,
                         const Mat3& start, double max_error_px) noexcept {
  if (active.empty()) return 0.0;
  Mat3 rotation = start;
  for (int step = 0; step < 20; ++step) {
    Normal3 normal;
    for (const int i : active) {
      const double pixels = PixelsPerRadian(pairs[i].b);
      const Vec3 rotated = rotation * pairs[i].bearing_a;
      normal.Add(-pixels * Hat(rotated), pixels * (rotated - pairs[i].bearing_b), max_error_px);
    }
    const Vec3 change = normal.Step();
    if (!change.allFinite()) break;
    rotation = ExpSo3(change).toRotationMatrix() * rotation;
    if (change.norm() < 1e-9) break;
  }
  int fitting = 0;
  for (const int i : active) {
    const double error =
        PixelsPerRadian(pairs[i].b) * (rotation * pairs[i].bearing_a - pairs[i].bearing_b).norm();
    fitting += error < max_error_px;
  }
  return static_cast<double>(fitting) / static_cast<double>(active.size());
}

double PlaneRatio(std::span<const RayPair> pairs, std::span<const int> active,
                  const RelativePose& pose, double max_error_px, Vec3* plane) noexcept {
  // Start: least squares of n . X - 1, relative to the distance.
  Normal3 start;
  int meeting = 0;
  for (const int i : active) {
    double range_a = 0.0, range_b = 0.0, angle = 0.0;
    if (!MeetingRanges(pose, pairs[i], &range_a, &range_b, &angle) || !(range_a > 0.0) ||
        !(range_b > 0.0))
      continue;
    const Vec3 point = pairs[i].a.ray.At(range_a);
    const double weight = 1.0 / point.squaredNorm();
    start.information += weight * point * point.transpose();
    start.gradient -= weight * point;
    ++meeting;
  }
  if (meeting < 4) return 0.0;
  Vec3 n = start.Step();
  for (int step = 0; step < 20 && n.allFinite(); ++step) {
    Normal3 normal;
    for (const int i : active) {
      const RayPair& pair = pairs[i];
      Vec3 point_in_a, q;
      if (!TransferThroughPlane(pose, pair, n, &point_in_a, &q)) continue;
      const Vec3& d = pair.b.ray.direction;
      const double inverse_depth = 1.0 / d.dot(q);
      const double pixels = PixelsPerRadian(pair.b);
      const Vec3 error = pixels * (inverse_depth * q - d);
      const Vec3 d_point = pose.rotation * pair.a.ray.direction;
      const Vec3 d_error_d_range =
          pixels * inverse_depth * (d_point - inverse_depth * d.dot(d_point) * q);
      const Vec3 d_range_d_plane = -point_in_a / n.dot(pair.a.ray.direction);
      normal.Add(d_error_d_range * d_range_d_plane.transpose(), error, max_error_px);
    }
    const Vec3 change = normal.Step();
    if (!change.allFinite()) break;
    n += change;
    if (change.norm() < 1e-9 * n.norm()) break;
  }
  if (!n.allFinite()) return 0.0;
  int fitting = 0;
  for (const int i : active) {
    Vec3 point_in_a, q;
    if (!TransferThroughPlane(pose, pairs[i], n, &point_in_a, &q)) continue;
    const double error = PixelsPerRadian(pairs[i].b) *
                         (q / pairs[i].b.ray.direction.dot(q) - pairs[i].b.ray.direction).norm();
    fitting += error < max_error_px;
  }
  *plane = n;
  return static_cast<double>(fitting) / static_cast<double>(active.size());
}

StaticVector<RelativePose, 3> OtherPosesOfPlane(const RelativePose& pose,
                                                const Vec3& plane) noexcept {
  StaticVector<RelativePose, 3> others;
  Mat3 homography = pose.rotation + pose.direction * plane.transpose() / pose.inverse_baseline;
  if (!homography.allFinite()) return others;
  Eigen::SelfAdjointEigenSolver<Mat3> solver(homography.transpose() * homography);
  if (!(solver.eigenvalues()[1] > 0.0)) return others;
  homography /= std::sqrt(solver.eigenvalues()[1]);
  const double low = solver.eigenvalues()[0] / solver.eigenvalues()[1];
  const double high = solver.eigenvalues()[2] / solver.eigenvalues()[1];
  const double difference = high - low;
  if (!(difference > 1e-9)) return others;  // a rotation: no plane to speak of
  const Vec3 v_low = solver.eigenvectors().col(0), v_middle = solver.eigenvectors().col(1),
             v_high = solver.eigenvectors().col(2);
  const double c_high = std::sqrt(std::max(0.0, 1.0 - low)),
               c_low = std::sqrt(std::max(0.0, high - 1.0));
  // Both vectors keep their length under H: with v_middle each spans a plane that H only rotates.
  const std::array<Vec3, 2> kept = {
      Vec3((c_high * v_high + c_low * v_low) / std::sqrt(difference)),
      Vec3((c_high * v_high - c_low * v_low) / std::sqrt(difference))};
  StaticVector<RelativePose, 4> all;
  for (const Vec3& u : kept) {
    Mat3 from, to;
    from << v_middle, u, v_middle.cross(u);
    const Vec3 moved_middle = homography * v_middle, moved_u = homography * u;
    to << moved_middle, moved_u, moved_middle.cross(moved_u);
    const Mat3 rotation = to * from.transpose();
    const Vec3 translation = (homography - rotation) * from.col(2);
    const double length = translation.norm();
    if (!(length > 1e-9) || !rotation.allFinite()) continue;
    for (const double sign : {1.0, -1.0}) {
      all.TryPushBack({Quat(rotation).normalized().toRotationMatrix(), sign * translation / length,
                       pose.inverse_baseline});
    }
  }
  // The given pose is one of them: the nearest.
  const auto distance = [&pose](const RelativePose& other) {
    return (other.rotation - pose.rotation).squaredNorm() +
           (other.direction - pose.direction).squaredNorm();
  };
  std::size_t nearest = 0;
  for (std::size_t i = 1; i < all.size(); ++i) {
    if (distance(all[i]) < distance(all[nearest])) nearest = i;
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (i != nearest) others.TryPushBack(all[i]);
  }
  return others;
}

}  // namespace rsfm::internal
