#include <set>

#include "rsfm/base/plausible_time.h"
#include "rsfm/io/atomic_output.h"
#include "rsfm/io/csv.h"
#include "rsfm/io/tables.h"
#include "rsfm/io/text.h"

namespace rsfm {

IoExpected<std::vector<ImageTime>> ReadImageTimes(const std::filesystem::path& path) {
  return ReadImageTimes(path, CutEnd::kError);
}

IoExpected<std::vector<ImageTime>> ReadImageTimes(const std::filesystem::path& path,
                                                  CutEnd cut_end) {
  const auto csv = ReadCsv(path, cut_end);
  if (!csv) return Fail(csv.error());
  const std::string file = path.string();
  if (csv->columns != std::vector<std::string>{"image", "utime"}) {
    return Fail({Errc::kInvalidArgument, file, "header", "is not 'image,utime'",
                 "write image,utime in the first line", csv->header_line});
  }
  std::vector<ImageTime> images;
  std::set<std::string_view> names;
  for (const CsvRow& row : csv->rows) {
    const auto problem = [&](const char* column, std::string what, std::string fix,
                             Errc code = Errc::kInvalidArgument) {
      return Fail(
          {code, file, std::string("column ") + column, std::move(what), std::move(fix), row.line});
    };
    const auto utime = ParseInteger(row.fields[1]);
    if (row.fields[0].empty()) return problem("image", "is empty", "give the file's name");
    if (!names.insert(row.fields[0]).second) {
      return problem("image", Quoted(row.fields[0]) + " is there twice", "keep one of them");
    }
    if (!utime || !IsTime(*utime)) {
      return problem("utime", Quoted(row.fields[1]) + " is no time in whole microseconds",
                     "give microseconds since the epoch");
    }
    if (!images.empty() && *utime <= images.back().utime) {
      return problem("utime",
                     "time does not increase: " + std::to_string(*utime) + " after " +
                         std::to_string(images.back().utime),
                     "sort the table by time and let no two images share one", Errc::kOutOfOrder);
    }
    images.push_back({std::string(row.fields[0]), *utime});
  }
  return images;
}

IoStatus WriteImageTimes(const std::vector<ImageTime>& images, const std::filesystem::path& path) {
  std::string text = "image,utime\n";
  for (const ImageTime& image : images) {
    if (image.image.find_first_of(",\"\n\r") != std::string::npos) {
      return Fail({Errc::kInvalidArgument, path.string(), "column image",
                   Quoted(image.image) + " has a character that a table cannot hold",
                   "rename the image"});
    }
    text += image.image + "," + std::to_string(image.utime) + "\n";
  }
  return WriteFileAtomically(path, text);
}

}  // namespace rsfm
