#include "tools/map/image_files.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "rsfm/io/atomic_output.h"
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

std::uint32_t BigEndian(std::string_view bytes, std::size_t at, int count) {
  std::uint32_t value = 0;
  for (int i = 0; i < count; ++i)
    value = value << 8 | static_cast<unsigned char>(bytes[at + static_cast<std::size_t>(i)]);
  return value;
}

// Whether the end-of-image marker follows the scans. Walks the segments, so that a thumbnail's own
// marker does not count.   [ITU-T T.81, annex B]
bool JpegIsWhole(std::string_view bytes) {
  std::size_t at = 2;
  while (at + 4 <= bytes.size()) {
    if (static_cast<unsigned char>(bytes[at]) != 0xFF) return false;
    const auto marker = static_cast<unsigned char>(bytes[at + 1]);
    if (marker == 0xFF) {  // fill byte
      ++at;
      continue;
    }
    at += 2 + BigEndian(bytes, at + 2, 2);
    if (marker != 0xDA) continue;
    // Entropy-coded data: to the next marker that is neither a stuffed 0 nor a restart.
    for (;; ++at) {
      if (at + 2 > bytes.size()) return false;
      if (static_cast<unsigned char>(bytes[at]) != 0xFF) continue;
      const auto next = static_cast<unsigned char>(bytes[at + 1]);
      if (next == 0xD9) return true;
      if (next != 0x00 && next != 0xFF && (next < 0xD0 || next > 0xD7)) break;
    }
  }
  return false;
}

bool PngIsWhole(std::string_view bytes) {
  for (std::size_t at = 8; at + 12 <= bytes.size();) {
    const std::size_t length = BigEndian(bytes, at, 4);
    if (bytes.substr(at + 4, 4) == "IEND") return true;
    at += 12 + length;
  }
  return false;
}

bool IsCutOff(std::string_view bytes) {
  if (bytes.starts_with("\xFF\xD8")) return !JpegIsWhole(bytes);
  if (bytes.starts_with("\x89PNG\r\n\x1A\n")) return !PngIsWhole(bytes);
  return false;
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

struct ImageReader::Impl {
  int width_px, height_px;
  cv::Mat image;
};

ImageReader::ImageReader(int width_px, int height_px)
    : impl_(std::make_unique<Impl>(Impl{width_px, height_px, {}})) {}
ImageReader::~ImageReader() = default;

IoExpected<ImageView> ImageReader::Read(const fs::path& path) {
  const auto bytes = ReadWholeFile(path);
  if (!bytes) return Fail(bytes.error());
  const auto problem = [&](std::string what, std::string fix, Errc code) {
    return Fail({code, path.string(), "image", std::move(what), std::move(fix)});
  };
  if (IsCutOff(*bytes)) {
    return problem("is cut off: the file ends before the image does",
                   "copy the file again, or take the image out of the folder or table",
                   Errc::kInvalidArgument);
  }
  const cv::Mat raw(1, static_cast<int>(bytes->size()), CV_8UC1,
                    const_cast<char*>(bytes->data()));  // only read
  try {
    impl_->image = bytes->empty() ? cv::Mat() : cv::imdecode(raw, cv::IMREAD_COLOR);
  } catch (const cv::Exception&) {
    impl_->image = cv::Mat();
  }
  const cv::Mat& image = impl_->image;
  if (image.empty()) {
    return problem("is damaged or not an image", "replace the file or take it out",
                   Errc::kInvalidArgument);
  }
  if (image.cols != impl_->width_px || image.rows != impl_->height_px) {
    return problem("is " + std::to_string(image.cols) + " x " + std::to_string(image.rows) +
                       " px, the rig's camera " + std::to_string(impl_->width_px) + " x " +
                       std::to_string(impl_->height_px),
                   "give images of the camera's size, or correct width and height in the rig file",
                   Errc::kInvalidArgument);
  }
  return ImageView{image.data, image.cols, image.rows, static_cast<int>(image.step), 3};
}

}  // namespace rsfm
