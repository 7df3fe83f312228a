#include "tools/feed/image_list.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <string>
#include <string_view>

#include "rsfm/io/mission.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

bool IsImageName(const fs::path& path) {
  constexpr std::array<std::string_view, 9> kExtensions = {".jpg", ".jpeg", ".png", ".tif", ".tiff",
                                                           ".bmp", ".pgm",  ".ppm", ".webp"};
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end();
}

IoExpected<std::vector<ImageTime>> TimesByName(const fs::path& folder, double fps) {
  std::vector<ImageTime> images;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (IsImageName(entry->path())) images.push_back({entry->path().filename().string(), 0});
  }
  if (error) return Fail(FromErrno(error.value(), folder.string(), "list the folder"));
  std::sort(images.begin(), images.end(),
            [](const auto& a, const auto& b) { return NaturalLess(a.image, b.image); });
  for (std::size_t i = 0; i < images.size(); ++i)
    images[i].utime = UsFromSeconds(static_cast<double>(i) / fps);
  return images;
}

}  // namespace

bool NaturalLess(std::string_view a, std::string_view b) {
  const auto is_digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!is_digit(a[i]) || !is_digit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
      continue;
    }
    const auto number = [&](std::string_view s, std::size_t* at) {
      while (*at < s.size() && s[*at] == '0') ++*at;
      const std::size_t start = *at;
      while (*at < s.size() && is_digit(s[*at])) ++*at;
      return s.substr(start, *at - start);
    };
    const std::string_view m = number(a, &i), n = number(b, &j);
    if (m.size() != n.size()) return m.size() < n.size();
    if (m != n) return m < n;
  }
  if (i < a.size() || j < b.size()) return i >= a.size();
  return a < b;  // equal but for leading zeros
}

IoExpected<ImageList> ListImages(const fs::path& images, const std::optional<fs::path>& times,
                                 double fps) {
  std::error_code error;
  if (!fs::is_directory(images, error)) {
    return Fail({Errc::kNotFound, images.string(), "", "is not a folder",
                 "give a folder of images or a mission folder"});
  }
  ImageList list;
  list.folder = images;
  if (fs::is_directory(images / kImagesFolder, error)) list.folder = images / kImagesFolder;
  if (fs::exists(images / "nav.csv", error)) list.nav = images / "nav.csv";

  std::optional<fs::path> table = times;
  if (!table && fs::exists(images / kImagesFile, error)) table = images / kImagesFile;
  auto listed = table ? ReadImageTimes(*table) : TimesByName(list.folder, fps);
  if (!listed) return Fail(listed.error());
  list.images = std::move(*listed);
  if (list.images.empty()) {
    return Fail({Errc::kNotFound, (table ? *table : list.folder).string(), "", "holds no image",
                 "give a folder with JPEG, PNG, TIFF, BMP, PGM, PPM or WebP images"});
  }
  for (const ImageTime& image : list.images) {
    if (fs::exists(list.folder / image.image, error)) continue;
    return Fail({Errc::kNotFound, (list.folder / image.image).string(), "",
                 "is listed in " + table->string() + " but is not there",
                 "copy the image or take its line out of the table"});
  }
  return list;
}

}  // namespace rsfm
