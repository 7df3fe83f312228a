#include "rsfm/mapping/initialiser.h"

#include <Eigen/LU>
#include <algorithm>
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

}  // namespace

Initialiser::Initialiser(const MapperOptions& options, const AnyCamera& camera)
    : options_(options),
      camera_(camera),
      two_view_(static_cast<std::uint32_t>(options.max_features)),
      pixels_a_(static_cast<std::size_t>(options.max_features)),
      pixels_b_(static_cast<std::size_t>(options.max_features)) {}

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
    pixels_a_.clear();
    pixels_b_.clear();
    for (const DescriptorMatch& match : with.matches) {
      const auto query = static_cast<std::size_t>(match.query);
      const auto train = static_cast<std::size_t>(match.train);
      pixels_a_.TryPushBack(map.features(with.keyframe)[train].pixel());
      pixels_b_.TryPushBack(map.features(newer)[query].pixel());
    }
    TwoViewOptions options;
    options.ransac.max_error_px = options_.max_error_px;
    options.ransac.max_iterations = options_.ransac_iterations;
    options.ransac.seed = options_.seed;
    const auto motion = nav.Motion(map.keyframe(with.keyframe).utime, map.keyframe(newer).utime);
    const bool has_baseline =
        motion && motion->baseline_m() > 5.0 * std::max(motion->sigma_baseline_m(), 1e-4);
    if (has_baseline) {
      options.baseline_m = motion->baseline_m();
      options.sigma_baseline_m = std::max(motion->sigma_baseline_m(), 1e-4);
    }
    const auto report =
        two_view_.Estimate(camera_, camera_, pixels_a_.span(), pixels_b_.span(), options);
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

}  // namespace rsfm
