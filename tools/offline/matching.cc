#include "tools/offline/matching.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "rsfm/estimation/five_point.h"
#include "rsfm/refraction/best_fit.h"
#include "tools/offline/chance.h"
#include "tools/offline/descriptor_rows.h"
#include "tools/offline/parallel_progress.h"

namespace rsfm {
namespace {

constexpr double kOverlapMargin = 0.25;  // of the image's size: poses may have drifted

// The essential matrix from five refracted rays, seen from the two cameras' centres as if all they
// meet lay at one range: good enough to tell right matches from wrong ones, as only what refraction
// changes with the range is left out. The error is Sampson's, in pixels.   [Hartley & Zisserman,
// eq. (11.9)]
class EssentialProblem {
 public:
  static constexpr int kSampleSize = kFivePointSampleSize;
  using Model = Mat3;
  using Models = EssentialMatrices;

  EssentialProblem(std::vector<Vec3> a, std::vector<Vec3> b, double focal_px)
      : a_(std::move(a)), b_(std::move(b)), focal_px_(focal_px) {}

  int Size() const { return static_cast<int>(a_.size()); }
  void Solve(std::span<const int, kSampleSize> sample, Models* models) const {
    std::array<Vec3, kSampleSize> a, b;
    for (int i = 0; i < kSampleSize; ++i) {
      a[i] = a_[sample[i]];
      b[i] = b_[sample[i]];
    }
    for (const Mat3& e : SolveFivePoint(a, b)) models->TryPushBack(e);
  }
  double SquaredError(const Mat3& e, int i) const {
    const Vec3 line_b = e * a_[i], line_a = e.transpose() * b_[i];
    const double algebraic = focal_px_ * b_[i].dot(line_b);
    return algebraic * algebraic /
           (line_b.head<2>().squaredNorm() + line_a.head<2>().squaredNorm());
  }
  bool Refine(std::span<const int>, Mat3*) const { return false; }

 private:
  std::vector<Vec3> a_, b_;  // (x / z, y / z, 1)
  double focal_px_;
};

// The median range of what the placed images see; the paper's 5 m where there are none.
double NominalRange(const Scene& scene) {
  std::vector<double> ranges;
  for (const SceneImage& image : scene.images) {
    for (const std::int32_t point : image.points) {
      if (point != kNoPoint)
        ranges.push_back((image.camera_from_world * scene.points[point].xyz).norm());
    }
  }
  if (ranges.empty()) return 5.0;
  const auto middle = ranges.begin() + static_cast<std::ptrdiff_t>(ranges.size() / 2);
  std::nth_element(ranges.begin(), middle, ranges.end());
  return *middle;
}

// Matches and verifies one pair after another; one per thread.
class PairMatcher {
 public:
  PairMatcher(const Scene& scene, const std::vector<DescriptorRows>& descriptors,
              const MatchOptions& options, const NominalCamera& camera, int max_features)
      : scene_(scene),
        descriptors_(descriptors),
        options_(options),
        matcher_(max_features),
        matches_(max_features),
        verifier_(camera, options, max_features) {}

  std::optional<VerifiedPair> Match(const ImagePair& pair) {
    const SceneImage& a = scene_.images[pair.a];
    const SceneImage& b = scene_.images[pair.b];
    const DescriptorRows& in_a = descriptors_[pair.a];
    const DescriptorRows& in_b = descriptors_[pair.b];
    if (in_a.type != in_b.type || in_a.type == DescriptorType::kNone || a.features.empty() ||
        b.features.empty())
      return std::nullopt;
    if (pair.b - pair.a > options_.always_neighbours &&
        matcher_.Match(in_a.Preview(), in_b.Preview(), options_.max_ratio, matches_) <
            options_.preview_matches)
      return std::nullopt;
    const int count = matcher_.Match(in_a.All(), in_b.All(), options_.max_ratio, matches_);
    return verifier_.Verify(pair, a.features, b.features,
                            std::span(matches_).first(static_cast<std::size_t>(count)));
  }

 private:
  const Scene& scene_;
  const std::vector<DescriptorRows>& descriptors_;
  const MatchOptions& options_;
  DescriptorMatcher matcher_;
  std::vector<DescriptorMatch> matches_;
  PairVerifier verifier_;
};

// The motion that puts most of the matches in front of both cameras.
Rigid3 BestDecomposition(const Mat3& essential, const std::vector<Vec3>& a,
                         const std::vector<Vec3>& b, std::span<const int> inliers) {
  Rigid3 best;
  int best_count = -1;
  for (const Rigid3& candidate : DecomposeEssential(essential)) {
    int count = 0;
    for (const int i : inliers) count += IsInFront(candidate, a[i], b[i]) ? 1 : 0;
    if (count <= best_count) continue;
    best_count = count;
    best = candidate;
  }
  return best;
}

}  // namespace

double Overlap(const Scene& scene, const AnyCamera& camera, int a, int b) {
  int seen = 0, all = 0;
  const SceneImage& other = scene.images[b];
  const double margin_x = kOverlapMargin * camera.width(),
               margin_y = kOverlapMargin * camera.height();
  const std::vector<std::int32_t>& points = scene.images[a].points;
  for (std::size_t f = 0; f < points.size(); ++f) {
    if (points[f] == kNoPoint || ++all % 4 != 0) continue;  // every fourth is enough
    Vec2 pixel;
    if (camera.Project(other.camera_from_world * scene.points[points[f]].xyz, &pixel) !=
        Projection::kOk)
      continue;
    seen += pixel.x() > -margin_x && pixel.y() > -margin_y &&
            pixel.x() < camera.width() + margin_x && pixel.y() < camera.height() + margin_y;
  }
  return all < 8 ? 0.0 : 4.0 * seen / all;
}

Expected<NominalCamera> NominalCamera::Create(const CameraConfig& config, double range_m) {
  const Expected<AnyCamera> camera = AnyCamera::Create(config);
  if (!camera) return tl::unexpected<Error>(camera.error());
  const Expected<BestFitPerspective> best_fit = FitPerspective(*camera);
  if (!best_fit) return tl::unexpected<Error>(best_fit.error());
  return NominalCamera{*camera, range_m, 0.5 * (best_fit->fx + best_fit->fy)};
}

bool NominalCamera::Bearing(const Vec2& pixel, Vec3* bearing) const {
  Ray3 ray;
  if (camera.Backproject(pixel, &ray) != Projection::kOk) return false;
  const Vec3 point = ray.At(range_m);
  if (!(point.z() > 0.0)) return false;
  *bearing = point / point.z();
  return true;
}

PairVerifier::PairVerifier(const NominalCamera& camera, const MatchOptions& options,
                           int max_matches)
    : camera_(camera), options_(options), workspace_(static_cast<std::uint32_t>(max_matches)) {}

std::optional<VerifiedPair> PairVerifier::Verify(const ImagePair& pair,
                                                 std::span<const Vec2> features_a,
                                                 std::span<const Vec2> features_b,
                                                 std::span<const DescriptorMatch> matches) {
  std::vector<Vec3> bearings_a, bearings_b;
  std::vector<DescriptorMatch> usable;
  for (const DescriptorMatch& match : matches) {
    Vec3 bearing_a, bearing_b;
    if (!camera_.Bearing(features_a[match.query], &bearing_a) ||
        !camera_.Bearing(features_b[match.train], &bearing_b)) {
      continue;
    }
    bearings_a.push_back(bearing_a);
    bearings_b.push_back(bearing_b);
    usable.push_back(match);
  }
  if (static_cast<int>(usable.size()) < options_.min_inliers) return std::nullopt;
  EssentialProblem problem(bearings_a, bearings_b, camera_.focal_px);
  RansacOptions ransac;
  ransac.max_error_px = options_.max_error_px;
  ransac.max_iterations = 500;
  ransac.seed = options_.seed + 7919u * static_cast<std::uint64_t>(pair.a) + pair.b;
  Mat3 essential;
  const Expected<RansacReport> report = Ransac(problem, ransac, &workspace_, &essential);
  if (!report || report->num_inliers < options_.min_inliers ||
      report->num_inliers < options_.min_inlier_ratio * static_cast<double>(usable.size()))
    return std::nullopt;
  std::vector<MatchedPixels> pixels;
  std::vector<char> is_inlier(usable.size(), 0);
  for (const DescriptorMatch& match : usable)
    pixels.push_back({features_a[match.query], features_b[match.train]});
  for (const int i : workspace_.inliers) is_inlier[i] = 1;
  const CameraConfig& config = camera_.camera.config();
  if (LogFalseAlarms(pixels, is_inlier, options_.max_error_px, config.width, config.height) > 0.0)
    return std::nullopt;
  VerifiedPair result;
  result.images = pair;
  result.b_from_a = BestDecomposition(essential, bearings_a, bearings_b, workspace_.inliers.span());
  std::vector<double> angles;
  for (const int i : workspace_.inliers) {
    result.matches.emplace_back(usable[i].query, usable[i].train);
    const Vec3 turned = result.b_from_a.rotation * bearings_a[i];
    angles.push_back(std::atan2(turned.cross(bearings_b[i]).norm(), turned.dot(bearings_b[i])));
  }
  std::nth_element(angles.begin(), angles.begin() + angles.size() / 2, angles.end());
  result.median_angle_rad = angles[angles.size() / 2];
  return result;
}

std::vector<ImagePair> SelectPairs(const Scene& scene, const MatchOptions& options) {
  const int count = static_cast<int>(scene.images.size());
  const bool all_placed = scene.NumPlaced() <= options.all_pairs_up_to;
  const bool all_unplaced = count <= options.all_unplaced_up_to;
  const AnyCamera camera = *AnyCamera::Create(scene.camera);
  std::vector<ImagePair> pairs;
  for (int a = 0; a < count; ++a) {
    for (int b = a + 1; b < count; ++b) {
      const bool both = scene.images[a].placed && scene.images[b].placed;
      if (b - a <= options.sequence_neighbours || (both ? all_placed : all_unplaced) ||
          (both && std::max(Overlap(scene, camera, a, b), Overlap(scene, camera, b, a)) >
                       options.min_overlap))
        pairs.push_back({a, b});
    }
  }
  return pairs;
}

std::vector<VerifiedPair> MatchPairs(const Scene& scene, const std::vector<ImagePair>& pairs,
                                     const MatchOptions& options) {
  std::size_t max_features = 1;
  for (const SceneImage& image : scene.images)
    max_features = std::max(max_features, image.features.size());
  const Expected<NominalCamera> nominal = NominalCamera::Create(scene.camera, NominalRange(scene));
  if (!nominal) return {};

  std::vector<DescriptorRows> descriptors;
  for (const SceneImage& image : scene.images)
    descriptors.push_back(PrepareDescriptors(image.descriptor_type, image.descriptors,
                                             image.sizes_px, options.preview_features));
  std::vector<std::optional<VerifiedPair>> results(pairs.size());
  const bool finished =
      ForEachInParallel(static_cast<int>(pairs.size()), options.num_threads, options.progress, [&] {
        return [&, matcher = std::make_shared<PairMatcher>(scene, descriptors, options, *nominal,
                                                           static_cast<int>(max_features))](int i) {
          results[i] = matcher->Match(pairs[i]);
        };
      });
  std::vector<VerifiedPair> verified;
  if (!finished) return verified;
  for (std::optional<VerifiedPair>& result : results)
    if (result) verified.push_back(std::move(*result));
  return verified;
}

}  // namespace rsfm
