// Every image searched and described on its own.
#include <algorithm>
#include <opencv2/features2d.hpp>
#include <tuple>
#include <vector>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/mapping/front_end_image.h"
#include "rsfm/mapping/image_pyramid.h"

namespace rsfm {
namespace {

// The image that the detector sees. OpenCV's SIFT always doubles it first: where the search is to
// begin with the image as it is, it gets every second pixel of the smoothed one, whose doubling is
// as smooth as what the search begins with in any case.
class DetectorImage {
 public:
  DetectorImage(const MapperOptions& options, const GreyImage& grey)
      : can_halve_(options.descriptor == DescriptorType::kSift && options.sift_first_octave == 0) {
    if (!can_halve_) return;
    pyramid_ = ImagePyramid(grey.width_px(), grey.height_px(), 2, 2);
    const PyramidLevel& half = pyramid_.level(pyramid_.num_levels() - 1);
    can_halve_ = pyramid_.num_levels() == 2;
    mask_ = FixedVector<std::uint8_t>(static_cast<std::size_t>(half.width) *
                                      static_cast<std::size_t>(half.height));
    for (int y = 0; y < half.height; ++y)
      for (int x = 0; x < half.width; ++x)
        mask_.TryPushBack(grey.mask()[static_cast<std::size_t>(2 * y * grey.width_px() + 2 * x)]);
  }

  bool can_halve() const { return can_halve_; }
  // What the others speak of from now on.
  void Halve(bool is_halved) { is_halved_ = is_halved; }

  // OpenCV takes no const data; it only reads.
  cv::Mat Pixels(const GreyImage& grey) {
    if (!is_halved_) return {grey.height_px(), grey.width_px(), CV_8UC1, Writable(grey.data())};
    pyramid_.Build(grey.data(), grey.width_px());
    const PyramidLevel& half = pyramid_.level(1);
    return {half.height, half.width, CV_8UC1, Writable(half.origin),
            static_cast<std::size_t>(half.stride_bytes)};
  }
  cv::Mat Mask(const GreyImage& grey) const {
    if (!is_halved_)
      return {grey.height_px(), grey.width_px(), CV_8UC1, Writable(grey.mask().data())};
    const PyramidLevel& half = pyramid_.level(1);
    return {half.height, half.width, CV_8UC1, Writable(mask_.data())};
  }

  // In the whole image; both put coordinates at pixels' centres, and each second pixel was kept.
  double scale() const { return is_halved_ ? 2.0 : 1.0; }

  std::size_t bytes() const { return pyramid_.bytes() + mask_.bytes(); }

 private:
  static std::uint8_t* Writable(const std::uint8_t* data) {
    return const_cast<std::uint8_t*>(data);
  }

  bool can_halve_, is_halved_ = false;
  ImagePyramid pyramid_;
  FixedVector<std::uint8_t> mask_;
};

class StillsFrontEnd final : public FrontEnd {
 public:
  StillsFrontEnd(const MapperOptions& options, int width_px, int height_px)
      : options_(options),
        grey_(options, width_px, height_px),
        seen_(options, grey_),
        detector_(MakeFeature2D(options.descriptor, options.max_features)),
        features_(static_cast<std::size_t>(options.max_features)),
        descriptors_(static_cast<std::size_t>(options.max_features) *
                     static_cast<std::size_t>(DescriptorStride(options.descriptor))) {
    descriptors_.TryResize(descriptors_.capacity());
  }

  Expected<FrameObservations> Process(const ImageView& image, Utime utime,
                                      const FrameHints& /*hints*/) override try {
    if (const Status status = grey_.Take(image); !status) return tl::unexpected(status.error());
    Detect(seen_.can_halve());
    const bool is_poor = static_cast<int>(keypoints_.size()) < options_.max_features * 3 / 4;
    if (seen_.can_halve() && is_poor) Detect(false);
    SelectStrongest();
    for (std::size_t i = 0; i < order_.size(); ++i) {
      const cv::KeyPoint& keypoint = keypoints_[order_[i]];
      // Pixels' centres are whole numbers where the scales meet.
      const Vec2 half = Vec2::Constant(0.5);
      const Vec2 pixel = seen_.scale() * (PixelOf(options_.descriptor, keypoint) - half) + half;
      Feature feature{static_cast<float>(pixel.x()), static_cast<float>(pixel.y()),
                      static_cast<float>(seen_.scale()) * keypoint.size};
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
    return features_.bytes() + descriptors_.bytes() + grey_.bytes() + seen_.bytes();
  }

 private:
  void Detect(bool is_halved) {
    seen_.Halve(is_halved);
    detector_->detectAndCompute(seen_.Pixels(grey_), seen_.Mask(grey_), keypoints_,
                                cv_descriptors_);
  }

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
  DetectorImage seen_;
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
