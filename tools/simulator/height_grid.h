// A digital elevation model: heights on a regular grid.
#pragma once

#include <filesystem>
#include <vector>

#include "rsfm/base/linear.h"
#include "rsfm/io/diagnostic.h"

namespace rsfm::simulator {

// Centred on its own origin: north and east are those from the middle of the grid.
class HeightGrid {
 public:
  // Esri's ASCII grid: ncols, nrows, xllcorner or xllcenter, yllcorner or yllcenter, cellsize [m],
  // NODATA_value, then rows from north to south; elevations up, metres. A cell without data takes
  // its neighbour's value to the west, or else to the north. Errors name file, line and fix.
  static IoExpected<HeightGrid> Read(const std::filesystem::path& path);

  // Height above the grid's mean, bilinear; outside as at the nearest edge.
  double At(double north_m, double east_m) const;
  double Lowest() const { return lowest_; }  // of At(), negative
  double Highest() const { return highest_; }
  // Between the middles of the outermost cells.
  Vec2 HalfSize() const { return half_size_m_; }  // north, east

 private:
  int rows_ = 0;
  int columns_ = 0;
  double cell_m_ = 1.0;
  double lowest_ = 0.0;
  double highest_ = 0.0;
  Vec2 half_size_m_ = Vec2::Zero();
  std::vector<float> heights_;  // from north to south, from west to east
};

}  // namespace rsfm::simulator
