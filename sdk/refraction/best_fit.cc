#include "rsfm/refraction/best_fit.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "rsfm/refraction/line_fit.h"

namespace rsfm {
namespace {

constexpr int kMaxKeptSamples = 1024;

// f(point in camera, pixel) for every grid pixel that has a ray, its range spread evenly over the
// band.
template <class F>
void ForEachSample(const AnyCamera& camera, const BestFitOptions& options, F&& f) {
  const int count = options.grid_columns * options.grid_rows;
  for (int i = 0; i < count; ++i) {
    const Vec2 pixel((i % options.grid_columns + 0.5) * camera.width() / options.grid_columns,
                     (i / options.grid_columns + 0.5) * camera.height() / options.grid_rows);
    Ray3 ray;
    if (camera.Backproject(pixel, &ray) != Projection::kOk) continue;
    // Ranges follow the golden ratio's sequence, so that neighbours differ and every part of the
    // image sees all of the band.
    const double fraction = std::fmod(0.5 + i * 0.6180339887498949, 1.0);
    const Vec3 point =
        ray.At(options.min_range_m + fraction * (options.max_range_m - options.min_range_m));
    if (point.z() > 1e-3 * point.norm()) f(point, pixel);
  }
}

}  // namespace

Expected<BestFitPerspective> FitPerspective(const AnyCamera& camera,
                                            const BestFitOptions& options) noexcept {
  if (!(options.min_range_m > 0.0) || !(options.max_range_m >= options.min_range_m) ||
      !std::isfinite(options.max_range_m)) {
    return Fail(Errc::kInvalidArgument, "range");
  }
  if (options.grid_columns < 4 || options.grid_rows < 4 || options.grid_columns > 10000 ||
      options.grid_rows > 10000) {
    return Fail(Errc::kInvalidArgument, "grid");
  }
  // The samples are kept for the second pass as far as they fit on the stack.
  struct Sample {
    Vec3 point;
    Vec2 pixel;
  };
  std::array<Sample, kMaxKeptSamples> kept;
  const bool keep = options.grid_columns * options.grid_rows <= kMaxKeptSamples;
  int num_kept = 0;
  LineFit horizontal, vertical;
  ForEachSample(camera, options, [&](const Vec3& point, const Vec2& pixel) {
    horizontal.Add(point.x() / point.z(), pixel.x());
    vertical.Add(point.y() / point.z(), pixel.y());
    if (keep) kept[num_kept++] = {point, pixel};
  });
  BestFitPerspective fit;
  if (!horizontal.Solve(&fit.fx, &fit.cx) || !vertical.Solve(&fit.fy, &fit.cy)) {
    return Fail(Errc::kDegenerate, "image points with a forward ray",
                static_cast<std::int32_t>(horizontal.n));
  }
  double sum = 0.0, worst = 0.0;
  const auto add_error = [&](const Vec3& point, const Vec2& pixel) {
    const double error_squared = (fit.Project(point) - pixel).squaredNorm();
    sum += error_squared;
    worst = std::max(worst, error_squared);
  };
  if (keep) {
    for (int i = 0; i < num_kept; ++i) add_error(kept[i].point, kept[i].pixel);
  } else {
    ForEachSample(camera, options, add_error);
  }
  fit.rms_error_px = std::sqrt(sum / horizontal.n);
  fit.max_error_px = std::sqrt(worst);
  return fit;
}

}  // namespace rsfm
