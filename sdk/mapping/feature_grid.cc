#include "rsfm/mapping/feature_grid.h"

namespace rsfm {

FeatureGrid::FeatureGrid(int width_px, int height_px, int cell_px, int max_features)
    : columns_((width_px + cell_px - 1) / cell_px),
      rows_((height_px + cell_px - 1) / cell_px),
      inverse_cell_(1.0 / cell_px),
      first_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) + 1),
      order_(static_cast<std::size_t>(max_features)) {
  first_.TryResize(first_.capacity());
}

void FeatureGrid::Build(std::span<const Feature> features) noexcept {
  features_ = features.first(std::min(features.size(), order_.capacity()));
  order_.TryResize(features_.size());
  // Counting sort: stable, so the order within a cell is that of the features.
  std::fill(first_.begin(), first_.end(), 0);
  for (const Feature& feature : features_) ++first_[CellOf(feature) + 1];
  for (std::size_t cell = 1; cell < first_.size(); ++cell) first_[cell] += first_[cell - 1];
  for (std::size_t i = features_.size(); i-- > 0;) {
    order_[--first_[CellOf(features_[i]) + 1]] = static_cast<int>(i);
  }
  // Each entry cell + 1 is now the first of its own cell: shift back by one.
  for (std::size_t cell = 0; cell + 1 < first_.size(); ++cell) first_[cell] = first_[cell + 1];
  first_.back() = static_cast<int>(features_.size());
}

}  // namespace rsfm
