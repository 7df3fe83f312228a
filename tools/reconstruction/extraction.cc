#include "tools/reconstruction/extraction.h"

#include <chrono>
#include <optional>
#include <unordered_map>

#include "rsfm/io/atomic_output.h"
#include "rsfm/mapping/front_end.h"
#include "tools/map/image_files.h"
#include "tools/offline/parallel_progress.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

constexpr int kMinFeatures = 20;  // fewer match nothing

struct Outcome {
  ExtractedImage image;
  std::string problem;  // why it is left out
  bool from_cache = false;
  IoStatus failure;  // of the working folder
};

MapperOptions FrontEndOptions(const ExtractionOptions& options) {
  MapperOptions front_end;
  front_end.rhythm = Rhythm::kStills;
  front_end.descriptor = options.type;
  front_end.max_features = options.max_features;
  front_end.sift_first_octave = -1;  // there is time for all that the image shows
  front_end.contrast_limit = options.contrast_limit;
  front_end.mask = options.mask;
  return front_end;
}

std::uint64_t OptionsKey(const ExtractionOptions& options) {
  std::string text = "v1 " + std::string(ToString(options.type)) + " " +
                     std::to_string(options.max_features) + " " +
                     std::to_string(options.contrast_limit);
  for (const MaskRectangle& r : options.mask) {
    for (const int edge : {r.left, r.top, r.right, r.bottom}) text += " " + std::to_string(edge);
  }
  return Fingerprint(text);
}

ImageFeatures CopyFeatures(const FrameObservations& frame) {
  ImageFeatures features;
  features.type = frame.descriptors.type;
  for (const Feature& f : frame.features) {
    features.pixels.push_back(f.pixel());
    features.sizes_px.push_back(f.size_px);
    features.colours.push_back({f.r, f.g, f.b});
  }
  const std::size_t bytes =
      frame.features.size() * static_cast<std::size_t>(DescriptorStride(frame.descriptors.type));
  features.descriptors.assign(frame.descriptors.data, frame.descriptors.data + bytes);
  return features;
}

// One per thread.
class Extractor {
 public:
  Extractor(const ImageList& list, int width_px, int height_px, const fs::path& work,
            const ExtractionOptions& options, std::vector<Outcome>* outcomes)
      : list_(list),
        work_(work),
        options_key_(OptionsKey(options)),
        reader_(width_px, height_px),
        outcomes_(*outcomes) {
    auto front_end = FrontEnd::Create(FrontEndOptions(options), width_px, height_px);
    if (front_end) front_end_ = std::move(*front_end);
  }

  void operator()(int index) {
    Outcome& outcome = outcomes_[index];
    const ImageTime& image = list_.images[index];
    outcome.image.name = image.image;
    outcome.image.utime = image.utime;
    const fs::path path = list_.folder / image.image;
    const auto bytes = ReadWholeFile(path);
    if (!bytes) {
      outcome.problem = bytes.error().problem;
      return;
    }
    outcome.image.contents = Fingerprint(*bytes);
    outcome.image.key = Fingerprint({}, outcome.image.contents ^ options_key_);
    const fs::path file = FeaturesPath(work_, image.image);
    if (const auto cached = ReadFeatures(file, outcome.image.key)) {
      outcome.from_cache = true;
      outcome.image.num_features = cached->Size();
    } else {
      Extract(path, file, image.utime, &outcome);
    }
    if (outcome.problem.empty() && outcome.image.num_features < kMinFeatures)
      outcome.problem = "has " + std::to_string(outcome.image.num_features) +
                        " features: nothing in it can be recognised";
  }

 private:
  void Extract(const fs::path& path, const fs::path& file, Utime utime, Outcome* outcome) {
    const auto view = reader_.Read(path);
    if (!view) {
      outcome->problem = view.error().problem;
      return;
    }
    const auto frame = front_end_ ? front_end_->Process(*view, utime, {.want_descriptors = true})
                                  : Expected<FrameObservations>(Fail(Errc::kUnsupported, "image"));
    if (!frame) {
      outcome->problem = "cannot be searched for features";
      return;
    }
    const ImageFeatures features = CopyFeatures(*frame);
    outcome->image.num_features = features.Size();
    outcome->failure = WriteFeatures(file, outcome->image.key, features);
  }

  const ImageList& list_;
  const fs::path& work_;
  std::uint64_t options_key_;
  ImageReader reader_;
  std::unique_ptr<FrontEnd> front_end_;
  std::vector<Outcome>& outcomes_;
};

}  // namespace

fs::path FeaturesPath(const fs::path& work, const std::string& image) {
  // Names may hold folders; one file each, told apart by the fingerprint of the whole name.
  char id[20];
  std::snprintf(id, sizeof id, "-%08llx",
                static_cast<unsigned long long>(Fingerprint(image) & 0xFFFFFFFFu));
  return work / "features" / (fs::path(image).filename().string() + id + ".bin");
}

IoExpected<Extraction> ExtractFeatures(const ImageList& list, int width_px, int height_px,
                                       const fs::path& work, const ExtractionOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  std::vector<Outcome> outcomes(list.images.size());
  Extraction extraction;
  extraction.interrupted = !ForEachInParallel(
      static_cast<int>(list.images.size()), options.num_threads, options.progress,
      [&] { return Extractor(list, width_px, height_px, work, options, &outcomes); });
  extraction.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (extraction.interrupted) return extraction;
  std::unordered_map<std::uint64_t, std::string> seen;
  for (Outcome& outcome : outcomes) {
    if (!outcome.failure) return Fail(outcome.failure.error());
    if (outcome.problem.empty()) {
      const auto [first, is_new] = seen.emplace(outcome.image.contents, outcome.image.name);
      if (!is_new) outcome.problem = "is the same file as " + first->second;
    }
    if (!outcome.problem.empty()) {
      extraction.left_out.push_back({outcome.image.name, outcome.problem});
      continue;
    }
    extraction.num_cached += outcome.from_cache ? 1 : 0;
    extraction.images.push_back(std::move(outcome.image));
  }
  if (extraction.images.size() < 2) {
    std::string problem = std::to_string(extraction.images.size()) + " of " +
                          std::to_string(list.images.size()) + " images can be used";
    if (!extraction.left_out.empty())
      problem += "; " + extraction.left_out[0].image + " " + extraction.left_out[0].reason;
    return Fail({Errc::kNotEnoughData, list.folder.string(), "images", problem,
                 "give two images or more of the camera's size that show the same scene"});
  }
  return extraction;
}

}  // namespace rsfm
