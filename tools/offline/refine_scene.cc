#include "tools/offline/refine_scene.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>

#include "tools/offline/unconfirmed_points.h"

namespace rsfm {
namespace {

class Refiner {
 public:
  Refiner(const RefineSceneOptions& options, Scene* scene) : options_(options), scene_(*scene) {}

  Expected<RefineSceneReport> Run() {
    if (const auto camera = AnyCamera::Create(scene_.camera); !camera)
      return tl::unexpected<Error>(camera.error());
    if (scene_.images.size() < 2) return Fail(Errc::kNotEnoughData, "images");
    if (!scene_.expected_camera) scene_.expected_camera = scene_.camera;
    if (const Status status = PrepareStart(); !status) return tl::unexpected(status.error());
    auto start = Now();
    MatchImages();
    report_.seconds_matching = Seconds(start);
    const CorrespondenceGraph graph(scene_, pairs_);
    if (!report_.interrupted && !report_.from_scratch) {
      // The poses have not seen these matches yet.
      TrackOptions generous = options_.tracks;
      generous.max_error_px *= 2.0;
      UpdateTracks(graph, generous, &scene_);
    }
    start = Now();
    if (!report_.interrupted) {
      if (report_.from_scratch && !PlaceFirstPair(graph, pairs_, options_.placing, &scene_))
        return Fail(Errc::kDegenerate, "first pair", report_.num_verified_pairs);
      if (const Status status = PlaceAll(graph); !status) return tl::unexpected(status.error());
    }
    report_.seconds_placing = Seconds(start);
    if (options_.navigate && !report_.interrupted) options_.navigate(&scene_);
    start = Now();
    std::optional<CorrespondenceGraph> with_guided;
    if (options_.guided && !report_.interrupted) {
      AddMatchesAlongCurves();
      with_guided.emplace(scene_, pairs_);
    }
    report_.seconds_matching += Seconds(start);
    start = Now();
    const CorrespondenceGraph& all_matches = with_guided ? *with_guided : graph;
    // What is wrong with the matches goes first: a lens or port that is free would bend to it.
    if (RefinesCamera() && options_.settle_first) {
      BundleOptions calibrated = options_.bundle;
      calibrated.scale_sigma = kHeldScale;
      calibrated.lens = {};
      calibrated.port = {};
      if (const Status status = Rounds(all_matches, calibrated); !status)
        return tl::unexpected(status.error());
    }
    if (const Status status = Rounds(all_matches, options_.bundle); !status)
      return tl::unexpected(status.error());
    if (const Status status = RoundsWithFittedNoise(all_matches); !status)
      return tl::unexpected(status.error());
    report_.seconds_rounds = Seconds(start);
    if (scene_.NumPlaced() < 2 || scene_.NumPoints() == 0)
      return Fail(Errc::kNotConverged, "nothing survived");
    report_.num_unconfirmed_outliers = RemoveUnconfirmedOutliers({}, &scene_);
    report_.errors = SceneErrors(scene_);
    return report_;
  }

 private:
  using Clock = std::chrono::steady_clock;
  static Clock::time_point Now() { return Clock::now(); }
  static double Seconds(Clock::time_point since) {
    return std::chrono::duration<double>(Clock::now() - since).count();
  }

  bool RefinesCamera() const {
    return options_.bundle.lens.Any() || RefinesPort(scene_.camera.port.type, options_.bundle.port);
  }

  bool Tell(const std::string& what, double part) {
    if (options_.progress && !options_.progress(what, part)) report_.interrupted = true;
    return !report_.interrupted;
  }

  // Adjusts what the vehicle's map has. A map that does not survive this is begun anew.
  Status PrepareStart() {
    report_.placed_before = scene_.NumPlaced();
    report_.observations_before = scene_.NumObservations();
    report_.from_scratch = report_.placed_before < 2 || scene_.NumPoints() == 0;
    if (!report_.from_scratch) {
      report_.mean_error_before_px = SceneErrors(scene_).mean_px;
      if (options_.navigate) options_.navigate(&scene_);
      if (const Status status = AdjustCalibrated("adjusting the map"); !status) return status;
      report_.from_scratch = scene_.NumPlaced() < 2;
    }
    if (report_.from_scratch) {
      for (SceneImage& image : scene_.images) {
        image.placed = false;
        std::fill(image.points.begin(), image.points.end(), kNoPoint);
      }
      scene_.points.clear();
      scene_.priors.clear();
    }
    return {};
  }

  void MatchImages() {
    selected_ = SelectPairs(scene_, options_.match);
    MatchOptions match = options_.match;
    match.progress = [this](int done, int all) {
      return Tell("matching", static_cast<double>(done) / all);
    };
    pairs_ = MatchPairs(scene_, selected_, match);
    report_.num_pairs = static_cast<int>(selected_.size());
    report_.num_verified_pairs = static_cast<int>(pairs_.size());
    for (const VerifiedPair& pair : pairs_)
      report_.num_matches += static_cast<int>(pair.matches.size());
  }

  void AddMatchesAlongCurves() {
    MatchOptions match = options_.match;
    match.progress = [this](int done, int all) {
      return Tell("matching along curves", static_cast<double>(done) / all);
    };
    report_.num_guided_matches =
        AddGuidedMatches(scene_, selected_, match, *options_.guided, &pairs_);
  }

  // Global adjustment with lens and port as they are, then the filter.
  Status AdjustCalibrated(const std::string& what) {
    SceneBundle bundle = ToBundle(scene_);
    BundleOptions adjust = options_.bundle;
    if (RefinesCamera()) adjust.scale_sigma = kHeldScale;  // a wrong port bends to a wrong scale
    adjust.lens = {};
    adjust.port = {};
    adjust.max_iterations = 25;
    adjust.function_tolerance = 1e-5;
    adjust.progress = [&](const BundleProgress& p) {
      return Tell(what, static_cast<double>(p.iteration) / p.max_iterations);
    };
    const auto report = AdjustBundle(adjust, &bundle.problem);
    if (!report) return tl::unexpected(report.error());
    FromBundle(bundle, &scene_);
    FilterScene(options_.filter, &scene_);
    return {};
  }

  Status PlaceAll(const CorrespondenceGraph& graph) {
    std::vector<std::uint8_t> tried(scene_.images.size(), 0), tried_pairs;
    int adjusted_at = scene_.NumPlaced();
    bool second_chance = true;
    // An image that the filter throws out again may be placed once more; the bound ends a quarrel.
    const std::size_t bound = 2 * scene_.images.size();
    while (!report_.interrupted && report_.newly_placed.size() < bound) {
      int next = NextToPlace(graph, options_.placing, tried, scene_);
      if (next >= 0) {
        tried[next] = 1;
        if (!PlaceImage(next, graph, options_.placing, &scene_)) continue;
      } else if (!PlaceByPair(pairs_, graph, options_.placing, &tried_pairs, &scene_, &next)) {
        // Images that failed may succeed in the finished map, once.
        if (!second_chance || adjusted_at == scene_.NumPlaced()) break;
        second_chance = false;
        if (const Status status = AdjustCalibrated("adjusting"); !status) return status;
        UpdateTracks(graph, options_.tracks, &scene_);
        adjusted_at = scene_.NumPlaced();
        std::fill(tried.begin(), tried.end(), 0);
        tried_pairs.clear();
        continue;
      }
      AdjustAround(next, options_.placing, &scene_);
      // With the pose settled, what did not fit before may now.
      UpdateTracksOf(next, graph, options_.tracks, &scene_);
      report_.newly_placed.push_back(next);
      const int placed = scene_.NumPlaced();
      Tell("placing images", static_cast<double>(placed) / static_cast<double>(tried.size()));
      if (placed < (1.0 + options_.growth) * adjusted_at && placed < adjusted_at + 30) continue;
      if (const Status status = AdjustCalibrated("adjusting"); !status) return status;
      UpdateTracks(graph, options_.tracks, &scene_);
      adjusted_at = scene_.NumPlaced();
      std::fill(tried.begin(), tried.end(), 0);
    }
    return {};
  }

  Status Rounds(const CorrespondenceGraph& graph, const BundleOptions& bundle) {
    for (int round = 0; round < options_.max_rounds && !report_.interrupted; ++round) {
      const auto done = Round(graph, bundle, round == 0);
      if (!done) return tl::unexpected(done.error());
      if (*done) break;
    }
    return {};
  }

  // With the noise as it shows now, until that stays as it is.
  Status RoundsWithFittedNoise(const CorrespondenceGraph& graph) {
    constexpr int kTimes = 3;
    constexpr double kSame = 0.95;
    report_.bundle = options_.bundle;
    for (int i = 0; i < kTimes && !report_.interrupted; ++i) {
      const BundleOptions fitted = FitNoise(options_.bundle, SceneErrors(scene_));
      if (fitted.sigma_px >= kSame * report_.bundle.sigma_px) break;
      report_.bundle = fitted;
      if (const auto done = Round(graph, fitted, false); !done) return tl::unexpected(done.error());
    }
    return {};
  }

  // True when another round would bring nothing.
  Expected<bool> Round(const CorrespondenceGraph& graph, const BundleOptions& options,
                       bool is_first) {
    RefineRound round;
    round.refines_camera = options.lens.Any() || options.port.Any();
    round.sigma_px = options.sigma_px;
    round.tracks = UpdateTracks(graph, options_.tracks, &scene_);
    if (options_.navigate && options_.navigate_each_round) options_.navigate(&scene_);
    SceneBundle bundle = ToBundle(scene_);
    BundleOptions adjust = options;
    const std::size_t number = report_.rounds.size() + 1;
    adjust.progress = [&](const BundleProgress& p) {
      return Tell("round " + std::to_string(number),
                  static_cast<double>(p.iteration) / p.max_iterations);
    };
    const auto adjusted = AdjustBundle(adjust, &bundle.problem);
    if (!adjusted) return tl::unexpected(adjusted.error());
    FromBundle(bundle, &scene_);
    round.bundle = *adjusted;
    round.filter = FilterScene(options_.filter, &scene_);
    round.mean_error_px = SceneErrors(scene_).mean_px;
    round.num_images = scene_.NumPlaced();
    round.num_points = scene_.NumPoints();
    round.num_observations = scene_.NumObservations();
    const RefineRound* before = is_first ? nullptr : &report_.rounds.back();
    // Rounds of which each still lowers the cost go on, whatever the mean error does.
    const bool settled =
        round.bundle.converged || round.bundle.initial_cost - round.bundle.final_cost <=
                                      options_.min_improvement * round.bundle.initial_cost;
    const bool done =
        before != nullptr && settled && round.num_images == before->num_images &&
        std::abs(round.num_observations - before->num_observations) <=
            options_.min_change * round.num_observations &&
        round.mean_error_px >= before->mean_error_px * (1.0 - options_.min_improvement);
    report_.rounds.push_back(std::move(round));
    return done;
  }

  const RefineSceneOptions& options_;
  Scene& scene_;
  std::vector<ImagePair> selected_;
  std::vector<VerifiedPair> pairs_;
  RefineSceneReport report_;
};

}  // namespace

Expected<RefineSceneReport> RefineScene(const RefineSceneOptions& options, Scene* scene) {
  return Refiner(options, scene).Run();
}

}  // namespace rsfm
