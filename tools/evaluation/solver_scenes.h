// Random rigs and two-dimensional to three-dimensional scenes for the evaluation of the solvers:
// the bounds of the evaluation programs of [She 2024, arXiv:2403.08640, sec. IV-A].
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "rsfm/base/rigid3.h"
#include "rsfm/base/rng.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

enum class SolverPort { kFlat, kDome, kCentredDome };
std::string_view ToString(SolverPort port);  // "flat", "dome", "dome_centered"

// 1920 x 1080, f = 1297.37 px (73 degrees). Flat: normal (U(-0.2, 0.2), U(-0.2, 0.2), U(0.8, 1.2)),
// distance U(1, 50) mm, glass U(2, 200) mm. Dome: centre (U(-10, 10), U(-10, 10), U(-30, 30)) mm or
// exactly the camera's, radius U(50, 70) mm, glass U(5, 20) mm. Indices 1, 1.52, 1.334.
AnyCamera RandomSolverCamera(SolverPort port, Rng* rng);
// The same lens in air.
AnyCamera SolverCameraInAir();

// Every scene also stands there as an un-refracted camera at the same place would see it, with the
// same noise and outliers.
struct AbsolutePoseScene {
  Rigid3 camera_from_world;
  std::vector<Vec2> pixels, pixels_in_air;
  std::vector<Vec3> points_in_world;
  std::vector<std::uint8_t> is_outlier;
  double median_range_m = 0.0;
};

// `count` pixels uniform in the image, points 0.5 to 10 m along their refracted rays; Gaussian
// noise; of every ten points the first three, rounded down over all, are off by a Gaussian of 200
// px.
AbsolutePoseScene RandomAbsolutePoseScene(const AnyCamera& camera, double noise_px, int count,
                                          double outlier_ratio, Rng* rng);

struct RelativePoseScene {
  Rigid3 b_from_a;
  std::vector<Vec2> pixels_a, pixels_b, in_air_a, in_air_b;
  std::vector<Vec2> exact_a, exact_b;  // refracted, without noise and outliers
  std::vector<std::uint8_t> is_outlier;
};

// Points 6 to 8 m along the rays of uniform pixels, seen again by a camera at (U(8, 10),
// U(-2.5, 2.5), U(-2.5, 2.5)) m that looks at (0, 0, U(6, 8)); those outside the second image are
// drawn again. Outliers in the second image.
RelativePoseScene RandomRelativePoseScene(const AnyCamera& camera, double noise_px, int count,
                                          double outlier_ratio, Rng* rng);

}  // namespace rsfm
