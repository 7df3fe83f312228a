// Features of one image sorted into square cells, for search around a pixel. Fixed memory.
#pragma once

#include <algorithm>
#include <span>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/mapping/feature.h"

namespace rsfm {

class FeatureGrid {
 public:
  FeatureGrid(int width_px, int height_px, int cell_px, int max_features);

  // Replaces what was there. Features outside the image go to the cells at its edge.
  void Build(std::span<const Feature> features) noexcept;

  // f(index) for every feature within radius_px (Euclidean) of the pixel, cell by cell.
  template <class F>
  void ForEachNear(const Vec2& pixel, double radius_px, F&& f) const {
    const int column_end = Column(pixel.x() + radius_px), row_end = Row(pixel.y() + radius_px);
    for (int row = Row(pixel.y() - radius_px); row <= row_end; ++row) {
      for (int column = Column(pixel.x() - radius_px); column <= column_end; ++column) {
        const int cell = row * columns_ + column;
        for (int k = first_[cell]; k < first_[cell + 1]; ++k) {
          const int i = order_[k];
          if ((features_[i].pixel() - pixel).squaredNorm() <= radius_px * radius_px) f(i);
        }
      }
    }
  }

  std::size_t bytes() const { return first_.bytes() + order_.bytes(); }

 private:
  int Column(double x) const { return Clamp(x, columns_); }
  int Row(double y) const { return Clamp(y, rows_); }
  int Clamp(double value, int count) const {
    return static_cast<int>(std::clamp(value * inverse_cell_, 0.0, count - 1.0));
  }
  int CellOf(const Feature& feature) const {
    return Row(feature.y_px) * columns_ + Column(feature.x_px);
  }

  int columns_ = 1, rows_ = 1;
  double inverse_cell_ = 1.0;
  FixedVector<int> first_;  // of each cell in order_, and the end
  FixedVector<int> order_;
  std::span<const Feature> features_;
};

}  // namespace rsfm
