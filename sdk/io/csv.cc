#include "rsfm/io/csv.h"

#include <algorithm>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/text.h"

namespace rsfm {

IoExpected<CsvTable> ReadCsv(const std::filesystem::path& path, CutEnd cut_end) {
  auto text = ReadWholeFile(path);
  if (!text) return Fail(text.error());
  CsvTable table;
  table.text = std::make_unique<std::string>(std::move(*text));
  std::string_view rest = *table.text, line;
  if (cut_end == CutEnd::kDrop) rest = rest.substr(0, rest.rfind('\n') + 1);
  if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);  // a byte order mark
  bool has_header = false;
  for (int number = 1; NextLine(&rest, &line); ++number) {
    line = Trim(line);
    if (line.empty() || line.front() == '#') continue;
    const auto fail = [&](std::string field, std::string problem, std::string fix) {
      return Fail({Errc::kInvalidArgument, path.string(), std::move(field), std::move(problem),
                   std::move(fix), number});
    };
    if (line.find('"') != std::string_view::npos) {
      return fail("", "has quotes", "write the fields without them");
    }
    std::vector<std::string_view> fields = SplitAt(line, ',');
    if (!has_header) {
      has_header = true;
      table.header_line = number;
      for (const std::string_view field : fields) {
        if (std::find(table.columns.begin(), table.columns.end(), field) != table.columns.end()) {
          return fail("column " + Quoted(field), "is there twice", "keep one of them");
        }
        table.columns.emplace_back(field);
      }
      continue;
    }
    if (fields.size() != table.columns.size()) {
      return fail("",
                  "has " + std::to_string(fields.size()) + " fields, the header has " +
                      std::to_string(table.columns.size()),
                  "give each column its field, empty where there is no value");
    }
    table.rows.push_back({number, std::move(fields)});
  }
  if (!has_header) {
    return Fail({Errc::kInvalidArgument, path.string(), "", "is empty",
                 "write a header line that names the columns"});
  }
  return table;
}

}  // namespace rsfm
