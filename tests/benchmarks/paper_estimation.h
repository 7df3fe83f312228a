// The baseline of estimation_bench: the paper's estimators written plainly.   [She 2024,
// arXiv:2403.08640, "Absolute Pose Estimation", "Relative Pose Estimation"]
//   Absolute: virtual cameras, GP3P in RANSAC with inlier counting on the virtual image, at least
//   100 trials, then Levenberg-Marquardt of the virtual-image error with numeric derivatives.
//   Relative: the best-fit perspective camera with distortion, five-point in RANSAC with inlier
//   counting on the Sampson distance, at least 100 trials, then Levenberg-Marquardt of the virtual
//   epipolar cost in six degrees of freedom with numeric derivatives.
#pragma once

#include <Eigen/Cholesky>
#include <functional>
#include <vector>

#include "rsfm/base/rng.h"
#include "rsfm/estimation/five_point.h"
#include "rsfm/estimation/gp3p.h"
#include "rsfm/refraction/virtual_camera.h"
#include "tools/evaluation/distorted_best_fit.h"

namespace rsfm::paper {

inline constexpr int kMinTrials = 100;
inline constexpr int kMaxTrials = 10000;
inline constexpr double kConfidence = 0.99999;

// Residuals of a pose; Levenberg-Marquardt with forward differences, at most 10 steps.
using Residuals = std::function<std::vector<double>(const Rigid3&)>;
inline Rigid3 MinimiseNumerically(Rigid3 pose, const Residuals& residuals) {
  const auto vector_of = [](const std::vector<double>& values) {
    return Eigen::Map<const Eigen::VectorXd>(values.data(),
                                             static_cast<Eigen::Index>(values.size()));
  };
  double damping = 1e-4;
  for (int step = 0; step < 10; ++step) {
    const std::vector<double> error = residuals(pose);
    Eigen::MatrixXd jacobian(error.size(), 6);
    for (int k = 0; k < 6; ++k) {
      const std::vector<double> moved = residuals(Perturb(pose, 1e-6 * Vec6::Unit(k)));
      for (std::size_t i = 0; i < error.size(); ++i) jacobian(i, k) = (moved[i] - error[i]) / 1e-6;
    }
    Mat6 information = jacobian.transpose() * jacobian;
    information.diagonal() *= 1.0 + damping;
    const Vec6 change = information.ldlt().solve(-jacobian.transpose() * vector_of(error));
    const Rigid3 candidate = Perturb(pose, change);
    const std::vector<double> after = residuals(candidate);
    if (vector_of(after).squaredNorm() < vector_of(error).squaredNorm()) {
      pose = candidate;
      damping *= 0.1;
      if (change.norm() < 1e-8) break;
    } else {
      damping *= 10.0;
    }
  }
  return pose;
}

// RANSAC by inlier count. `solve` gives the models of a sample of indices, `is_inlier` judges one
// observation.
template <int kSample, class Solve, class IsInlier>
Rigid3 PlainRansac(int size, Solve&& solve, IsInlier&& is_inlier, std::uint64_t seed) {
  Rng rng(seed);
  Rigid3 best;
  int best_count = 0;
  double needed = kMaxTrials;
  for (int trial = 0; trial < kMaxTrials && (trial < kMinTrials || trial < needed); ++trial) {
    std::array<int, kSample> sample;
    for (int i = 0; i < kSample; ++i) {
      bool is_new = false;
      while (!is_new) {
        sample[i] = static_cast<int>(rng.Index(static_cast<std::uint32_t>(size)));
        is_new = std::find(sample.begin(), sample.begin() + i, sample[i]) == sample.begin() + i;
      }
    }
    for (const Rigid3& model : solve(sample)) {
      int count = 0;
      for (int i = 0; i < size; ++i) count += is_inlier(model, i);
      if (count <= best_count) continue;
      best_count = count;
      best = model;
      needed = std::log(1.0 - kConfidence) /
               std::log1p(-std::pow(static_cast<double>(count) / size, kSample));
    }
  }
  return best;
}

inline Rigid3 AbsolutePose(const AnyCamera& camera, const std::vector<Vec2>& pixels,
                           const std::vector<Vec3>& points, double max_error_px,
                           std::uint64_t seed) {
  std::vector<VirtualCamera> cameras(pixels.size());
  std::vector<Ray3> rays(pixels.size());
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    (void)ComputeVirtualCamera(camera, pixels[i], &cameras[i]);
    (void)camera.Backproject(pixels[i], &rays[i]);
  }
  const auto solve = [&](const std::array<int, 3>& sample) {
    return SolveGp3p(std::array<Ray3, 3>{rays[sample[0]], rays[sample[1]], rays[sample[2]]},
                     std::array<Vec3, 3>{points[sample[0]], points[sample[1]], points[sample[2]]});
  };
  const auto is_inlier = [&](const Rigid3& pose, int i) {
    const Vec3 point = pose * points[i];
    return point.z() > cameras[i].center_in_camera.z() &&
           (cameras[i].Project(point) - pixels[i]).squaredNorm() < max_error_px * max_error_px;
  };
  const Rigid3 pose = PlainRansac<3>(static_cast<int>(pixels.size()), solve, is_inlier, seed);
  std::vector<int> inliers;
  for (int i = 0; i < static_cast<int>(pixels.size()); ++i) {
    if (is_inlier(pose, i)) inliers.push_back(i);
  }
  return MinimiseNumerically(pose, [&](const Rigid3& candidate) {
    std::vector<double> residuals;
    for (const int i : inliers) {
      const Vec2 error = cameras[i].Project(candidate * points[i]) - pixels[i];
      residuals.push_back(error.x());
      residuals.push_back(error.y());
    }
    return residuals;
  });
}

inline Rigid3 RelativePose(const AnyCamera& camera, const std::vector<Vec2>& pixels_a,
                           const std::vector<Vec2>& pixels_b, double max_error_px,
                           std::uint64_t seed) {
  const std::optional<AnyCamera> best_fit = FitWithDistortion(camera);
  if (!best_fit) return {};
  const auto bearing = [&best_fit](const Vec2& pixel) {
    Ray3 ray;
    (void)best_fit->Backproject(pixel, &ray);
    return Vec3(ray.direction / ray.direction.z());
  };
  const std::size_t size = pixels_a.size();
  std::vector<Vec3> bearings_a(size), bearings_b(size);
  std::vector<Ray3> rays_a(size), rays_b(size);
  std::vector<VirtualCamera> cameras_a(size), cameras_b(size);
  for (std::size_t i = 0; i < size; ++i) {
    bearings_a[i] = bearing(pixels_a[i]);
    bearings_b[i] = bearing(pixels_b[i]);
    (void)camera.Backproject(pixels_a[i], &rays_a[i]);
    (void)camera.Backproject(pixels_b[i], &rays_b[i]);
    (void)ComputeVirtualCamera(camera, pixels_a[i], &cameras_a[i]);
    (void)ComputeVirtualCamera(camera, pixels_b[i], &cameras_b[i]);
  }
  const auto solve = [&](const std::array<int, 5>& sample) {
    std::array<Vec3, 5> a, b;
    for (int i = 0; i < 5; ++i) {
      a[i] = bearings_a[sample[i]];
      b[i] = bearings_b[sample[i]];
    }
    std::vector<Rigid3> poses;
    for (const Mat3& essential : SolveFivePoint(a, b)) {
      for (const Rigid3& pose : DecomposeEssential(essential)) {
        bool is_in_front = true;
        for (int i = 0; i < 5; ++i) is_in_front &= IsInFront(pose, a[i], b[i]);
        if (is_in_front) poses.push_back(pose);
      }
    }
    return poses;
  };
  const double max_error = max_error_px / best_fit->config().lens_params[0];
  const auto is_inlier = [&](const Rigid3& pose, int i) {
    const Mat3 essential = Hat(pose.translation) * pose.rotation.toRotationMatrix();
    const Vec3 line_b = essential * bearings_a[i], line_a = essential.transpose() * bearings_b[i];
    const double e = bearings_b[i].dot(line_b);
    return e * e < max_error * max_error *
                       (line_a.head<2>().squaredNorm() + line_b.head<2>().squaredNorm());
  };
  const Rigid3 pose = PlainRansac<5>(static_cast<int>(size), solve, is_inlier, seed);
  std::vector<int> inliers;
  for (int i = 0; i < static_cast<int>(size); ++i) {
    if (is_inlier(pose, i)) inliers.push_back(i);
  }
  return MinimiseNumerically(pose, [&](const Rigid3& candidate) {
    std::vector<double> residuals;
    for (const int i : inliers) {
      const Rigid3 a_from_virtual(Quat::Identity(), cameras_a[i].center_in_camera);
      const Rigid3 virtual_from_b(Quat::Identity(), -cameras_b[i].center_in_camera);
      const Rigid3 between = virtual_from_b * candidate * a_from_virtual;
      const Mat3 essential = Hat(between.translation) * between.rotation.toRotationMatrix();
      const Vec3 a = rays_a[i].direction / rays_a[i].direction.z(),
                 b = rays_b[i].direction / rays_b[i].direction.z();
      // Over the baseline, or the cost would vanish with it.
      residuals.push_back(b.dot(essential * a) / candidate.translation.norm());
    }
    return residuals;
  });
}

}  // namespace rsfm::paper
