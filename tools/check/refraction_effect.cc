#include "tools/check/refraction_effect.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "rsfm/refraction/line_fit.h"

namespace rsfm {
namespace {

constexpr int kFitColumns = 40, kFitRows = 25;  // the paper draws 1000 at random
constexpr double kMaxSlope = 1.7320508;         // of directions in air: 60 degrees off the axis

Vec2 CellMiddle(const AnyCamera& camera, int index, int columns, int rows) {
  return {(index % columns + 0.5) * camera.width() / columns,
          (index / columns + 0.5) * camera.height() / rows};
}

bool LooksForward(const Vec3& point) { return point.z() > 1e-3 * point.norm(); }

// f(cell, pixel, ray) for every cell of the image that has a ray.
template <class F>
void ForEachCell(const AnyCamera& camera, F&& f) {
  for (int i = 0; i < kEffectColumns * kEffectRows; ++i) {
    const Vec2 pixel = CellMiddle(camera, i, kEffectColumns, kEffectRows);
    Ray3 ray;
    if (camera.Backproject(pixel, &ray) == Projection::kOk) f(i, pixel, ray);
  }
}

// The point with the least sum of squared distances from the rays' lines, and those distances.
void MeasureCenter(const AnyCamera& camera, RefractionEffect* effect) {
  Mat3 normal = Mat3::Zero();
  Vec3 right = Vec3::Zero();
  ForEachCell(camera, [&](int, const Vec2&, const Ray3& ray) {
    const Mat3 across = Mat3::Identity() - ray.direction * ray.direction.transpose();
    normal += across;
    right += across * ray.origin;
  });
  effect->nearest_center_m = normal.ldlt().solve(right);
  double sum = 0.0;
  int count = 0;
  ForEachCell(camera, [&](int, const Vec2&, const Ray3& ray) {
    const double miss = (effect->nearest_center_m - ray.origin).cross(ray.direction).norm();
    effect->max_miss_m = std::max(effect->max_miss_m, miss);
    sum += miss;
    ++count;
  });
  if (count > 0) effect->mean_miss_m = sum / count;
}

// The best similarity of what the pinhole measures, across the view at the true depth, to the
// truth: its scale, less one.
struct LengthBias {
  double n = 0.0, both = 0.0, square = 0.0;
  Vec2 sum_true = Vec2::Zero(), sum_measured = Vec2::Zero();

  void Add(const Vec2& truth, const Vec2& measured) {
    n += 1.0;
    both += truth.dot(measured);
    square += truth.squaredNorm();
    sum_true += truth;
    sum_measured += measured;
  }
  double Value() const {
    const double spread = square - sum_true.squaredNorm() / n;
    return spread > 0.0 ? (both - sum_true.dot(sum_measured) / n) / spread - 1.0 : 0.0;
  }
};

}  // namespace

PinholeInWater::PinholeInWater(const AnyCamera& camera, const AnyCamera& lens)
    : camera_(camera), lens_(lens) {
  const auto& params = camera.config().lens_params;
  const int num_focal = NumFocalLengths(camera.config().lens);
  focal_px_ = Vec2(params[0], params[num_focal - 1]);
  principal_point_px_ = Vec2(params[num_focal], params[num_focal + 1]);
}

Expected<PinholeInWater> PinholeInWater::Fit(const AnyCamera& camera, const RangeBand& band) {
  if (!(band.near_m > 0.0) || !(band.far_m >= band.near_m) || !std::isfinite(band.far_m))
    return Fail(Errc::kInvalidArgument, "range");
  CameraConfig in_air = camera.config();
  in_air.port = PortConfig();
  const auto lens = AnyCamera::Create(in_air);
  if (!lens) return tl::unexpected(lens.error());
  PinholeInWater pinhole(camera, *lens);
  LineFit horizontal, vertical;
  for (int i = 0; i < kFitColumns * kFitRows; ++i) {
    const Vec2 pixel = CellMiddle(camera, i, kFitColumns, kFitRows);
    Ray3 ray;
    Vec2 undistorted;
    if (camera.Backproject(pixel, &ray) != Projection::kOk) continue;
    // The golden ratio's sequence: neighbours differ and every part of the image sees all of the
    // band.
    const double fraction = std::fmod(0.5 + i * 0.6180339887498949, 1.0);
    const Vec3 point = ray.At(band.near_m + fraction * (band.far_m - band.near_m));
    if (!LooksForward(point) || !pinhole.Undistort(pixel, &undistorted)) continue;
    horizontal.Add(point.x() / point.z(), undistorted.x());
    vertical.Add(point.y() / point.z(), undistorted.y());
  }
  BestFitPerspective& fit = pinhole.fit_;
  if (!horizontal.Solve(&fit.fx, &fit.cx) || !vertical.Solve(&fit.fy, &fit.cy)) {
    return Fail(Errc::kDegenerate, "image points with a forward ray",
                static_cast<std::int32_t>(horizontal.n));
  }
  return pinhole;
}

bool PinholeInWater::Undistort(const Vec2& pixel, Vec2* undistorted) const {
  Ray3 ray;
  if (lens_.Backproject(pixel, &ray) != Projection::kOk) return false;
  if (!(ray.direction.head<2>().norm() < kMaxSlope * ray.direction.z())) return false;
  *undistorted =
      focal_px_.cwiseProduct(ray.direction.head<2>() / ray.direction.z()) + principal_point_px_;
  return true;
}

bool PinholeInWater::Project(const Vec3& point_in_camera, Vec2* pixel) const {
  if (!LooksForward(point_in_camera)) return false;
  const Vec2 slope = (fit_.Project(point_in_camera) - principal_point_px_).cwiseQuotient(focal_px_);
  return lens_.Project(Vec3(slope.x(), slope.y(), 1.0), pixel) == Projection::kOk;
}

RefractionEffect MeasureEffect(const PinholeInWater& pinhole, const RangeBand& band) {
  const AnyCamera& camera = pinhole.camera();
  RefractionEffect effect;
  effect.band = band;
  effect.fit = pinhole.fit();
  effect.cell_max_px.assign(kEffectColumns * kEffectRows, std::numeric_limits<double>::quiet_NaN());
  double sum = 0.0, sum_squared = 0.0;
  int count = 0;
  for (int r = 0; r < kEffectRanges; ++r) {
    RangeEffect& at = effect.ranges[r];
    at.range_m = band.near_m * std::pow(band.far_m / band.near_m, r / (kEffectRanges - 1.0));
    LengthBias bias;
    double sum_at = 0.0;
    int count_at = 0;
    ForEachCell(camera, [&](int cell, const Vec2& pixel, const Ray3& ray) {
      const Vec3 point = ray.At(at.range_m);
      Vec2 believed, undistorted;
      if (!pinhole.Project(point, &believed) || !pinhole.Undistort(pixel, &undistorted)) return;
      const double error = (believed - pixel).norm();
      double& worst = effect.cell_max_px[cell];
      worst = std::isnan(worst) ? error : std::max(worst, error);
      at.max_px = std::max(at.max_px, error);
      sum_at += error;
      sum_squared += error * error;
      ++count_at;
      bias.Add(point.head<2>(), point.z() * effect.fit.Normalise(undistorted));
    });
    if (count_at == 0) continue;
    at.mean_px = sum_at / count_at;
    at.length_bias = bias.Value();
    effect.max_px = std::max(effect.max_px, at.max_px);
    sum += sum_at;
    count += count_at;
  }
  if (count > 0) {
    effect.mean_px = sum / count;
    effect.fit.rms_error_px = std::sqrt(sum_squared / count);
  }
  effect.fit.max_error_px = effect.max_px;
  MeasureCenter(camera, &effect);
  return effect;
}

}  // namespace rsfm
