// Points tracked from image to image; at keyframes, sought afresh where there are few, and
// described.
#include <algorithm>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <utility>
#include <vector>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/mapping/corner_detector.h"
#include "rsfm/mapping/front_end_image.h"
#include "rsfm/mapping/motion_check.h"
#include "rsfm/mapping/patch_describer.h"
#include "rsfm/mapping/point_tracker.h"

namespace rsfm {
namespace {

constexpr float kMinCornerQuality = 0.005f;   // of the strongest corner in the image
constexpr float kMinCorner = 0.5f;            // (grey / px)^2: twice what the noise of 8 bits makes
constexpr float kPatchSize = 31.0f;           // px, of the description
constexpr int kCandidatesPerShare = 4;        // corners of a cell that its share is chosen from
constexpr int kMaxSpots = 512;                // where something is fixed to the camera
constexpr std::size_t kPlentyOfPoints = 100;  // with so many a pose can do without descriptors
constexpr int kSpotKeyframes = 50;            // so long nothing is sought there

// At most this many points are followed.
int MaxPoints(const MapperOptions& options) {
  return std::min(options.max_tracks, options.max_features);
}

std::size_t Count(int value) { return static_cast<std::size_t>(value); }

class VideoFrontEnd final : public FrontEnd {
 public:
  VideoFrontEnd(const MapperOptions& options, int width_px, int height_px)
      : options_(options),
        width_px_(width_px),
        height_px_(height_px),
        columns_((width_px + options.grid_cell_px - 1) / options.grid_cell_px),
        rows_((height_px + options.grid_cell_px - 1) / options.grid_cell_px),
        share_(std::max(1, MaxPoints(options) / (columns_ * rows_))),
        grey_(options, width_px, height_px),
        tracker_(options, width_px, height_px, MaxPoints(options)),
        motion_check_(MaxPoints(options)),
        verdicts_(Count(MaxPoints(options))),
        spots_(kMaxSpots),
        detector_(std::min(options.grid_cell_px, width_px)),
        free_(Count(width_px) * Count(height_px)),
        corners_(Count(columns_ * rows_) * Count(kCandidatesPerShare * share_)),
        counts_(Count(columns_ * rows_)),
        motions_(Count(MaxPoints(options))),
        descriptor_(options.descriptor == DescriptorType::kSift
                        ? nullptr
                        : MakeFeature2D(options.descriptor, options.max_features)),
        features_(Count(MaxPoints(options))),
        descriptors_(Count(MaxPoints(options)) * Count(DescriptorStride(options.descriptor))) {
    free_.TryResize(free_.capacity());
    counts_.TryResize(counts_.capacity());
    descriptors_.TryResize(descriptors_.capacity());
  }

  Expected<FrameObservations> Process(const ImageView& image, Utime utime,
                                      const FrameHints& hints) override try {
    if (const Status status = grey_.Take(image); !status) return tl::unexpected(status.error());
    const std::size_t num_before = tracker_.points().size();
    tracker_.Follow(grey_.data(), width_px_, hints.expected_px);
    counters_.lost += static_cast<std::int64_t>(num_before - tracker_.points().size());
    DropMasked();
    DropClutter();
    ++frames_since_keyframe_;
    ++num_frames_;
    to_be_described_ = {};
    if (hints.want_descriptors || NeedsKeyframe()) {
      if (!hints.may_describe_later || hints.want_descriptors ||
          tracker_.points().size() < kPlentyOfPoints)
        return DescribedFrame(image, utime);
      to_be_described_ = {image, utime};
    }
    Emit(image);
    return FrameObservations{utime, features_.span(), {nullptr, 0, options_.descriptor}};
  } catch (const cv::Exception&) {
    return Refused();
  }

  Expected<std::optional<FrameObservations>> Describe() override try {
    const Later later = std::exchange(to_be_described_, {});
    if (later.image.data == nullptr) return std::nullopt;
    return DescribedFrame(later.image, later.utime);
  } catch (const cv::Exception&) {
    return Refused();
  }

  FrontEndCounters counters() const override { return counters_; }

  std::size_t bytes() const override {
    return motion_check_.bytes() + describer_.bytes() + verdicts_.bytes() + spots_.bytes() +
           grey_.bytes() + tracker_.bytes() + detector_.bytes() + free_.bytes() + corners_.bytes() +
           counts_.bytes() + motions_.bytes() + features_.bytes() + descriptors_.bytes();
  }

 private:
  struct Later {
    ImageView image;
    Utime utime = 0;
  };

  FrameObservations DescribedFrame(const ImageView& image, Utime utime) {
    SeekPoints();
    Emit(image);
    DescribePoints();
    return {utime,
            features_.span(),
            {descriptors_.data(), static_cast<int>(features_.size()), options_.descriptor}};
  }
  tl::unexpected<Error> Refused() {
    tracker_.Clear();
    return Fail(Errc::kUnsupported, "image");
  }

  struct Spot {
    PatchPlace place;
    int keyframe = 0;  // at which it was found
  };

  bool IsFree(const FixedVector<std::uint8_t>& mask, const PatchPlace& place) const {
    const auto x = static_cast<int>(std::lround(place.x)),
               y = static_cast<int>(std::lround(place.y));
    return x >= 0 && y >= 0 && x < width_px_ && y < height_px_ &&
           mask[Count(y) * Count(width_px_) + Count(x)] != 0;
  }

  void DropMasked() {
    FixedVector<TrackedPoint>& points = tracker_.points();
    std::size_t kept = 0;
    for (const TrackedPoint& point : points) {
      if (IsFree(grey_.mask(), point.place)) points[kept++] = point;
    }
    points.TryResize(kept);
  }

  // What does not move with the scene. Where something is fixed to the camera nothing is sought for
  // some time.
  void DropClutter() {
    FixedVector<TrackedPoint>& points = tracker_.points();
    verdicts_.TryResize(points.size());
    motion_check_.Judge(points.span(), options_.seed + num_frames_, verdicts_.span());
    std::size_t kept = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      switch (verdicts_[i]) {
        case PointVerdict::kScene:
          points[kept++] = points[i];
          break;
        case PointVerdict::kStationary:
          ++counters_.stationary;
          if (spots_.full()) spots_.SwapRemove(0);
          spots_.TryPushBack({points[i].place, num_keyframes_});
          break;
        case PointVerdict::kDrifting:
          ++counters_.drifting;
          break;
      }
    }
    points.TryResize(kept);
  }

  bool NeedsKeyframe() {
    const FixedVector<TrackedPoint>& points = tracker_.points();
    if (static_cast<double>(points.size()) <
            options_.keyframe_min_tracked * static_cast<double>(points_at_keyframe_) ||
        frames_since_keyframe_ >= options_.keyframe_max_frames || points.empty())
      return true;
    motions_.clear();
    for (const TrackedPoint& point : points)
      motions_.TryPushBack(
          std::hypot(point.place.x - point.at_keyframe.x, point.place.y - point.at_keyframe.y));
    float* middle = motions_.data() + motions_.size() / 2;
    std::nth_element(motions_.begin(), middle, motions_.end());
    return *middle > options_.keyframe_motion * width_px_;
  }

  int CellOf(const PatchPlace& place) const {
    const int column =
        std::clamp(static_cast<int>(place.x) / options_.grid_cell_px, 0, columns_ - 1);
    const int row = std::clamp(static_cast<int>(place.y) / options_.grid_cell_px, 0, rows_ - 1);
    return row * columns_ + column;
  }

  // No new point within this disc.
  void Occupy(const PatchPlace& place, double radius_px) {
    const int top = std::max(0, static_cast<int>(std::ceil(place.y - radius_px)));
    const int bottom = std::min(height_px_ - 1, static_cast<int>(place.y + radius_px));
    for (int y = top; y <= bottom; ++y) {
      const double dy = y - static_cast<double>(place.y);
      const double half = std::sqrt(std::max(0.0, radius_px * radius_px - dy * dy));
      const int left = std::clamp(static_cast<int>(std::ceil(place.x - half)), 0, width_px_);
      const int right = std::clamp(static_cast<int>(place.x + half) + 1, left, width_px_);
      std::uint8_t* row = free_.data() + static_cast<std::ptrdiff_t>(y) * width_px_;
      std::fill(row + left, row + right, std::uint8_t{0});
    }
  }

  // Corners of the cells that lack points, strongest first, until each cell has its share.
  void SeekPoints() {
    const double spacing_px =
        options_.grid_cell_px / (2.0 * std::sqrt(static_cast<double>(share_)));
    std::fill(counts_.begin(), counts_.end(), 0);
    std::copy(grey_.mask().begin(), grey_.mask().end(), free_.begin());
    for (const TrackedPoint& point : tracker_.points()) {
      ++counts_[Count(CellOf(point.place))];
      Occupy(point.place, spacing_px);
    }
    for (std::size_t i = spots_.size(); i-- > 0;) {
      if (num_keyframes_ - spots_[i].keyframe > kSpotKeyframes) {
        spots_.SwapRemove(i);
      } else {
        Occupy(spots_[i].place, std::max(spacing_px, 0.5 * options_.track_window_px));
      }
    }
    ++num_keyframes_;
    CollectCorners();
    const float quality = corners_.empty() ? 0.0f : kMinCornerQuality * corners_[0].score;
    for (const Corner& corner : corners_) {
      const PatchPlace place{corner.x, corner.y};
      int& count = counts_[Count(CellOf(place))];
      if (corner.score < quality) break;
      if (count >= share_ || !IsFree(free_, place)) continue;
      if (!tracker_.Add(place)) break;
      ++count;
      Occupy(place, spacing_px);
    }
    for (TrackedPoint& point : tracker_.points()) point.at_keyframe = point.place;
    points_at_keyframe_ = tracker_.points().size();
    frames_since_keyframe_ = 0;
  }

  void CollectCorners() {
    corners_.clear();
    for (int cell = 0; cell < columns_ * rows_; ++cell) {
      if (counts_[Count(cell)] >= share_) continue;
      const int left = cell % columns_ * options_.grid_cell_px;
      const int top = cell / columns_ * options_.grid_cell_px;
      const ImagePart part{left, top, std::min(left + options_.grid_cell_px, width_px_),
                           std::min(top + options_.grid_cell_px, height_px_)};
      const std::size_t used = corners_.size();
      corners_.TryResize(used + Count(kCandidatesPerShare * share_));
      const int found = detector_.Detect(tracker_.image().level(0), part, kMinCorner,
                                         corners_.span().subspan(used));
      corners_.TryResize(used + Count(found));
    }
    std::sort(corners_.begin(), corners_.end(), [](const Corner& a, const Corner& b) {
      return a.score != b.score ? a.score > b.score : a.y != b.y ? a.y < b.y : a.x < b.x;
    });
  }

  void Emit(const ImageView& image) {
    features_.clear();
    for (const TrackedPoint& point : tracker_.points()) {
      Feature feature{point.place.x + 0.5f, point.place.y + 0.5f, kPatchSize, point.track};
      SampleColour(image, &feature);
      features_.TryPushBack(feature);
    }
  }

  // Direction of the patch's intensity centroid [Rosin 1999, CVIU; Rublee 2011, ICCV], degrees.
  float Orientation(const PatchPlace& place) const {
    constexpr int kRadius = 15;
    const int cx = static_cast<int>(std::lround(place.x)),
              cy = static_cast<int>(std::lround(place.y));
    double mx = 0.0, my = 0.0;
    for (int dy = -kRadius; dy <= kRadius; ++dy) {
      for (int dx = -kRadius; dx <= kRadius; ++dx) {
        const int x = cx + dx, y = cy + dy;
        const bool outside = x < 0 || y < 0 || x >= width_px_ || y >= height_px_;
        if (outside || dx * dx + dy * dy > kRadius * kRadius) continue;
        const double value = grey_.data()[y * width_px_ + x];
        mx += dx * value;
        my += dy * value;
      }
    }
    return cv::fastAtan2(static_cast<float>(my), static_cast<float>(mx));
  }

  void DescribePoints() {
    const std::size_t stride = Count(DescriptorStride(options_.descriptor));
    if (options_.descriptor != DescriptorType::kSift) return DescribeByOpenCv(stride);
    const FixedVector<TrackedPoint>& points = tracker_.points();
    for (std::size_t i = 0; i < points.size(); ++i)
      describer_.Describe(tracker_.image().level(0), points[i].place,
                          descriptors_.data() + i * stride);
  }

  // Points too near to the border for a description get zeros, which match nothing.
  void DescribeByOpenCv(std::size_t stride) {
    keypoints_.clear();
    const FixedVector<TrackedPoint>& points = tracker_.points();
    for (std::size_t i = 0; i < points.size(); ++i) {
      cv::KeyPoint keypoint(points[i].place.x, points[i].place.y, kPatchSize,
                            Orientation(points[i].place));
      keypoint.class_id = static_cast<int>(i);
      keypoint.octave = 0;
      if (options_.descriptor == DescriptorType::kAkaze) {
        keypoint.class_id = 0;
        keypoint.response = static_cast<float>(i);
      }
      keypoints_.push_back(keypoint);
    }
    std::fill(descriptors_.begin(), descriptors_.end(), std::uint8_t{0});
    if (keypoints_.empty()) return;
    descriptor_->compute(cv::Mat(height_px_, width_px_, CV_8UC1, grey_.data()), keypoints_,
                         cv_descriptors_);
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
  int share_;  // of the points, for each cell of the grid
  GreyImage grey_;
  PointTracker tracker_;
  MotionCheck motion_check_;
  FixedVector<PointVerdict> verdicts_;
  FixedVector<Spot> spots_;
  FrontEndCounters counters_;
  Later to_be_described_;
  std::uint64_t num_frames_ = 0;
  int num_keyframes_ = 0;
  CornerDetector detector_;
  FixedVector<std::uint8_t> free_;  // where a new point may be
  FixedVector<Corner> corners_;
  FixedVector<int> counts_;  // of the points in each cell
  FixedVector<float> motions_;
  PatchDescriber describer_;                   // SIFT
  std::shared_ptr<cv::Feature2D> descriptor_;  // any other
  cv::Mat cv_descriptors_;
  std::vector<cv::KeyPoint> keypoints_;
  std::size_t points_at_keyframe_ = 0;
  int frames_since_keyframe_ = 0;
  FixedVector<Feature> features_;
  FixedVector<std::uint8_t> descriptors_;
};

}  // namespace

std::unique_ptr<FrontEnd> MakeVideoFrontEnd(const MapperOptions& options, int width_px,
                                            int height_px) {
  return std::make_unique<VideoFrontEnd>(options, width_px, height_px);
}

}  // namespace rsfm
