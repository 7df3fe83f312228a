#include "tools/reconstruction/incremental.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>

#include "tools/offline/unconfirmed_points.h"
#include "tools/reconstruction/consistency.h"
#include "tools/reconstruction/next_image.h"

namespace rsfm {
namespace {

constexpr std::uint32_t kCheckpointVersion = 4;

// Adds what it measures to a total.
class Stopwatch {
 public:
  explicit Stopwatch(double* total) : total_(total) {}
  ~Stopwatch() {
    *total_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  double* total_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

class Reconstructor {
 public:
  Reconstructor(const IncrementalOptions& options, const std::vector<VerifiedPair>& pairs,
                Scene* scene)
      : options_(options),
        pairs_(pairs),
        scene_(*scene),
        camera_(scene->camera),
        bundle_(options.bundle),
        graph_(*scene, pairs),
        next_(*scene, pairs),
        used_(scene->images.size(), 0) {
    scene_.expected_camera = camera_;
  }

  Expected<IncrementalResult> Run(const std::string& resume_from) {
    bool growing = !resume_from.empty() && Resume(resume_from);
    result_.resumed = growing;
    // Starts that came to nothing are bounded, too.
    for (int trial = 0; trial < 2 * options_.max_models &&
                        static_cast<int>(result_.models.size()) < options_.max_models;
         ++trial) {
      if (!growing && !Start()) break;
      growing = false;
      if (const Status status = Grow(); !status) return tl::unexpected(status.error());
      if (result_.interrupted) break;
      if (const Status status = Finish(); !status) return tl::unexpected(status.error());
      if (result_.interrupted) break;
    }
    if (result_.models.empty() && !result_.interrupted)
      return Fail(Errc::kDegenerate, "first pair", static_cast<int>(pairs_.size()));
    std::stable_sort(result_.models.begin(), result_.models.end(),
                     [](const IncrementalModel& x, const IncrementalModel& y) {
                       return x.map.poses.size() > y.map.poses.size();
                     });
    return std::move(result_);
  }

 private:
  bool Tell(const std::string& what, double part) {
    if (options_.progress && !options_.progress(what, part)) result_.interrupted = true;
    return !result_.interrupted;
  }
  double PartPlaced() const {
    return static_cast<double>(scene_.NumPlaced()) / static_cast<double>(scene_.images.size());
  }

  bool RefinesCamera() const {
    return options_.bundle.lens.Any() || RefinesPort(camera_.port.type, options_.bundle.port);
  }

  bool Start() {
    const Stopwatch watch(&result_.seconds_placing);
    scene_.camera = camera_;
    scene_.priors.clear();
    const auto start =
        PlaceStartPair(graph_, pairs_, used_, options_.start, &tried_starts_, &scene_);
    if (!start) return false;
    model_ = {};
    all_matches_.reset();
    is_growing_ = true;
    model_.start = *start;
    next_.TouchAll();
    adjusted_at_ = 0;
    return true;
  }

  // Adjusts everything, filters and completes tracks.
  Status AdjustAll(const std::string& what, int max_iterations, double tolerance,
                   BundleReport* report = nullptr) {
    ++result_.num_global_adjustments;
    if (options_.navigate) options_.navigate(&scene_);
    SceneBundle bundle = ToBundle(scene_);
    BundleOptions adjust = bundle_;
    if (!model_.start.baseline_from_navigation && RaysTellScale(camera_.port.type, adjust))
      adjust.scale_sigma = kSoftScale;
    if (RefinesCamera() && is_growing_ && scene_.NumPlaced() < options_.refine_from) {
      adjust.lens = {};
      adjust.port = {};
      adjust.scale_sigma = kHeldScale;  // a wrong port bends rays to a wrong scale
    }
    adjust.max_iterations = max_iterations;
    adjust.function_tolerance = tolerance;
    adjust.progress = [&](const BundleProgress&) { return Tell(what, PartPlaced()); };
    {
      const Stopwatch watch(&result_.seconds_global);
      const auto done = AdjustBundle(adjust, &bundle.problem);
      if (!done) return tl::unexpected(done.error());
      model_.last_bundle = *done;
      model_.scale_held = done->gauge.scale;
      if (report != nullptr) *report = *done;
      FromBundle(bundle, &scene_);
    }
    const Stopwatch watch(&result_.seconds_tracks);
    FilterScene(options_.filter, &scene_);
    UpdateTracks(all_matches_ ? *all_matches_ : graph_, options_.tracks, &scene_);
    return {};
  }

  bool PlaceOne(std::vector<std::uint8_t>* closed, std::vector<std::uint8_t>* tried_pairs,
                int* placed) {
    const Stopwatch watch(&result_.seconds_placing);
    for (;;) {
      *placed = next_.Choose(graph_, options_.placing.min_inliers, *closed, scene_);
      if (*placed < 0) break;
      (*closed)[*placed] = 1;
      if (PlaceImage(*placed, graph_, options_.placing, &scene_)) return true;
      if (!Tell("placing images", PartPlaced())) return false;
    }
    return PlaceByPair(pairs_, graph_, options_.placing, tried_pairs, &scene_, placed);
  }

  std::vector<std::uint8_t> PairsOfUsedImages() const {
    std::vector<std::uint8_t> tried(pairs_.size(), 0);
    for (std::size_t i = 0; i < pairs_.size(); ++i)
      tried[i] = used_[pairs_[i].images.a] | used_[pairs_[i].images.b];
    return tried;
  }

  // Images that a repeated pattern has put where stronger pairs say they are not: taken off, to be
  // placed again. False when there is none or it has been tried often enough.
  bool TakeOffContradicted() {
    constexpr int kMaxTimes = 3;
    if (model_.times_taken_off >= kMaxTimes) return false;
    const std::vector<int> images = ContradictedImages(pairs_, scene_);
    if (images.empty()) return false;
    ++model_.times_taken_off;
    for (const int image : images) scene_.Unplace(image);
    return true;
  }

  // Places image after image until none is left that can be.
  Status Grow() {
    std::vector<std::uint8_t> closed = used_, tried_pairs = PairsOfUsedImages();
    const auto reopen = [&] {
      adjusted_at_ = scene_.NumPlaced();
      closed = used_;
      tried_pairs = PairsOfUsedImages();
      next_.TouchAll();
      WriteCheckpoint();
      PutBack(TakeSnapshot(scene_), &scene_);  // as one that resumes from it has it
    };
    // An image that the filter throws out again may be placed once more; the bound ends a quarrel.
    std::size_t left = 3 * scene_.images.size();
    while (left-- > 0 && Tell("placing images", PartPlaced())) {
      int placed = -1;
      if (!PlaceOne(&closed, &tried_pairs, &placed)) {
        if (result_.interrupted) break;
        if (adjusted_at_ == scene_.NumPlaced() && !TakeOffContradicted()) break;
        // Images that failed may succeed in the adjusted map.
        if (const Status s = AdjustAll("adjusting", 25, 1e-5); !s) return s;
        if (!result_.interrupted) reopen();
        continue;
      }
      if (scene_.NumPlaced() >= options_.window_from) {
        const Stopwatch watch(&result_.seconds_windows);
        AdjustAround(placed, options_.placing, &scene_);
      }
      {
        const Stopwatch watch(&result_.seconds_tracks);
        UpdateTracksOf(placed, graph_, options_.tracks, &scene_);
      }
      next_.Touch(placed);
      const int count = scene_.NumPlaced();
      if (count < (1.0 + options_.growth) * adjusted_at_ &&
          count < adjusted_at_ + options_.growth_images)
        continue;
      if (const Status s = AdjustAll("adjusting", 15, 1e-4); !s) return s;
      if (!result_.interrupted) reopen();
    }
    return {};
  }

  void MatchAgain() {
    all_matches_.reset();
    if (!options_.match_again) return;
    std::vector<VerifiedPair> pairs = pairs_;
    options_.match_again(scene_, &pairs);
    all_matches_.emplace(scene_, pairs);
    const Stopwatch watch(&result_.seconds_tracks);
    UpdateTracks(*all_matches_, options_.tracks, &scene_);
  }

  // Rounds until they bring nothing, then the model is put away.
  Status Finish() {
    is_growing_ = false;
    ErrorSummary before;
    bundle_ = options_.bundle;
    for (int round = 0; round < options_.max_rounds; ++round) {
      BundleReport bundle;
      const int observations = scene_.NumObservations();
      if (const Status s = AdjustAll("refining", options_.bundle.max_iterations,
                                     options_.bundle.function_tolerance, &bundle);
          !s)
        return s;
      if (result_.interrupted) return {};
      if (round == 0) MatchAgain();
      ++model_.rounds;
      const ErrorSummary errors = SceneErrors(scene_);
      const bool settled =
          round > 0 && bundle.converged &&
          std::abs(scene_.NumObservations() - observations) <= options_.min_change * observations &&
          errors.mean_px >= before.mean_px * (1.0 - options_.min_improvement);
      before = errors;
      if (settled) break;
    }
    // What the last completion added has not been adjusted, and what it moved not judged. With the
    // noise as it shows now, until that stays as it is.
    constexpr int kTimes = 3;
    constexpr double kSame = 0.95;
    for (int i = 0; i < kTimes && !result_.interrupted; ++i) {
      const double sigma_px = bundle_.sigma_px;
      bundle_ = FitNoise(options_.bundle, SceneErrors(scene_));
      if (i > 0 && bundle_.sigma_px >= kSame * sigma_px) break;
      if (const Status s = AdjustAll("refining", options_.bundle.max_iterations,
                                     options_.bundle.function_tolerance);
          !s)
        return s;
    }
    model_.sigma_px = bundle_.sigma_px;
    model_.loss_scale = bundle_.loss.scale;
    bundle_ = options_.bundle;
    if (!result_.interrupted) PutAway();
    return {};
  }

  void PutAway() {
    FilterScene(options_.filter, &scene_);
    model_.num_unconfirmed_outliers = RemoveUnconfirmedOutliers({}, &scene_);
    model_.num_images = scene_.NumPlaced();
    model_.num_points = scene_.NumPoints();
    model_.num_observations = scene_.NumObservations();
    model_.errors = SceneErrors(scene_);
    model_.num_contradicted = static_cast<int>(ContradictedImages(pairs_, scene_).size());
    if (model_.num_images < options_.min_model_images) return;
    for (std::size_t i = 0; i < used_.size(); ++i)
      if (scene_.images[i].placed) used_[i] = 1;
    result_.models.push_back({TakeSnapshot(scene_), model_});
  }

  void WriteCheckpoint() {
    if (!options_.checkpoint) return;
    std::string bytes;
    AppendBinary(&bytes, kCheckpointVersion);
    AppendBinary(&bytes, static_cast<std::uint32_t>(result_.models.size()));
    for (const IncrementalModel& model : result_.models) {
      AppendReport(model.report, &bytes);
      AppendSnapshot(model.map, &bytes);
    }
    AppendReport(model_, &bytes);
    AppendSnapshot(TakeSnapshot(scene_), &bytes);
    AppendBinary(&bytes, static_cast<std::uint32_t>(tried_starts_.size()));
    bytes.append(tried_starts_.begin(), tried_starts_.end());
    if (!options_.checkpoint(bytes)) result_.interrupted = true;
  }

  static void AppendReport(const ModelReport& report, std::string* bytes) {
    for (const int value :
         {report.start.images.a, report.start.images.b, report.num_images, report.num_points,
          report.num_observations, report.rounds, report.times_taken_off, report.num_contradicted,
          report.num_unconfirmed_outliers})
      AppendBinary(bytes, static_cast<std::int32_t>(value));
    for (const bool value : {report.start.baseline_from_navigation,
                             report.start.baseline_from_refraction, report.scale_held})
      AppendBinary(bytes, static_cast<std::uint8_t>(value));
    for (const double value : {report.start.baseline_m, report.errors.mean_px, report.errors.rms_px,
                               report.sigma_px, report.loss_scale})
      AppendBinary(bytes, value);
    AppendBinary(bytes, static_cast<std::int32_t>(report.errors.num_observations));
  }

  static bool ReadReport(BinaryReader* reader, ModelReport* report) {
    for (int* value :
         {&report->start.images.a, &report->start.images.b, &report->num_images,
          &report->num_points, &report->num_observations, &report->rounds, &report->times_taken_off,
          &report->num_contradicted, &report->num_unconfirmed_outliers})
      reader->Read(value);
    for (bool* value : {&report->start.baseline_from_navigation,
                        &report->start.baseline_from_refraction, &report->scale_held}) {
      std::uint8_t byte = 0;
      reader->Read(&byte);
      *value = byte != 0;
    }
    for (double* value : {&report->start.baseline_m, &report->errors.mean_px,
                          &report->errors.rms_px, &report->sigma_px, &report->loss_scale})
      reader->Read(value);
    return reader->Read(&report->errors.num_observations);
  }

  bool Resume(const std::string& bytes) {
    BinaryReader reader(bytes);
    std::uint32_t version = 0, count = 0;
    if (!reader.Read(&version) || version != kCheckpointVersion || !reader.Read(&count))
      return false;
    std::vector<IncrementalModel> models;
    for (std::uint32_t i = 0; i < count; ++i) {
      models.emplace_back();
      if (!ReadReport(&reader, &models.back().report) ||
          !ReadSnapshot(&reader, scene_, &models.back().map))
        return false;
    }
    ModelReport report;
    MapSnapshot map;
    std::uint32_t num_tried = 0;
    if (!ReadReport(&reader, &report) || !ReadSnapshot(&reader, scene_, &map) ||
        !reader.Read(&num_tried) || num_tried != pairs_.size() ||
        bytes.size() - reader.offset() != num_tried)
      return false;
    tried_starts_.assign(bytes.end() - static_cast<std::ptrdiff_t>(num_tried), bytes.end());
    for (const IncrementalModel& model : models)
      for (const auto& [image, pose] : model.map.poses) used_[image] = 1;
    result_.models = std::move(models);
    model_ = report;
    PutBack(map, &scene_);
    adjusted_at_ = scene_.NumPlaced();
    return true;
  }

  const IncrementalOptions& options_;
  const std::vector<VerifiedPair>& pairs_;
  Scene& scene_;
  const CameraConfig camera_;  // as it was given
  BundleOptions bundle_;       // with the noise as it is believed to be
  const CorrespondenceGraph graph_;
  std::optional<CorrespondenceGraph> all_matches_;  // of the finished model, with those found again
  NextImage next_;
  std::vector<std::uint8_t> used_;  // images of finished models
  std::vector<std::uint8_t> tried_starts_;
  bool is_growing_ = true;  // images may still be placed
  int adjusted_at_ = 0;
  ModelReport model_;
  IncrementalResult result_;
};

}  // namespace

Expected<IncrementalResult> ReconstructIncrementally(const IncrementalOptions& options,
                                                     const std::vector<VerifiedPair>& pairs,
                                                     const std::string& resume_from, Scene* scene) {
  return Reconstructor(options, pairs, scene).Run(resume_from);
}

}  // namespace rsfm
