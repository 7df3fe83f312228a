#include "rsfm/mapping/initialiser.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace rsfm {
namespace {

// The inverse where the information is there, and a tenth of a baseline or a radian where it is
// not.
Mat6 BoundedCovariance(const Mat6& information, double baseline_m) {
  Mat6 regularised = information;
  const double weak = 1.0 / std::max(0.01 * baseline_m * baseline_m, 1e-12);
  for (int i = 0; i < 3; ++i) regularised(i, i) += 1.0;
  for (int i = 3; i < 6; ++i) regularised(i, i) += weak;
  return regularised.inverse();
}

// Navigation's displacement is worth something as a length.
bool IsLengthKnown(const CameraMotion& motion) {
  return motion.baseline_m() > 5.0 * std::max(motion.sigma_baseline_m(), 1e-4);
}

bool IsKnown(const NavSample& sample) {
  return sample.Has(NavField::kAttitude) &&
         (sample.Has(NavField::kVelocity) || sample.Has(NavField::kPosition));
}

// The older of two moments is from before navigation came, and the newer is not.
bool PrecedesNavigation(const NavAid& nav, Utime older, Utime newer) {
  return !IsKnown(nav.buffer().At(older)) && IsKnown(nav.buffer().At(newer));
}

}  // namespace

Initialiser::Initialiser(const MapperOptions& options, const AnyCamera& camera)
    : options_(options),
      camera_(camera),
      two_view_(static_cast<std::uint32_t>(options.max_features)),
      pixels_a_(static_cast<std::size_t>(options.max_features)),
      pixels_b_(static_cast<std::size_t>(options.max_features)),
      scales_(static_cast<std::size_t>(options.max_features)) {}

// Keyframe first, frame second.
Expected<TwoViewReport> Initialiser::Relate(const Map& map, std::span<const Feature> features,
                                            const KeyframeMatches& with,
                                            const CameraMotion* motion) noexcept {
  pixels_a_.clear();
  pixels_b_.clear();
  for (const DescriptorMatch& match : with.matches) {
    const auto query = static_cast<std::size_t>(match.query);
    const auto train = static_cast<std::size_t>(match.train);
    pixels_a_.TryPushBack(map.features(with.keyframe)[train].pixel());
    pixels_b_.TryPushBack(features[query].pixel());
  }
  TwoViewOptions options;
  options.ransac.max_error_px = options_.max_error_px;
  options.ransac.max_iterations = options_.ransac_iterations;
  options.ransac.seed = options_.seed;
  if (motion != nullptr) {
    options.baseline_m = motion->baseline_m();
    options.sigma_baseline_m = std::max(motion->sigma_baseline_m(), 1e-4);
  }
  return two_view_.Estimate(camera_, camera_, pixels_a_.span(), pixels_b_.span(), options);
}

Expected<InitialPair> Initialiser::FindPair(const Map& map, SlotId newer,
                                            std::span<const KeyframeMatches> matches,
                                            const NavAid& nav) noexcept {
  InitialPair best;
  Error error{Errc::kNotEnoughInliers, "inliers", 0};
  const double min_parallax_rad = options_.init_min_angle_deg * std::numbers::pi / 180.0;
  for (const KeyframeMatches& with : matches) {
    if (static_cast<int>(with.matches.size()) < options_.init_min_inliers) {
      error.detail = std::max(error.detail, static_cast<std::int32_t>(with.matches.size()));
      continue;
    }
    const Utime older_utime = map.keyframe(with.keyframe).utime;
    const Utime newer_utime = map.keyframe(newer).utime;
    // A map keeps the scale of its first pair. The next keyframe has navigation on both sides.
    if (PrecedesNavigation(nav, older_utime, newer_utime)) {
      error = {Errc::kNotEnoughData, "navigation", 0};
      continue;
    }
    const auto motion = nav.Motion(older_utime, newer_utime);
    const bool has_baseline = motion && IsLengthKnown(*motion);
    const auto report = Relate(map, map.features(newer), with, has_baseline ? &*motion : nullptr);
    if (!report) {
      if (report.error().code != Errc::kNotEnoughInliers) error = report.error();
      continue;
    }
    if (report->median_parallax_rad < min_parallax_rad) {
      error = {Errc::kDegenerate, "parallax", 0};
      continue;
    }
    if (report->num_inliers < std::max(options_.init_min_inliers, best.num_inliers + 1)) continue;
    best = {with.keyframe,    newer,
            report->b_from_a, BoundedCovariance(report->information, report->baseline_m),
            has_baseline,     report->num_inliers};
  }
  if (best.num_inliers == 0) return tl::unexpected(error);
  return best;
}

double Initialiser::ScaleFromLandmarks(const Map& map, const FrameView& frame,
                                       const KeyframeMatches& with,
                                       const Rigid3& frame_from_keyframe) noexcept {
  const Vec3 direction = frame_from_keyframe.translation.normalized();
  const Rigid3& keyframe_from_world = map.keyframe(with.keyframe).camera_from_world;
  const std::span<const SlotId> landmarks = map.landmarks_of(with.keyframe);
  scales_.clear();
  for (const DescriptorMatch& match : with.matches) {
    const Landmark* landmark =
        map.landmarks().Find(landmarks[static_cast<std::size_t>(match.train)]);
    Ray3 ray;
    if (landmark == nullptr ||
        camera_.Backproject(frame.features[static_cast<std::size_t>(match.query)].pixel(), &ray) !=
            Projection::kOk)
      continue;
    // (R X + s t) lies on the ray: s (t x d) = -(R X - o) x d, by least squares.
    const Vec3 turned =
        frame_from_keyframe.rotation * (keyframe_from_world * landmark->point_in_world);
    const Vec3 arm = direction.cross(ray.direction);
    if (arm.squaredNorm() < 1e-4) continue;  // seen along the motion: says nothing
    const double scale = -arm.dot((turned - ray.origin).cross(ray.direction)) / arm.squaredNorm();
    if (scale > 0.0) scales_.TryPushBack(scale);
  }
  constexpr std::size_t kMinAgreeing = 8;
  if (scales_.size() < kMinAgreeing) return 0.0;
  const auto middle = scales_.begin() + static_cast<std::ptrdiff_t>(scales_.size() / 2);
  std::nth_element(scales_.begin(), middle, scales_.end());
  const double median = *middle;
  const auto agreeing = std::count_if(scales_.begin(), scales_.end(), [&](double scale) {
    return std::abs(scale - median) < 0.2 * median;
  });
  const auto needed = std::max(kMinAgreeing, scales_.size() / 2);
  return static_cast<std::size_t>(agreeing) >= needed ? median : 0.0;
}

Expected<Placement> Initialiser::PlaceBeside(const Map& map, const FrameView& frame, Utime utime,
                                             std::span<const KeyframeMatches> matches,
                                             const NavAid& nav, bool scale_is_metric) noexcept {
  const KeyframeMatches* with = nullptr;
  for (const KeyframeMatches& candidate : matches) {
    if (!map.keyframe(candidate.keyframe).is_placed) continue;
    if (with == nullptr || candidate.matches.size() > with->matches.size()) with = &candidate;
  }
  if (with == nullptr || static_cast<int>(with->matches.size()) < options_.init_min_inliers)
    return Fail(Errc::kNotEnoughInliers, "matches");
  const Keyframe& keyframe = map.keyframe(with->keyframe);
  auto motion = nav.Motion(std::min(keyframe.utime, utime), std::max(keyframe.utime, utime));
  if (!scale_is_metric || (motion && !IsLengthKnown(*motion))) motion.reset();
  const auto report = Relate(map, frame.features, *with, motion ? &*motion : nullptr);
  if (!report) return tl::unexpected(report.error());
  if (report->num_inliers < options_.init_min_inliers)
    return Fail(Errc::kNotEnoughInliers, "inliers", report->num_inliers);

  Rigid3 frame_from_keyframe = report->b_from_a;
  double length = ScaleFromLandmarks(map, frame, *with, frame_from_keyframe);
  if (length == 0.0 && motion) length = report->baseline_m;
  if (length == 0.0) return Fail(Errc::kNotEnoughData, "scale");
  frame_from_keyframe.translation *= length / frame_from_keyframe.translation.norm();
  return Placement{frame_from_keyframe * keyframe.camera_from_world,
                   BoundedCovariance(report->information, length), report->num_inliers,
                   with->keyframe};
}

}  // namespace rsfm
