// A look-up table of rays for callers who want one for each pixel: back-projections at the nodes of
// a regular grid, with cubic Lagrange interpolation between them along rows and columns.
//
// The table is made, and measured, once; its error in pixels is stated by max_error_px(). Cells
// that cannot be interpolated well enough (a lens's edge within reach, a fold of the distortion)
// are marked, and their pixels are back-projected exactly: statuses are those of
// AnyCamera::Backproject.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "rsfm/base/error.h"
#include "rsfm/base/fixed_vector.h"
#include "rsfm/refraction/any_camera.h"

namespace rsfm {

struct RayTableOptions {
  int step_px = 16;              // between nodes, 2 to 64; the error grows with its fourth power
  double max_error_px = 1e-4;    // cells that are worse are computed exactly
  double nearest_range_m = 0.5;  // errors are measured there and far away
  std::size_t max_bytes = 64u << 20;  // what the table may take at most
};

class RayTable {
 public:
  static constexpr int kMaxStep = 64;
  static constexpr int kValues = 6;  // origin, direction

  // Allocates, once: Bytes(). kInvalidArgument names the option; kOutOfCapacity: the table would
  // take more than max_bytes (`detail`: KiB needed).
  static Expected<RayTable> Create(const AnyCamera& camera,
                                   const RayTableOptions& options = {}) noexcept;

  // The ray of any pixel of the image. kOutsideImage beyond it, kNotFinite for NaN. The direction
  // is a unit vector to within the table's error.
  Projection Lookup(const Vec2& pixel, Ray3* ray_in_camera) const noexcept;
  void Lookup(std::span<const Vec2> pixels, std::span<Ray3> rays_in_camera,
              std::span<Projection> statuses) const noexcept;
  // The rays of the centres of the pixels (first_column ...) of an image row, by far the fastest
  // way to all of them. Precondition: the row and the columns are in the image.
  void LookupRow(int row, int first_column, std::span<Ray3> rays_in_camera,
                 std::span<Projection> statuses) const noexcept;

  // Of the interpolated cells, at nine places of each, at options.nearest_range_m and far away.
  double max_error_px() const noexcept { return max_error_px_; }
  int num_cells() const noexcept { return columns_ * rows_; }
  int num_exact_cells() const noexcept { return num_exact_cells_; }  // not interpolated
  std::size_t Bytes() const noexcept { return nodes_.bytes() + exact_.bytes(); }

 private:
  struct Node {
    double value[kValues];
  };
  RayTable(const AnyCamera& camera, const RayTableOptions& options) noexcept;
  const Node& NodeAt(int i, int j) const { return nodes_[j * (columns_ + 3) + i]; }
  void FillNodes(FixedVector<std::uint8_t>* good) noexcept;
  void Measure(const RayTableOptions& options) noexcept;
  void Interpolate(int column, int row, double u, double v, Ray3* ray) const noexcept;
  double ErrorPx(const Ray3& ray, const Vec2& pixel, double nearest_range_m) const noexcept;

  AnyCamera camera_;
  int step_, columns_, rows_;  // cells
  double max_error_px_ = 0.0;
  int num_exact_cells_ = 0;
  // Node (i, j) lies at pixel ((i - 1) step, (j - 1) step): one more than the cells on either side.
  FixedVector<Node> nodes_;
  FixedVector<std::uint8_t> exact_;           // by cell: not to be interpolated
  std::array<double, 4 * kMaxStep> weights_;  // of the pixel centres within a cell
};

}  // namespace rsfm
