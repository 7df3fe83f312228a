// What both front ends share. Private to the layer; names OpenCV's types without including it.
#pragma once

#include <memory>
#include <vector>

#include "rsfm/base/error.h"
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

// Grey, contrast-limited equalised where contrast_limit > 0. Errors as FrontEnd::Process.
Status PrepareGrey(const ImageView& image, int width_px, int height_px, double contrast_limit,
                   cv::Mat* grey);

// 255 where features may lie, 0 inside the rectangles.
void DrawMask(const ImageMask& mask, int width_px, int height_px, cv::Mat* drawn);

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
