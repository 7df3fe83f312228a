#include "rsfm/refraction/ray_table.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "rsfm/refraction/ray_kernel.h"

namespace rsfm {
namespace {

constexpr double kFarAway = 1e4;  // metres

// Lagrange's weights of the nodes -1, 0, 1, 2 at s in [0, 1].
void CubicWeights(double s, double* w) {
  const double before = s + 1.0, after = s - 1.0, beyond = s - 2.0;
  w[0] = -s * after * beyond / 6.0;
  w[1] = before * after * beyond / 2.0;
  w[2] = -before * s * beyond / 2.0;
  w[3] = before * s * after / 6.0;
}

}  // namespace

RayTable::RayTable(const AnyCamera& camera, const RayTableOptions& options) noexcept
    : camera_(camera),
      step_(options.step_px),
      columns_((camera.width() + options.step_px - 1) / options.step_px),
      rows_((camera.height() + options.step_px - 1) / options.step_px) {
  for (int i = 0; i < step_; ++i) CubicWeights((i + 0.5) / step_, &weights_[4 * i]);
}

Expected<RayTable> RayTable::Create(const AnyCamera& camera,
                                    const RayTableOptions& options) noexcept {
  if (options.step_px < 2 || options.step_px > kMaxStep)
    return Fail(Errc::kInvalidArgument, "step_px", options.step_px);
  if (!(options.max_error_px > 0.0)) return Fail(Errc::kInvalidArgument, "max_error_px");
  if (!(options.nearest_range_m > 0.0 && options.nearest_range_m < kFarAway))
    return Fail(Errc::kInvalidArgument, "nearest_range_m");
  RayTable table(camera, options);
  const std::size_t cells = static_cast<std::size_t>(table.columns_) * table.rows_;
  const std::size_t nodes = (static_cast<std::size_t>(table.columns_) + 3) * (table.rows_ + 3);
  const std::size_t bytes = nodes * sizeof(Node) + cells;
  if (bytes > options.max_bytes)
    return Fail(Errc::kOutOfCapacity, "max_bytes", static_cast<std::int32_t>(bytes >> 10));
  table.nodes_ = FixedVector<Node>(nodes);
  table.exact_ = FixedVector<std::uint8_t>(cells);
  table.nodes_.TryResize(nodes);
  table.exact_.TryResize(cells);
  FixedVector<std::uint8_t> good(nodes);
  good.TryResize(nodes);
  table.FillNodes(&good);
  table.Measure(options);
  return table;
}

void RayTable::FillNodes(FixedVector<std::uint8_t>* good) noexcept {
  const int stride = columns_ + 3;
  for (std::size_t n = 0; n < nodes_.size(); ++n) {
    const int i = static_cast<int>(n) % stride, j = static_cast<int>(n) / stride;
    Ray3 ray;
    const Vec2 pixel((i - 1.0) * step_, (j - 1.0) * step_);
    (*good)[n] = camera_.Backproject(pixel, &ray) == Projection::kOk ? 1 : 0;
    if ((*good)[n] == 0) ray = Ray3();
    for (int c = 0; c < 3; ++c) {
      nodes_[n].value[c] = ray.origin[c];
      nodes_[n].value[3 + c] = ray.direction[c];
    }
  }
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      bool all = true;
      for (int k = 0; k < 16; ++k) all &= (*good)[(row + k / 4) * stride + column + k % 4] != 0;
      exact_[row * columns_ + column] = all ? 0 : 1;
    }
  }
}

double RayTable::ErrorPx(const Ray3& ray, const Vec2& pixel,
                         double nearest_range_m) const noexcept {
  double error = 0.0;
  for (const double range : {nearest_range_m, kFarAway}) {
    Vec2 seen;
    if (camera_.Project(ray.At(range), &seen) != Projection::kOk)
      return std::numeric_limits<double>::infinity();
    error = std::max(error, (seen - pixel).norm());
  }
  return error;
}

void RayTable::Measure(const RayTableOptions& options) noexcept {
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      std::uint8_t& exact = exact_[row * columns_ + column];
      double worst = 0.0;
      for (int k = 0; k < 9 && exact == 0; ++k) {
        const double u = (1 + 2 * (k % 3)) / 6.0, v = (1 + 2 * (k / 3)) / 6.0;
        Ray3 ray;
        Interpolate(column, row, u, v, &ray);
        const double error =
            ErrorPx(ray, Vec2((column + u) * step_, (row + v) * step_), options.nearest_range_m);
        if (!(error <= options.max_error_px)) exact = 1;
        worst = std::max(worst, error);
      }
      if (exact == 0) max_error_px_ = std::max(max_error_px_, worst);
      num_exact_cells_ += exact;
    }
  }
}

void RayTable::Interpolate(int column, int row, double u, double v, Ray3* ray) const noexcept {
  double of_row[4], of_column[4], columns[4 * kValues];
  CubicWeights(u, of_column);
  CubicWeights(v, of_row);
  for (int k = 0; k < 4; ++k) {
    for (int c = 0; c < kValues; ++c) {
      columns[k * kValues + c] = of_row[0] * NodeAt(column + k, row).value[c] +
                                 of_row[1] * NodeAt(column + k, row + 1).value[c] +
                                 of_row[2] * NodeAt(column + k, row + 2).value[c] +
                                 of_row[3] * NodeAt(column + k, row + 3).value[c];
    }
  }
  BlendColumns(columns, of_column, 1, ray);
}

Projection RayTable::Lookup(const Vec2& pixel, Ray3* ray_in_camera) const noexcept {
  if (!std::isfinite(pixel.x() + pixel.y())) return Projection::kNotFinite;
  if (!camera_.IsInImage(pixel)) return Projection::kOutsideImage;
  const double x = pixel.x() / step_, y = pixel.y() / step_;
  const int column = std::min(static_cast<int>(x), columns_ - 1),
            row = std::min(static_cast<int>(y), rows_ - 1);
  if (exact_[row * columns_ + column] != 0) return camera_.Backproject(pixel, ray_in_camera);
  Interpolate(column, row, x - column, y - row, ray_in_camera);
  return Projection::kOk;
}

void RayTable::Lookup(std::span<const Vec2> pixels, std::span<Ray3> rays_in_camera,
                      std::span<Projection> statuses) const noexcept {
  for (std::size_t i = 0; i < pixels.size(); ++i)
    statuses[i] = Lookup(pixels[i], &rays_in_camera[i]);
}

void RayTable::LookupRow(int row, int first_column, std::span<Ray3> rays_in_camera,
                         std::span<Projection> statuses) const noexcept {
  const int cell_row = row / step_;
  const double* of_row = &weights_[4 * (row % step_)];
  double columns[4 * kValues];
  int ready = -10;  // the cell that `columns` belongs to
  const auto blend = [&](int node, double* out) {
    const double* a = NodeAt(node, cell_row).value;
    const double* b = NodeAt(node, cell_row + 1).value;
    const double* c = NodeAt(node, cell_row + 2).value;
    const double* d = NodeAt(node, cell_row + 3).value;
    for (int k = 0; k < kValues; ++k)
      out[k] = of_row[0] * a[k] + of_row[1] * b[k] + of_row[2] * c[k] + of_row[3] * d[k];
  };
  for (std::size_t done = 0; done < rays_in_camera.size();) {
    const int x = first_column + static_cast<int>(done), cell = x / step_, offset = x % step_;
    const int count =
        static_cast<int>(std::min<std::size_t>(step_ - offset, rays_in_camera.size() - done));
    if (exact_[cell_row * columns_ + cell] != 0) {
      for (int i = 0; i < count; ++i) {
        statuses[done + i] =
            camera_.Backproject(Vec2(x + i + 0.5, row + 0.5), &rays_in_camera[done + i]);
      }
    } else {
      if (ready == cell - 1) {  // three of the four have been blended for the cell before
        std::copy(columns + kValues, columns + 4 * kValues, columns);
        blend(cell + 3, columns + 3 * kValues);
      } else {
        for (int k = 0; k < 4; ++k) blend(cell + k, columns + k * kValues);
      }
      ready = cell;
      BlendColumns(columns, &weights_[4 * offset], count, &rays_in_camera[done]);
      std::fill_n(statuses.begin() + done, count, Projection::kOk);
    }
    done += count;
  }
}

}  // namespace rsfm
