#include "tools/simulator/height_grid.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <string>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/text.h"

namespace rsfm::simulator {
namespace {

constexpr std::int64_t kMaxCells = 100'000'000;

struct Header {
  double columns = 0.0, rows = 0.0, cell = 0.0;
  double no_data = -9999.0;
};

std::string LowerCase(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return lower;
}

}  // namespace

IoExpected<HeightGrid> HeightGrid::Read(const std::filesystem::path& path) {
  const auto text = ReadWholeFile(path);
  if (!text) return Fail(text.error());
  int line_number = 0;
  const auto corrupt = [&](std::string field, std::string problem, std::string fix) {
    return Fail({Errc::kCorrupt, path.string(), std::move(field), std::move(problem),
                 std::move(fix), line_number});
  };
  Header header;
  std::string_view rest = *text;
  std::string_view line;
  std::string_view body = rest;
  std::vector<std::string_view> fields;
  while (NextLine(&rest, &line)) {
    SplitBlanks(line, &fields);
    const bool is_word = !fields.empty() && std::isalpha(static_cast<unsigned char>(fields[0][0]));
    if (!fields.empty() && !is_word) break;
    ++line_number;
    body = rest;
    if (fields.empty()) continue;
    const std::string key = LowerCase(fields[0]);
    const auto value = fields.size() == 2 ? ParseNumber(fields[1]) : std::nullopt;
    if (!value || !std::isfinite(*value)) {
      return corrupt(key, "has no number", "give an Esri ASCII grid");
    }
    if (key == "ncols")
      header.columns = *value;
    else if (key == "nrows")
      header.rows = *value;
    else if (key == "cellsize")
      header.cell = *value;
    else if (key == "nodata_value")
      header.no_data = *value;
    else if (key.rfind("xll", 0) != 0 && key.rfind("yll", 0) != 0) {
      return corrupt(key, "is not a field of an Esri ASCII grid",
                     "give ncols, nrows, xllcorner, yllcorner, cellsize and NODATA_value");
    }
  }
  line_number = 0;
  if (!(header.columns >= 2 && header.rows >= 2 && header.columns * header.rows <= kMaxCells)) {
    return corrupt("ncols, nrows", "are missing or out of range",
                   "give from 2 x 2 to 100 million cells");
  }
  if (!(header.cell >= 1e-3 && header.cell <= 1e5)) {
    return corrupt("cellsize", "is missing or out of range", "give metres, from 0.001 to 100000");
  }
  HeightGrid grid;
  grid.columns_ = static_cast<int>(header.columns);
  grid.rows_ = static_cast<int>(header.rows);
  grid.cell_m_ = header.cell;
  grid.half_size_m_ = 0.5 * header.cell * Vec2(grid.rows_ - 1, grid.columns_ - 1);
  const std::size_t size = static_cast<std::size_t>(grid.columns_) * grid.rows_;
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  std::size_t known = 0;
  double sum = 0.0;
  grid.heights_.reserve(size);
  while (grid.heights_.size() <= size) {
    const std::size_t start = body.find_first_not_of(" \t\r\n");
    if (start == std::string_view::npos) break;
    body.remove_prefix(start);
    const std::size_t end = std::min(body.find_first_of(" \t\r\n"), body.size());
    const auto value = ParseNumber(body.substr(0, end));
    const std::string cell = "cell " + std::to_string(grid.heights_.size() + 1);
    if (!value) return corrupt(cell, Quoted(body.substr(0, end)) + " is not a number", "repair it");
    body.remove_prefix(end);
    const bool is_known = std::isfinite(*value) && *value != header.no_data;
    if (is_known && std::abs(*value) > 12000.0) {
      return corrupt(cell, "is no elevation in metres", "state it as NODATA_value, or repair it");
    }
    grid.heights_.push_back(is_known ? static_cast<float>(*value) : kNone);
    known += is_known ? 1 : 0;
    if (is_known) sum += *value;
  }
  if (grid.heights_.size() != size) {
    return corrupt("",
                   "has " + std::to_string(grid.heights_.size()) +
                       (grid.heights_.size() > size ? " or more" : "") +
                       " cells where ncols x nrows is " + std::to_string(size),
                   "repair the header or the rows");
  }
  if (known == 0) return corrupt("", "has no cell with data", "check NODATA_value");
  const double mean = sum / static_cast<double>(known);
  const auto first = std::find_if(grid.heights_.begin(), grid.heights_.end(),
                                  [](float v) { return std::isfinite(v); });
  grid.lowest_ = std::numeric_limits<double>::infinity();
  grid.highest_ = -grid.lowest_;
  for (std::size_t i = 0; i < size; ++i) {
    float& height = grid.heights_[i];
    if (std::isfinite(height)) {
      height = static_cast<float>(static_cast<double>(height) - mean);
    } else if (i % grid.columns_ != 0) {
      height = grid.heights_[i - 1];
    } else {
      height = i > 0 ? grid.heights_[i - grid.columns_]
                     : static_cast<float>(static_cast<double>(*first) - mean);
    }
    grid.lowest_ = std::min(grid.lowest_, static_cast<double>(height));
    grid.highest_ = std::max(grid.highest_, static_cast<double>(height));
  }
  return grid;
}

double HeightGrid::At(double north_m, double east_m) const {
  const double row = std::clamp((half_size_m_.x() - north_m) / cell_m_, 0.0, rows_ - 1.0);
  const double column = std::clamp((half_size_m_.y() + east_m) / cell_m_, 0.0, columns_ - 1.0);
  const int r = std::min(static_cast<int>(row), rows_ - 2);
  const int c = std::min(static_cast<int>(column), columns_ - 2);
  const double fr = row - r;
  const double fc = column - c;
  const float* at = &heights_[static_cast<std::size_t>(r) * columns_ + c];
  return (1.0 - fr) * ((1.0 - fc) * at[0] + fc * at[1]) +
         fr * ((1.0 - fc) * at[columns_] + fc * at[columns_ + 1]);
}

}  // namespace rsfm::simulator
