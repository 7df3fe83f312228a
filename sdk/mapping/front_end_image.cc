#include "rsfm/mapping/front_end_image.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <opencv2/features2d.hpp>

#include "rsfm/mapping/patch_describer.h"

namespace rsfm {
namespace {

constexpr float kOrbScale = 1.2f;

}  // namespace

Expected<std::unique_ptr<FrontEnd>> FrontEnd::Create(const MapperOptions& options, int width_px,
                                                     int height_px) {
  if (const Status status = options.Validate(); !status) return tl::unexpected(status.error());
  if (width_px < 32 || height_px < 32) return Fail(Errc::kInvalidArgument, "size");
  return options.rhythm == Rhythm::kVideo ? MakeVideoFrontEnd(options, width_px, height_px)
                                          : MakeStillsFrontEnd(options, width_px, height_px);
}

std::shared_ptr<cv::Feature2D> MakeFeature2D(DescriptorType type, int max_features) {
  switch (type) {
    case DescriptorType::kOrb:
      return cv::ORB::create(max_features, kOrbScale, 8, 31, 0, 2, cv::ORB::HARRIS_SCORE, 31, 10);
    case DescriptorType::kAkaze:
      return cv::AKAZE::create(cv::AKAZE::DESCRIPTOR_MLDB, 0, 3, 0.0005f);
    case DescriptorType::kSift:
    case DescriptorType::kNone:
      break;
  }
  return cv::SIFT::create(max_features, 3, 0.02);
}

GreyImage::GreyImage(const MapperOptions& options, int width_px, int height_px)
    : width_(width_px),
      height_(height_px),
      pixels_(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px)),
      mask_(pixels_.capacity()),
      contrast_(width_px, height_px, options.contrast_limit) {
  pixels_.TryResize(pixels_.capacity());
  mask_.TryResize(mask_.capacity());
  std::fill(mask_.begin(), mask_.end(), std::uint8_t{255});
  for (const MaskRectangle& r : options.mask) {
    const int left = std::clamp(r.left, 0, width_), right = std::clamp(r.right, 0, width_);
    for (int y = std::max(r.top, 0); y < std::min(r.bottom, height_); ++y) {
      std::uint8_t* row = mask_.data() + static_cast<std::ptrdiff_t>(y) * width_;
      std::fill(row + left, row + right, std::uint8_t{0});
    }
  }
}

Status GreyImage::Take(const ImageView& image) noexcept {
  const bool sane = image.data != nullptr && (image.channels == 1 || image.channels == 3) &&
                    image.stride_bytes >= image.width * image.channels;
  if (!sane) return Fail(Errc::kInvalidArgument, "image");
  if (image.width != width_ || image.height != height_) return Fail(Errc::kInvalidArgument, "size");
  for (int y = 0; y < height_; ++y) {
    const std::uint8_t* from = image.data + static_cast<std::ptrdiff_t>(y) * image.stride_bytes;
    std::uint8_t* to = pixels_.data() + static_cast<std::ptrdiff_t>(y) * width_;
    if (image.channels == 1) {
      std::copy(from, from + width_, to);
      continue;
    }
    // Luma of ITU-R BT.601 in 15 bits.
    for (int x = 0; x < width_; ++x) {
      const int luma = 3735 * from[3 * x] + 19235 * from[3 * x + 1] + 9798 * from[3 * x + 2];
      to[x] = static_cast<std::uint8_t>((luma + 16384) >> 15);
    }
  }
  contrast_.Apply(pixels_.data(), width_);
  return {};
}

void PackDescriptor(DescriptorType type, const cv::Mat& descriptors, int row,
                    std::uint8_t* packed) {
  if (type != DescriptorType::kSift) {
    std::memset(packed, 0, static_cast<std::size_t>(DescriptorStride(type)));
    std::memcpy(packed, descriptors.ptr(row), static_cast<std::size_t>(DescriptorBytes(type)));
    return;
  }
  PackRootSift(descriptors.ptr<float>(row), packed);
}

Vec2 PixelOf(DescriptorType type, const cv::KeyPoint& keypoint) {
  // SIFT doubles the image with its corners aligned but halves coordinates about pixel centres: a
  // quarter pixel is left over (until OpenCV 4.8 made it an option). ORB scales coordinates of each
  // pyramid level about the top-left pixel's centre.
  double shift = 0.0;
  if (type == DescriptorType::kSift) shift = -0.25;
  if (type == DescriptorType::kOrb)
    shift = 0.5 * (std::pow(static_cast<double>(kOrbScale), keypoint.octave) - 1.0);
  return Vec2(keypoint.pt.x, keypoint.pt.y) + Vec2::Constant(shift + 0.5);
}

void SampleColour(const ImageView& image, Feature* feature) {
  const int x = std::clamp(static_cast<int>(feature->x_px), 0, image.width - 1);
  const int y = std::clamp(static_cast<int>(feature->y_px), 0, image.height - 1);
  const std::uint8_t* pixel =
      image.data + static_cast<std::ptrdiff_t>(y) * image.stride_bytes + x * image.channels;
  const bool colour = image.channels == 3;
  feature->b = pixel[0];
  feature->g = pixel[colour ? 1 : 0];
  feature->r = pixel[colour ? 2 : 0];
}

}  // namespace rsfm
