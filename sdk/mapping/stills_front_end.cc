// Every image searched and described on its own.
#include <algorithm>
#include <opencv2/features2d.hpp>
#include <tuple>
#include <vector>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/mapping/front_end_image.h"

namespace rsfm {
namespace {

class StillsFrontEnd final : public FrontEnd {
 public:
  StillsFrontEnd(const MapperOptions& options, int width_px, int height_px)
      : options_(options),
        grey_(options, width_px, height_px),
        detector_(MakeFeature2D(options.descriptor, options.max_features)),
        features_(static_cast<std::size_t>(options.max_features)),
        descriptors_(static_cast<std::size_t>(options.max_features) *
                     static_cast<std::size_t>(DescriptorStride(options.descriptor))) {
    descriptors_.TryResize(descriptors_.capacity());
  }

  Expected<FrameObservations> Process(const ImageView& image, Utime utime,
                                      const FrameHints& /*hints*/) override try {
    if (const Status status = grey_.Take(image); !status) return tl::unexpected(status.error());
    // OpenCV takes no const data; it only reads.
    const cv::Mat grey(grey_.height_px(), grey_.width_px(), CV_8UC1, grey_.data());
    const cv::Mat mask(grey_.height_px(), grey_.width_px(), CV_8UC1,
                       const_cast<std::uint8_t*>(grey_.mask().data()));
    detector_->detectAndCompute(grey, mask, keypoints_, cv_descriptors_);
    SelectStrongest();
    for (std::size_t i = 0; i < order_.size(); ++i) {
      const cv::KeyPoint& keypoint = keypoints_[order_[i]];
      const Vec2 pixel = PixelOf(options_.descriptor, keypoint);
      Feature feature{static_cast<float>(pixel.x()), static_cast<float>(pixel.y()), keypoint.size};
      SampleColour(image, &feature);
      features_.TryPushBack(feature);
      PackDescriptor(options_.descriptor, cv_descriptors_, order_[i],
                     descriptors_.data() +
                         i * static_cast<std::size_t>(DescriptorStride(options_.descriptor)));
    }
    return FrameObservations{
        utime,
        features_.span(),
        {descriptors_.data(), static_cast<int>(features_.size()), options_.descriptor}};
  } catch (const cv::Exception&) {
    return Fail(Errc::kUnsupported, "image");
  }

  std::size_t bytes() const override {
    return features_.bytes() + descriptors_.bytes() + grey_.bytes();
  }

 private:
  // The strongest, strongest first, in an order that does not depend on the detector's.
  void SelectStrongest() {
    features_.clear();
    order_.resize(keypoints_.size());
    for (std::size_t i = 0; i < order_.size(); ++i) order_[i] = static_cast<int>(i);
    const auto key = [&](int i) {
      const cv::KeyPoint& k = keypoints_[i];
      return std::make_tuple(-k.response, k.pt.y, k.pt.x, k.size, k.angle);
    };
    std::sort(order_.begin(), order_.end(), [&](int a, int b) { return key(a) < key(b); });
    if (order_.size() > features_.capacity()) order_.resize(features_.capacity());
  }

  MapperOptions options_;
  GreyImage grey_;
  std::shared_ptr<cv::Feature2D> detector_;
  cv::Mat cv_descriptors_;
  std::vector<cv::KeyPoint> keypoints_;
  std::vector<int> order_;
  FixedVector<Feature> features_;
  FixedVector<std::uint8_t> descriptors_;
};

}  // namespace

std::unique_ptr<FrontEnd> MakeStillsFrontEnd(const MapperOptions& options, int width_px,
                                             int height_px) {
  return std::make_unique<StillsFrontEnd>(options, width_px, height_px);
}

}  // namespace rsfm
