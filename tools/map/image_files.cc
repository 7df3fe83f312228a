#include "tools/map/image_files.h"

#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <string_view>

#include "rsfm/io/atomic_output.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

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

}  // namespace

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
