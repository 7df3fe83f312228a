// What both front ends share. Private to the layer; names OpenCV's types without including it.
#pragma once

#include <memory>

#include "rsfm/base/error.h"
#include "rsfm/base/fixed_vector.h"
#include "rsfm/mapping/contrast.h"
#include "rsfm/mapping/front_end.h"

namespace cv {
class Feature2D;
class KeyPoint;
class Mat;
}  // namespace cv

namespace rsfm {

// A detector and descriptor of that type; contrast thresholds are half of OpenCV's defaults, since
// water takes contrast.
std::shared_ptr<cv::Feature2D> MakeFeature2D(DescriptorType type, int max_features);

// The grey image that both front ends work on, and the mask of what they leave out. Rows lie one
// after the other, width_px() bytes each. Fixed memory.
class GreyImage {
 public:
  // The only place that allocates.
  GreyImage(const MapperOptions& options, int width_px, int height_px);

  // Grey, its contrast equalised where the options say so. Errors as FrontEnd::Process; the image
  // is then as it was.
  Status Take(const ImageView& image) noexcept;

  int width_px() const { return width_; }
  int height_px() const { return height_; }
  std::uint8_t* data() { return pixels_.data(); }
  const std::uint8_t* data() const { return pixels_.data(); }
  // 255 where features may lie, 0 inside the rectangles.
  const FixedVector<std::uint8_t>& mask() const { return mask_; }
  std::size_t bytes() const { return pixels_.bytes() + mask_.bytes() + contrast_.bytes(); }

 private:
  int width_, height_;
  FixedVector<std::uint8_t> pixels_, mask_;
  ContrastEqualiser contrast_;
};

// One row of OpenCV's descriptors into DescriptorStride(type) bytes. SIFT becomes RootSIFT
// [Arandjelovic 2012, CVPR] of length 512, rounded to bytes.
void PackDescriptor(DescriptorType type, const cv::Mat& descriptors, int row, std::uint8_t* packed);

// OpenCV's position of a keypoint, corrected for what its pyramids leave out, in our pixels.
Vec2 PixelOf(DescriptorType type, const cv::KeyPoint& keypoint);

void SampleColour(const ImageView& image, Feature* feature);

std::unique_ptr<FrontEnd> MakeStillsFrontEnd(const MapperOptions& options, int width_px,
                                             int height_px);
std::unique_ptr<FrontEnd> MakeVideoFrontEnd(const MapperOptions& options, int width_px,
                                            int height_px);

}  // namespace rsfm
