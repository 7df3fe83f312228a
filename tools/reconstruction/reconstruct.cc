#include "tools/reconstruction/reconstruct.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <set>

#include "rsfm/io/atomic_output.h"
#include "tools/offline/guided_matching.h"
#include "tools/offline/report_json.h"
#include "tools/offline/uwpinhole.h"
#include "tools/reconstruction/verification.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

class Reconstruction {
 public:
  explicit Reconstruction(const ReconstructRequest& request) : request_(request) {}

  IoExpected<ReconstructResult> Run() {
    if (const IoStatus s = Open(); !s) return Fail(s.error());
    if (const IoStatus s = Extract(); !s) return Fail(s.error());
    if (result_.interrupted) return std::move(result_);
    if (const IoStatus s = MakeScene(); !s) return Fail(s.error());
    OpenNavigation();
    if (!Select()) return std::move(result_);
    if (const IoStatus s = Match(); !s) return Fail(s.error());
    if (result_.interrupted) return std::move(result_);
    if (const IoStatus s = Map(); !s) return Fail(s.error());
    return std::move(result_);
  }

 private:
  bool Tell(const std::string& what, double part) const {
    return !request_.progress || request_.progress(what, part);
  }
  std::function<bool(int, int)> TellCounts(const char* what) const {
    return [this, what](int done, int all) {
      return Tell(what, static_cast<double>(done) / std::max(1, all));
    };
  }

  IoStatus Open() {
    auto list = ListImages(request_.images, request_.times, 1.0);
    if (!list) return Fail(list.error());
    list_ = std::move(*list);
    result_.num_offered = static_cast<int>(list_.images.size());
    auto rig = ReadRig(request_.camera);
    if (!rig) return Fail(rig.error());
    rig_ = std::move(*rig);
    if (const auto camera = AnyCamera::Create(rig_.camera); !camera) {
      return Fail({camera.error().code, request_.camera.string(),
                   std::string("camera: ") + camera.error().where,
                   std::string("is refused: ") + ToString(camera.error().code), "correct it"});
    }
    camera_ = rig_.camera;
    if (request_.uwpinhole) {
      const auto without_port = DropPort(camera_);
      if (!without_port) {
        return Fail({Errc::kDegenerate, request_.camera.string(), "camera",
                     "no perspective camera comes near this one", "leave --uwpinhole out"});
      }
      camera_ = *without_port;
    }
    result_.camera_before = camera_;
    if (!request_.nav) return {};
    auto table = ReadNavTable(*request_.nav, list_.images, rig_.world.origin);
    if (!table) return Fail(table.error());
    navigation_.samples = std::move(table->samples);
    navigation_.body_from_camera = rig_.body_from_camera;
    navigation_.defaults = rig_.mapper;
    rig_.world.origin = table->origin;
    return {};
  }

  IoStatus Extract() {
    ExtractionOptions options = request_.extraction;
    options.mask = rig_.mapper.mask;
    options.num_threads = request_.num_threads;
    options.progress = TellCounts("features");
    auto extraction =
        ExtractFeatures(list_, camera_.width, camera_.height, WorkFolder(request_), options);
    if (!extraction) return Fail(extraction.error());
    result_.extraction = std::move(*extraction);
    result_.interrupted = result_.extraction.interrupted;
    result_.seconds_extraction = result_.extraction.seconds;
    if (!result_.extraction.left_out.empty()) {
      const LeftOutImage& first = result_.extraction.left_out[0];
      result_.warnings.push_back(std::to_string(result_.extraction.left_out.size()) +
                                 " image(s) left out: " + first.image + " " + first.reason +
                                 (result_.extraction.left_out.size() > 1 ? "; ..." : ""));
    }
    return {};
  }

  IoStatus MakeScene() {
    scene_.camera = camera_;
    for (const ExtractedImage& from : result_.extraction.images) {
      auto features = ReadFeatures(FeaturesPath(WorkFolder(request_), from.name), from.key);
      if (!features) {
        return Fail({Errc::kNotFound, FeaturesPath(WorkFolder(request_), from.name).string(), "",
                     "was written by this run and is gone or damaged", "run it again"});
      }
      SceneImage image;
      image.name = from.name;
      image.utime = from.utime;
      image.features = std::move(features->pixels);
      image.points.assign(image.features.size(), kNoPoint);
      scene_.images.push_back(std::move(image));
    }
    return {};
  }

  void OpenNavigation() {
    if (!request_.nav) return;
    std::vector<Utime> utimes;
    for (const SceneImage& image : scene_.images) utimes.push_back(image.utime);
    at_images_.emplace(navigation_, utimes);
    fit_.emplace(navigation_, request_.mount);
    if (at_images_->num_covered() > 0) return;
    Distrust(at_images_->why_not());
  }

  void Distrust(const std::string& why) {
    distrusted_ = true;
    result_.warnings.push_back("navigation is not used: " + why);
  }
  bool UsesNavigation() const { return at_images_ && !distrusted_; }

  bool Select() {
    const auto start = std::chrono::steady_clock::now();
    PairSelectionOptions options = request_.selection;
    options.signature.seed = request_.seed;
    options.num_threads = request_.num_threads;
    options.progress = TellCounts("choosing pairs");
    result_.selection = SelectImagePairs(
        result_.extraction, WorkFolder(request_),
        UsesNavigation() ? at_images_->Places() : std::vector<std::optional<Vec3>>(), options);
    result_.seconds_selection = SecondsSince(start);
    result_.interrupted = result_.selection.interrupted;
    return !result_.interrupted;
  }

  IoStatus Match() {
    MatchStoreOptions options = request_.matching;
    options.num_threads = request_.num_threads;
    options.progress = TellCounts("matching");
    MatchOptions verification = request_.verification;
    verification.num_threads = request_.num_threads;
    verification.seed = request_.seed;
    const auto verify = [&](std::vector<PutativePair> block) {
      const auto start = std::chrono::steady_clock::now();
      if (result_.range_m == 0.0 && !block.empty())
        result_.range_m = ChooseRange(scene_, block, verification, 3.0);
      for (VerifiedPair& pair : VerifyPairs(scene_, block, result_.range_m, verification))
        pairs_.push_back(std::move(pair));
      result_.seconds_verification += SecondsSince(start);
    };
    const auto summary = MatchImages(result_.extraction, result_.selection.pairs,
                                     WorkFolder(request_), options, verify);
    if (!summary) return Fail(summary.error());
    result_.matching = *summary;
    result_.interrupted = summary->interrupted;
    result_.seconds_matching = summary->seconds - result_.seconds_verification;
    std::stable_sort(pairs_.begin(), pairs_.end(),
                     [](const auto& x, const auto& y) { return x.images < y.images; });
    result_.num_verified_pairs = static_cast<int>(pairs_.size());
    for (const VerifiedPair& pair : pairs_)
      result_.num_verified_matches += static_cast<std::int64_t>(pair.matches.size());
    result_.selection.pairs.clear();
    return {};
  }

  IncrementalOptions MappingOptions() {
    IncrementalOptions options = request_.incremental;
    BundleOptions* bundle = &options.bundle;
    bundle->num_threads = request_.num_threads;
    if (request_.uwpinhole) {
      bundle->lens = RefineUwPinhole();
    } else {
      if (request_.refine_lens)
        bundle->lens.focal = bundle->lens.principal_point = bundle->lens.distortion = true;
      if (request_.refine_port)
        bundle->port.normal = bundle->port.distance = bundle->port.center = true;
    }
    options.placing.seed = request_.seed;
    options.start.placing = options.placing;
    options.start.range_m = result_.range_m > 0.0 ? result_.range_m : 3.0;
    options.start.baseline = [this](int a, int b) -> std::optional<KnownBaseline> {
      if (request_.first_baseline_m > 0.0)
        return KnownBaseline{request_.first_baseline_m, 1e-3 * request_.first_baseline_m};
      return UsesNavigation() ? at_images_->BaselineOf(a, b) : std::nullopt;
    };
    if (at_images_ && !request_.nav_scale_only)
      options.navigate = [this](Scene* scene) { Navigate(scene); };
    if (request_.guided) {
      options.match_again = [this](const Scene& scene, std::vector<VerifiedPair>* pairs) {
        MatchAgain(scene, pairs);
      };
    }
    options.progress = [this](const std::string& what, double part) { return Tell(what, part); };
    options.checkpoint = [this](const std::string& bytes) {
      checkpoint_status_ = WriteFileAtomically(CheckpointPath(), bytes);
      return checkpoint_status_.has_value();
    };
    return options;
  }

  void MatchAgain(const Scene& scene, std::vector<VerifiedPair>* pairs) {
    std::vector<ImagePair> candidates;
    for (const VerifiedPair& pair : *pairs) candidates.push_back(pair.images);
    GuidedMatchOptions guided;
    guided.descriptors = [this](int image) {
      const ExtractedImage& from = result_.extraction.images[image];
      auto features = ReadFeatures(FeaturesPath(WorkFolder(request_), from.name), from.key);
      if (!features) return DescriptorRows();  // gone meanwhile: nothing more is found in it
      return PrepareDescriptors(features->type, std::move(features->descriptors), {}, 0);
    };
    MatchOptions match = request_.verification;
    match.num_threads = request_.num_threads;
    match.progress = TellCounts("matching along curves");
    result_.num_guided_matches += AddGuidedMatches(scene, candidates, match, guided, pairs);
  }

  // Into navigation's frame, with its priors, unless it contradicts what the images say.
  void Navigate(Scene* scene) {
    scene->priors.clear();
    alignment_ = {};
    if (!UsesNavigation()) return;
    alignment_ = fit_->Apply(scene);
    const std::string why = Contradiction(at_images_->Compare(PlacedPoses(*scene)), alignment_);
    if (!why.empty() && scene->NumPlaced() >= 6) {
      Distrust(why);
      alignment_ = {};
      scene->priors.clear();
    }
  }

  // One checkpoint for what is asked: the same images, pairs, camera and options.
  fs::path CheckpointPath() const {
    std::string text;
    for (const ExtractedImage& image : result_.extraction.images) AppendBinary(&text, image.key);
    AppendBinary(&text, static_cast<std::uint64_t>(result_.num_verified_matches));
    for (const double value : camera_.lens_params) AppendBinary(&text, value);
    for (const double value : camera_.port.Params()) AppendBinary(&text, value);
    for (const bool flag : {request_.refine_port, request_.refine_lens, request_.uwpinhole,
                            request_.nav_scale_only, request_.mount.mount, request_.mount.clock})
      AppendBinary(&text, static_cast<std::uint8_t>(flag));
    AppendBinary(&text, request_.first_baseline_m);
    AppendBinary(&text, request_.seed);
    for (const NavSample& s : navigation_.samples) {
      AppendBinary(&text, s.utime);
      for (const double value : s.position_ned_m) AppendBinary(&text, value);
    }
    char name[40];
    std::snprintf(name, sizeof name, "mapping-%016llx.bin",
                  static_cast<unsigned long long>(Fingerprint(text)));
    return WorkFolder(request_) / name;
  }

  Diagnostic NothingToBeginWith() const {
    const std::string counts = std::to_string(result_.matching.num_matched) + " of " +
                               std::to_string(result_.matching.num_pairs) +
                               " pairs have features in common, " + std::to_string(pairs_.size()) +
                               " agree with a rigid scene";
    Diagnostic d{Errc::kDegenerate, request_.images.string(), "images", "", ""};
    double widest = 0.0;
    for (const VerifiedPair& pair : pairs_) widest = std::max(widest, pair.median_angle_rad);
    if (result_.matching.num_matched == 0) {
      d.problem = "do not overlap: " + counts;
      d.fix = "give images of the same scene with half of each in its neighbours";
    } else if (pairs_.empty()) {
      d.problem = "show nothing that stands still: " + counts;
      d.fix = "check that the camera file is theirs, and that the scene does not move";
    } else {
      char angle[80];
      std::snprintf(angle, sizeof angle, "; the widest median parallax is %.2f degrees",
                    widest * 57.29578);
      d.problem = "hold no pair to begin with: " + counts + angle;
      d.fix = "give images taken from different places, with enough overlap";
    }
    return d;
  }

  IoStatus Map() {
    const auto start = std::chrono::steady_clock::now();
    const IncrementalOptions options = MappingOptions();
    const fs::path checkpoint = CheckpointPath();
    std::error_code error;
    std::string resume;
    if (fs::exists(checkpoint, error)) resume = ReadWholeFile(checkpoint).value_or(std::string());
    auto mapped = ReconstructIncrementally(options, pairs_, resume, &scene_);
    if (!checkpoint_status_) return Fail(checkpoint_status_.error());
    if (!mapped && mapped.error().code == Errc::kDegenerate) return Fail(NothingToBeginWith());
    if (!mapped) {
      return Fail({mapped.error().code, request_.images.string(), mapped.error().where,
                   "the bundle adjustment failed", "check the camera file"});
    }
    result_.interrupted = mapped->interrupted;
    result_.resumed = mapped->resumed;
    result_.num_global_adjustments = mapped->num_global_adjustments;
    result_.seconds_placing = mapped->seconds_placing;
    result_.seconds_windows = mapped->seconds_windows;
    result_.seconds_global = mapped->seconds_global;
    result_.seconds_tracks = mapped->seconds_tracks;
    result_.seconds_mapping = SecondsSince(start);
    if (result_.interrupted) return {};
    for (const IncrementalModel& model : mapped->models) AddModel(model, options.bundle);
    ExplainNotPlaced(*mapped);
    for (std::string& warning : ModelWarnings(result_))
      result_.warnings.push_back(std::move(warning));
    fs::remove(checkpoint, error);
    return {};
  }

  void AddModel(const IncrementalModel& from, const BundleOptions& bundle) {
    PutBack(from.map, &scene_);
    ReconstructedModel model;
    model.report = from.report;
    if (!request_.nav_scale_only) Navigate(&scene_);
    model.alignment = alignment_;
    if (UsesNavigation() && !request_.nav_scale_only)
      model.residuals = at_images_->Compare(PlacedPoses(scene_));
    model.camera = scene_.camera;
    BundleOptions solved = bundle;
    if (!model.report.scale_held) solved.scale_sigma = kSoftScale;
    solved.sigma_px = model.report.sigma_px;
    solved.loss.scale = model.report.loss_scale;
    const auto observability =
        AnalyseObservability(solved, bundle, {result_.camera_before}, ToBundle(scene_).problem);
    if (observability) model.observability = *observability;
    ColourPoints();
    Rig rig = rig_;
    if (model.alignment.attitude) {
      model.mount = fit_->estimates();
      rig.body_from_camera = fit_->input().body_from_camera;
    }
    DescribeWorld(model, &rig.world);
    model.model = ModelFromScene(scene_, rig);
    result_.models.push_back(std::move(model));
  }

  // Each point the mean of its features' colours, image after image from their files: colours of
  // all images at once would be memory for nothing.
  void ColourPoints() {
    std::vector<Eigen::Array3i> sums(scene_.points.size(), Eigen::Array3i::Zero());
    std::vector<int> counts(scene_.points.size(), 0);
    for (std::size_t i = 0; i < scene_.images.size(); ++i) {
      const SceneImage& image = scene_.images[i];
      if (!image.placed) continue;
      const ExtractedImage& from = result_.extraction.images[i];
      const auto features = ReadFeatures(FeaturesPath(WorkFolder(request_), from.name), from.key);
      if (!features) continue;  // gone meanwhile: the other images' colours
      for (std::size_t f = 0; f < image.points.size(); ++f) {
        if (image.points[f] == kNoPoint) continue;
        const auto& [r, g, b] = features->colours[f];
        sums[image.points[f]] += Eigen::Array3i(r, g, b);
        ++counts[image.points[f]];
      }
    }
    for (std::size_t p = 0; p < sums.size(); ++p)
      for (int c = 0; c < 3; ++c)
        scene_.points[p].rgb[c] = static_cast<std::uint8_t>(sums[p][c] / std::max(1, counts[p]));
  }

  // The world is navigation's, or the first image's camera.
  void DescribeWorld(const ReconstructedModel& model, World* world) {
    world->scale_is_metric = model.alignment.scale || model.report.start.baseline_from_navigation;
    if (model.alignment.attitude) {
      world->frame = WorldFrame::kNed;
      return;
    }
    world->frame = WorldFrame::kFirstCamera;
    const auto first = std::find_if(scene_.images.begin(), scene_.images.end(),
                                    [](const SceneImage& image) { return image.placed; });
    const Rigid3 first_from_world = first->camera_from_world;
    const Rigid3 world_from_first = first_from_world.Inverse();
    for (SceneImage& image : scene_.images)
      if (image.placed) image.camera_from_world = image.camera_from_world * world_from_first;
    for (ScenePoint& point : scene_.points) point.xyz = first_from_world * point.xyz;
  }

  void ExplainNotPlaced(const IncrementalResult& mapped) {
    std::set<int> placed, paired;
    for (const IncrementalModel& model : mapped.models)
      for (const auto& [image, pose] : model.map.poses) placed.insert(image);
    for (const VerifiedPair& pair : pairs_) {
      paired.insert(pair.images.a);
      paired.insert(pair.images.b);
    }
    for (int i = 0; i < static_cast<int>(scene_.images.size()); ++i) {
      if (placed.contains(i)) continue;
      result_.not_placed.push_back(
          {scene_.images[i].name, paired.contains(i)
                                      ? "shares too little with the model to be placed"
                                      : "matches no other image"});
    }
  }

  const ReconstructRequest& request_;
  ImageList list_;
  Rig rig_;
  CameraConfig camera_;
  NavigationInput navigation_;
  std::optional<ImageNavigation> at_images_;
  bool distrusted_ = false;
  std::optional<NavigationFit> fit_;
  NavigationAlignment alignment_;
  Scene scene_;
  std::vector<VerifiedPair> pairs_;
  IoStatus checkpoint_status_;
  ReconstructResult result_;
};

}  // namespace

fs::path WorkFolder(const ReconstructRequest& request) {
  if (!request.work.empty()) return request.work;
  fs::path out = request.out;
  if (!out.has_filename()) out = out.parent_path();  // "model/"
  return out += ".work";
}

IoExpected<ReconstructResult> Reconstruct(const ReconstructRequest& request) {
  return Reconstruction(request).Run();
}

IoStatus WriteReconstruction(const ReconstructRequest& request, const ReconstructResult& result) {
  auto folder = AtomicFolder::Create(request.out, Existing::kReplace);
  if (!folder) return Fail(folder.error());
  for (std::size_t i = 0; i < result.models.size(); ++i) {
    fs::path path = folder->aside();
    if (i > 0) {
      path /= "model_" + std::to_string(i + 1);
      std::error_code error;
      fs::create_directories(path, error);
      if (error) return Fail(FromErrno(error.value(), path.string(), "create the folder"));
    }
    if (const IoStatus s = WriteModelFiles(result.models[i].model, path); !s) return s;
  }
  if (const IoStatus s = WriteFileAtomically(folder->aside() / "report.json",
                                             FormatReconstructReport(request, result));
      !s)
    return s;
  return folder->Commit();
}

}  // namespace rsfm
