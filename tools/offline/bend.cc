#include "tools/offline/bend.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace rsfm {
namespace {

double MedianOf(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

std::vector<Vec3> WithoutFarOff(std::span<const Vec3> places, const Vec3& up) {
  constexpr double kFarOff = 10.0;
  if (places.empty()) return {};
  std::vector<double> along[3];
  for (const Vec3& p : places)
    for (int axis = 0; axis < 3; ++axis) along[axis].push_back(p[axis]);
  const Vec3 middle(MedianOf(along[0]), MedianOf(along[1]), MedianOf(along[2]));
  const Vec3 vertical = up.normalized();
  std::vector<double> heights, distances;
  for (const Vec3& p : places) {
    const double height = vertical.dot(p - middle);
    heights.push_back(std::abs(height));
    distances.push_back((p - middle - height * vertical).norm());
  }
  const double max_height = kFarOff * MedianOf(heights);
  const double max_distance = kFarOff * MedianOf(distances);
  std::vector<Vec3> near;
  for (std::size_t i = 0; i < places.size(); ++i)
    if (heights[i] <= max_height && distances[i] <= max_distance) near.push_back(places[i]);
  return near;
}

Expected<Bend> FitBend(std::span<const Vec3> places, const Vec3& up) {
  constexpr std::size_t kMinPlaces = 6;
  constexpr double kLineRatio = 1.0 / 6.0, kMinExtentRatio = 0.01;
  if (places.size() < kMinPlaces) return Fail(Errc::kNotEnoughData, "places");
  if (!(up.norm() > 0.0)) return Fail(Errc::kDegenerate, "up");
  const auto n = static_cast<double>(places.size());
  const Vec3 vertical = up.normalized();
  Vec3 mean = Vec3::Zero();
  for (const Vec3& p : places) mean += p / n;
  Mat3 spread = Mat3::Zero();  // across the vertical
  double heights = 0.0;
  for (const Vec3& p : places) {
    const double height = vertical.dot(p - mean);
    const Vec3 across = p - mean - height * vertical;
    spread += across * across.transpose() / n;
    heights += height * height / n;
  }
  const Eigen::SelfAdjointEigenSolver<Mat3> eigen(spread);
  const Vec3 extent = eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt();  // the vertical's is the least
  const double unit = extent[2];  // keeps the system well scaled
  if (!(unit > kMinExtentRatio * std::sqrt(heights))) return Fail(Errc::kDegenerate, "places");
  Bend bend;
  bend.along_line = extent[1] < kLineRatio * extent[2];
  const int columns = bend.along_line ? 3 : 4;
  Eigen::MatrixXd a(places.size(), columns);
  Eigen::VectorXd h(places.size());
  std::vector<double> radii;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const Vec3 p = (places[i] - mean) / unit;
    const double x = eigen.eigenvectors().col(2).dot(p);
    const double y = bend.along_line ? 0.0 : eigen.eigenvectors().col(1).dot(p);
    const double squared = x * x + y * y;
    a(i, 0) = 1.0;
    a(i, 1) = x;
    if (!bend.along_line) a(i, 2) = y;
    a(i, columns - 1) = -0.5 * squared;
    h[i] = vertical.dot(p);
    radii.push_back(std::sqrt(squared));
  }
  const auto edge = radii.begin() + static_cast<std::ptrdiff_t>(0.95 * (n - 1.0));
  std::nth_element(radii.begin(), edge, radii.end());
  const Eigen::LLT<Eigen::MatrixXd> normal(a.transpose() * a);
  if (normal.info() != Eigen::Success) return Fail(Errc::kDegenerate, "places");
  const Eigen::VectorXd row =
      a * normal.solve(Eigen::VectorXd::Unit(columns, columns - 1));  // of the curvature
  if (!row.allFinite()) return Fail(Errc::kDegenerate, "places");
  const double to_sagitta = 0.5 * *edge * *edge;
  bend.sagitta_m = unit * to_sagitta * row.dot(h);
  bend.radius_m = unit * *edge;
  for (std::size_t i = 0; i < places.size(); ++i)
    bend.weights.push_back(to_sagitta * row[i] * vertical);
  return bend;
}

}  // namespace rsfm
