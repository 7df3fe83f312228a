// What it costs to treat a camera behind a port as a pinhole in water.
//
// The pinhole is the one that comes nearest over a band of ranges [She 2024, arXiv:2403.08640,
// "best-fit perspective camera"], behind the lens's own distortion: the images are taken to have
// been undistorted with the lens as it is in air, so that all that is measured here is the port's.
// All sampling is on fixed grids: the same rig gives the same numbers.
#pragma once

#include <array>
#include <vector>

#include "rsfm/base/error.h"
#include "rsfm/refraction/any_camera.h"
#include "rsfm/refraction/best_fit.h"

namespace rsfm {

struct RangeBand {
  double near_m = 1.0;
  double far_m = 8.0;
};

// A camera, its lens alone, and the pinhole that stands for both port and water.
class PinholeInWater {
 public:
  // kInvalidArgument "range": not 0 < near <= far; kDegenerate: fewer than 16 pixels look forward.
  static Expected<PinholeInWater> Fit(const AnyCamera& camera, const RangeBand& band);

  // The pixel of a camera with the same focal lengths and principal point, but neither distortion
  // nor port. False where the lens has no direction, or one more than 60 degrees off its axis:
  // undistorted, such pixels are stretched without bound, and nobody would take them for a
  // pinhole's.
  bool Undistort(const Vec2& pixel, Vec2* undistorted) const;
  // Where the pinhole believes a point to be seen, with the lens's distortion. False where the lens
  // cannot map it.
  bool Project(const Vec3& point_in_camera, Vec2* pixel) const;

  // In pixels of the undistorted image.
  const BestFitPerspective& fit() const { return fit_; }
  const AnyCamera& camera() const { return camera_; }

 private:
  PinholeInWater(const AnyCamera& camera, const AnyCamera& lens);

  AnyCamera camera_;
  AnyCamera lens_;  // the same without its port
  Vec2 focal_px_;
  Vec2 principal_point_px_;
  BestFitPerspective fit_;
};

struct RangeEffect {
  double range_m = 0.0;
  double mean_px = 0.0;
  double max_px = 0.0;
  // Of lengths across the view, at a distance that is known: 0.01 measures 1 % too much.
  double length_bias = 0.0;
};

inline constexpr int kEffectColumns = 60;
inline constexpr int kEffectRows = 40;
inline constexpr int kEffectRanges = 9;

struct RefractionEffect {
  RangeBand band;
  BestFitPerspective fit;
  double mean_px = 0.0;  // over image and band
  double max_px = 0.0;
  std::array<RangeEffect, kEffectRanges> ranges;  // evenly spread in their logarithm
  // Per cell of the image, row by row: the largest error in the band at the cell's middle; NaN
  // where the camera sees nothing.
  std::vector<double> cell_max_px;

  // How far from central: the point that all rays pass nearest to, and how far they miss it.
  Vec3 nearest_center_m = Vec3::Zero();
  double mean_miss_m = 0.0;
  double max_miss_m = 0.0;
};

RefractionEffect MeasureEffect(const PinholeInWater& pinhole, const RangeBand& band);

}  // namespace rsfm
