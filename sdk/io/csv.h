// Comma-separated tables with one header line. For sdk/io's own readers.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "rsfm/io/diagnostic.h"

namespace rsfm {

struct CsvRow {
  int line = 0;                          // 1-based
  std::vector<std::string_view> fields;  // as many as there are columns; views into the table
};

struct CsvTable {
  std::unique_ptr<std::string> text;  // what the rows point into
  int header_line = 1;
  std::vector<std::string> columns;  // names differ
  std::vector<CsvRow> rows;          // blank lines and lines that begin with # are left out
};

// Fields are trimmed; quotes have no meaning and are refused. Every row has a field for each
// column, or it is an error that names the line.
// kDrop is for tables that grow while a vehicle may lose power: a last line without its end is then
// taken for cut off and left out.
enum class CutEnd : std::uint8_t { kError, kDrop };
IoExpected<CsvTable> ReadCsv(const std::filesystem::path& path, CutEnd cut_end = CutEnd::kError);

struct ImageTime;
// ReadImageTimes (tables.h) with that choice.
IoExpected<std::vector<ImageTime>> ReadImageTimes(const std::filesystem::path& path,
                                                  CutEnd cut_end);

}  // namespace rsfm
