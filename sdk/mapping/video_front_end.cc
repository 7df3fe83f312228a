// Points tracked from image to image; at keyframes, sought afresh where there are few, and
// described.
#include <algorithm>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <tuple>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/mapping/front_end_image.h"

namespace rsfm {
namespace {

constexpr int kPyramidLevels = 4;
constexpr double kMinCornerQuality = 0.005;  // of the strongest corner in the image
constexpr float kPatchSize = 31.0f;          // px, of the description

class VideoFrontEnd final : public FrontEnd {
 public:
  VideoFrontEnd(const MapperOptions& options, int width_px, int height_px)
      : options_(options),
        width_px_(width_px),
        height_px_(height_px),
        columns_((width_px + options.grid_cell_px - 1) / options.grid_cell_px),
        rows_((height_px + options.grid_cell_px - 1) / options.grid_cell_px),
        descriptor_(MakeFeature2D(options.descriptor, options.max_features)),
        features_(static_cast<std::size_t>(options.max_features)),
        descriptors_(static_cast<std::size_t>(options.max_features) *
                     static_cast<std::size_t>(DescriptorStride(options.descriptor))) {
    DrawMask(options.mask, width_px, height_px, &mask_);
    descriptors_.TryResize(descriptors_.capacity());
  }

  Expected<FrameObservations> Process(const ImageView& image, Utime utime,
                                      bool want_descriptors) override try {
    const Status status =
        PrepareGrey(image, width_px_, height_px_, options_.contrast_limit, &grey_);
    if (!status) return tl::unexpected(status.error());
    cv::buildOpticalFlowPyramid(grey_, pyramid_, Window(), kPyramidLevels);
    Track();
    ++frames_since_keyframe_;
    const bool is_keyframe = want_descriptors || NeedsKeyframe();
    if (is_keyframe) SeekPoints();
    std::swap(pyramid_, last_pyramid_);
    Emit(image);
    DescriptorView described{nullptr, 0, options_.descriptor};
    if (is_keyframe) {
      Describe();
      described = {descriptors_.data(), static_cast<int>(features_.size()), options_.descriptor};
    }
    return FrameObservations{utime, features_.span(), described};
  } catch (const cv::Exception&) {
    points_.clear();
    last_pyramid_.clear();
    return Fail(Errc::kUnsupported, "image");
  }

  std::size_t bytes() const override {
    return features_.bytes() + descriptors_.bytes() + mask_.total() + 3 * grey_.total();
  }

 private:
  struct Point {
    cv::Point2f place, at_keyframe;
    std::uint32_t track = kNoTrack;
  };

  cv::Size Window() const { return {options_.track_window_px, options_.track_window_px}; }

  // Forward, and back again: what does not return is dropped. [Kalal 2010, ICPR]
  void Track() {
    if (points_.empty() || last_pyramid_.empty()) {
      points_.clear();
      return;
    }
    from_.clear();
    for (const Point& point : points_) from_.push_back(point.place);
    const cv::TermCriteria stop(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 20, 0.01);
    cv::calcOpticalFlowPyrLK(last_pyramid_, pyramid_, from_, to_, status_, errors_, Window(),
                             kPyramidLevels, stop);
    cv::calcOpticalFlowPyrLK(pyramid_, last_pyramid_, to_, back_, status_back_, errors_, Window(),
                             kPyramidLevels, stop);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const cv::Point2f miss = back_[i] - from_[i];
      const bool returns =
          status_[i] && status_back_[i] &&
          std::hypot(miss.x, miss.y) <= static_cast<float>(options_.track_check_px);
      if (!returns || !IsAllowed(to_[i])) continue;
      points_[kept] = points_[i];
      points_[kept++].place = to_[i];
    }
    points_.resize(kept);
  }

  bool IsAllowed(const cv::Point2f& place) const {
    const int x = static_cast<int>(std::lround(place.x)),
              y = static_cast<int>(std::lround(place.y));
    return x >= 0 && y >= 0 && x < width_px_ && y < height_px_ && mask_.at<std::uint8_t>(y, x) != 0;
  }

  bool NeedsKeyframe() {
    if (static_cast<double>(points_.size()) <
            options_.keyframe_min_tracked * static_cast<double>(points_at_keyframe_) ||
        frames_since_keyframe_ >= options_.keyframe_max_frames || points_.empty())
      return true;
    motions_.clear();
    for (const Point& point : points_) {
      const cv::Point2f motion = point.place - point.at_keyframe;
      motions_.push_back(std::hypot(motion.x, motion.y));
    }
    const auto middle = motions_.begin() + static_cast<std::ptrdiff_t>(motions_.size() / 2);
    std::nth_element(motions_.begin(), middle, motions_.end());
    return *middle > options_.keyframe_motion * width_px_;
  }

  int CellOf(const cv::Point2f& place) const {
    const int column = std::min(static_cast<int>(place.x) / options_.grid_cell_px, columns_ - 1);
    const int row = std::min(static_cast<int>(place.y) / options_.grid_cell_px, rows_ - 1);
    return row * columns_ + column;
  }

  // Corners [Shi & Tomasi 1994, CVPR], strongest first, until each cell has its share.
  void SeekPoints() {
    const int num_cells = columns_ * rows_;
    const int share = std::max(1, options_.max_features / num_cells);
    const double spacing_px = options_.grid_cell_px / (2.0 * std::sqrt(static_cast<double>(share)));
    counts_.assign(static_cast<std::size_t>(num_cells), 0);
    mask_.copyTo(free_);
    for (const Point& point : points_) {
      ++counts_[static_cast<std::size_t>(CellOf(point.place))];
      cv::circle(free_, point.place, static_cast<int>(spacing_px), cv::Scalar(0), cv::FILLED);
    }
    cv::goodFeaturesToTrack(grey_, corners_, 4 * options_.max_features, kMinCornerQuality,
                            spacing_px, free_);
    for (const cv::Point2f& corner : corners_) {
      if (points_.size() >= features_.capacity()) break;
      int& count = counts_[static_cast<std::size_t>(CellOf(corner))];
      if (count >= share) continue;
      ++count;
      points_.push_back({corner, corner, next_track_++});
    }
    for (Point& point : points_) point.at_keyframe = point.place;
    points_at_keyframe_ = points_.size();
    frames_since_keyframe_ = 0;
  }

  // OpenCV's integer pixel is the centre of that pixel.
  void Emit(const ImageView& image) {
    features_.clear();
    for (const Point& point : points_) {
      Feature feature{point.place.x + 0.5f, point.place.y + 0.5f, kPatchSize, point.track};
      SampleColour(image, &feature);
      features_.TryPushBack(feature);
    }
  }

  // Direction of the patch's intensity centroid [Rosin 1999, CVIU; Rublee 2011, ICCV], degrees.
  float Orientation(const cv::Point2f& place) const {
    constexpr int kRadius = 15;
    const int cx = static_cast<int>(std::lround(place.x)),
              cy = static_cast<int>(std::lround(place.y));
    double mx = 0.0, my = 0.0;
    for (int dy = -kRadius; dy <= kRadius; ++dy) {
      for (int dx = -kRadius; dx <= kRadius; ++dx) {
        const int x = cx + dx, y = cy + dy;
        const bool outside = x < 0 || y < 0 || x >= width_px_ || y >= height_px_;
        if (outside || dx * dx + dy * dy > kRadius * kRadius) continue;
        const double value = grey_.at<std::uint8_t>(y, x);
        mx += dx * value;
        my += dy * value;
      }
    }
    return cv::fastAtan2(static_cast<float>(my), static_cast<float>(mx));
  }

  // Points too near to the border for a description get zeros, which match nothing.
  void Describe() {
    keypoints_.clear();
    for (std::size_t i = 0; i < points_.size(); ++i) {
      cv::KeyPoint keypoint(points_[i].place, kPatchSize, Orientation(points_[i].place));
      keypoint.class_id = static_cast<int>(i);
      if (options_.descriptor == DescriptorType::kSift) {
        keypoint.octave = 1 << 8;  // OpenCV's packing of octave 0, layer 1 ...
        keypoint.size = 4.0f;      // ... and the scale that belongs to it
      } else {
        keypoint.octave = 0;
      }
      if (options_.descriptor == DescriptorType::kAkaze) keypoint.class_id = 0;
      keypoints_.push_back(keypoint);
    }
    if (options_.descriptor == DescriptorType::kAkaze) {
      for (std::size_t i = 0; i < keypoints_.size(); ++i)
        keypoints_[i].response = static_cast<float>(i);
    }
    std::fill(descriptors_.begin(), descriptors_.end(), std::uint8_t{0});
    if (keypoints_.empty()) return;
    descriptor_->compute(grey_, keypoints_, cv_descriptors_);
    const auto stride = static_cast<std::size_t>(DescriptorStride(options_.descriptor));
    for (std::size_t k = 0; k < keypoints_.size(); ++k) {
      const auto i = static_cast<std::size_t>(options_.descriptor == DescriptorType::kAkaze
                                                  ? std::lround(keypoints_[k].response)
                                                  : keypoints_[k].class_id);
      PackDescriptor(options_.descriptor, cv_descriptors_, static_cast<int>(k),
                     descriptors_.data() + i * stride);
    }
  }

  MapperOptions options_;
  int width_px_, height_px_, columns_, rows_;
  std::shared_ptr<cv::Feature2D> descriptor_;
  cv::Mat grey_, mask_, free_, cv_descriptors_;
  std::vector<cv::Mat> pyramid_, last_pyramid_;
  std::vector<Point> points_;  // in ascending order of track
  std::vector<cv::Point2f> from_, to_, back_, corners_;
  std::vector<std::uint8_t> status_, status_back_;
  std::vector<float> errors_, motions_;
  std::vector<int> counts_;
  std::vector<cv::KeyPoint> keypoints_;
  std::size_t points_at_keyframe_ = 0;
  int frames_since_keyframe_ = 0;
  std::uint32_t next_track_ = 0;
  FixedVector<Feature> features_;
  FixedVector<std::uint8_t> descriptors_;
};

}  // namespace

std::unique_ptr<FrontEnd> MakeVideoFrontEnd(const MapperOptions& options, int width_px,
                                            int height_px) {
  return std::make_unique<VideoFrontEnd>(options, width_px, height_px);
}

}  // namespace rsfm
