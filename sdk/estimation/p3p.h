// Perspective three-point: the pose of a central camera from three world points.
#pragma once

#include <span>

#include "rsfm/base/rigid3.h"
#include "rsfm/base/static_vector.h"

namespace rsfm {

inline constexpr int kP3pSampleSize = 3;
using P3pSolutions = StaticVector<Rigid3, 4>;

// camera_from_world such that  lambda_i bearings[i] = R X_i + t,  lambda_i > 0.  Bearings are unit
// vectors in the camera frame. No solution for collinear or coincident points or when an input is
// not finite.
//   The depths solve  |lambda_i y_i - lambda_j y_j|^2 = |X_i - X_j|^2: two homogeneous conics whose
//   pencil holds a
// degenerate member, a pair of lines, found from one root of a cubic.   [Persson & Nordberg 2018,
// ECCV, "Lambda Twist"; the lines from the conic's adjugate as in Ding 2023, CVPR, "Revisiting the
// P3P Problem"]
P3pSolutions SolveP3p(std::span<const Vec3, kP3pSampleSize> bearings_in_camera,
                      std::span<const Vec3, kP3pSampleSize> points_in_world) noexcept;

namespace internal {

// A triangle of world points and its orthonormal frame: what P3P and GP3P share.
struct Triangle {
  Mat3 world_from_frame;  // x along X2 - X1, z normal to the triangle
  Vec3 squared_sides;     // |X1 - X2|^2, |X1 - X3|^2, |X2 - X3|^2
};

// False for collinear, coincident or not finite points.
bool MakeTriangle(std::span<const Vec3, 3> points, Triangle* triangle) noexcept;

// The orthonormal frame of a triangle that is known to be one.
Mat3 TriangleFrame(const Vec3& point_1, const Vec3& point_2, const Vec3& point_3) noexcept;

struct CentralDepth {
  Vec3 depths;
  bool is_fold;  // the mean of a pair of solutions that nearly coincide
};

// Depths of the three points along unit bearings from one centre with the cosines b12, b13, b23
// between them, not yet polished; single depths may be negative, their sum is not. A pair of
// solutions that is real or complex by less than `fold_tolerance` (discriminant relative to its
// terms) is replaced by its mean, marked as a fold: those of a camera that is not quite central may
// be real or complex there.
StaticVector<CentralDepth, 4> CentralDepths(const Vec3& cosines, const Vec3& squared_sides,
                                            double fold_tolerance) noexcept;

}  // namespace internal
}  // namespace rsfm
