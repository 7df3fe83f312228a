#include "tools/reconstruction/match_store.h"

#include <algorithm>
#include <chrono>
#include <map>
#include <memory>
#include <optional>

#include "rsfm/io/atomic_output.h"
#include "rsfm/io/binary.h"
#include "tools/offline/descriptor_rows.h"
#include "tools/offline/parallel_progress.h"

namespace rsfm {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMagic = 0x31544D5453465352u;

// Descriptors of the images in work.
class DescriptorWindow {
 public:
  DescriptorWindow(const Extraction& extraction, const fs::path& work, int preview_features)
      : extraction_(extraction), work_(work), preview_features_(preview_features) {}

  // Loads what is not there and lets go of the rest. False when a file has gone.
  bool Hold(const std::vector<int>& images) {
    std::map<int, DescriptorRows> next;
    for (const int i : images) {
      const auto found = loaded_.find(i);
      if (found != loaded_.end()) {
        next.emplace(i, std::move(found->second));
        continue;
      }
      const ExtractedImage& image = extraction_.images[i];
      auto features = ReadFeatures(FeaturesPath(work_, image.name), image.key);
      if (!features) return false;
      next.emplace(i, PrepareDescriptors(features->type, std::move(features->descriptors),
                                         features->sizes_px, preview_features_));
    }
    loaded_ = std::move(next);
    return true;
  }
  const DescriptorRows& Of(int image) const { return loaded_.at(image); }

 private:
  const Extraction& extraction_;
  const fs::path& work_;
  int preview_features_;
  std::map<int, DescriptorRows> loaded_;
};

// Pairs grouped so that each group touches two blocks of images at most.
std::vector<std::vector<ImagePair>> Blocks(const std::vector<ImagePair>& pairs,
                                           const MatchStoreOptions& options) {
  std::map<std::pair<int, int>, std::vector<ImagePair>> by_images;
  for (const ImagePair& pair : pairs)
    by_images[{pair.a / options.block_images, pair.b / options.block_images}].push_back(pair);
  std::vector<std::vector<ImagePair>> blocks;
  for (const auto& [images, group] : by_images) {
    for (std::size_t i = 0; i < group.size(); i += static_cast<std::size_t>(options.block_pairs)) {
      const auto first = group.begin() + static_cast<std::ptrdiff_t>(i);
      const auto left = group.end() - first;
      blocks.emplace_back(first, first + std::min<std::ptrdiff_t>(left, options.block_pairs));
    }
  }
  return blocks;
}

std::uint64_t BlockKey(const Extraction& extraction, const std::vector<ImagePair>& pairs,
                       const MatchStoreOptions& options) {
  std::string text;
  AppendBinary(&text, options.max_ratio);
  for (const int value : {options.min_matches, options.always_neighbours, options.preview_features,
                          options.preview_matches})
    AppendBinary(&text, value);
  for (const ImagePair& pair : pairs) {
    AppendBinary(&text, extraction.images[pair.a].key);
    AppendBinary(&text, extraction.images[pair.b].key);
    // Whether the preview is asked, which depends on the order of the list.
    AppendBinary(&text, static_cast<std::uint8_t>(pair.b - pair.a > options.always_neighbours));
  }
  return Fingerprint(text, kMagic);
}

fs::path BlockPath(const fs::path& work, std::uint64_t key) {
  char name[32];
  std::snprintf(name, sizeof name, "%016llx.bin", static_cast<unsigned long long>(key));
  return work / "matches" / name;
}

std::string Format(const std::vector<PutativePair>& block) {
  std::string body;
  AppendBinary(&body, static_cast<std::uint32_t>(block.size()));
  for (const PutativePair& pair : block) {
    AppendBinary(&body, static_cast<std::uint32_t>(pair.matches.size()));
    for (const DescriptorMatch& match : pair.matches) {
      AppendBinary(&body, match.query);
      AppendBinary(&body, match.train);
      AppendBinary(&body, match.distance);
    }
  }
  std::string bytes;
  AppendBinary(&bytes, kMagic);
  AppendBinary(&bytes, Fingerprint(body));
  return bytes + body;
}

std::optional<std::vector<PutativePair>> Load(const fs::path& path, const Extraction& extraction,
                                              const std::vector<ImagePair>& pairs) {
  std::error_code error;
  if (!fs::exists(path, error)) return std::nullopt;
  const auto bytes = ReadWholeFile(path);
  if (!bytes) return std::nullopt;
  BinaryReader reader(*bytes);
  std::uint64_t magic = 0, sum = 0;
  std::uint32_t count = 0;
  if (!reader.Read(&magic) || !reader.Read(&sum) || magic != kMagic ||
      Fingerprint(std::string_view(*bytes).substr(reader.offset())) != sum ||
      !reader.Read(&count) || count != pairs.size())
    return std::nullopt;
  std::vector<PutativePair> block(count);
  for (std::size_t i = 0; i < block.size(); ++i) {
    block[i].images = pairs[i];
    std::uint32_t matches = 0;
    if (!reader.Read(&matches) || !reader.CanHold(matches, 12)) return std::nullopt;
    block[i].matches.resize(matches);
    for (DescriptorMatch& match : block[i].matches) {
      reader.Read(&match.query);
      reader.Read(&match.train);
      reader.Read(&match.distance);
      if (match.query < 0 || match.query >= extraction.images[pairs[i].a].num_features ||
          match.train < 0 || match.train >= extraction.images[pairs[i].b].num_features)
        return std::nullopt;
    }
  }
  return block;
}

class BlockMatcher {
 public:
  BlockMatcher(const DescriptorWindow& window, const MatchStoreOptions& options, int max_features)
      : window_(window),
        options_(options),
        matcher_(max_features),
        matches_(static_cast<std::size_t>(max_features)) {}

  void Match(PutativePair* pair) {
    const DescriptorRows& a = window_.Of(pair->images.a);
    const DescriptorRows& b = window_.Of(pair->images.b);
    if (pair->images.b - pair->images.a > options_.always_neighbours &&
        matcher_.Match(a.Preview(), b.Preview(), options_.max_ratio, matches_) <
            options_.preview_matches)
      return;
    const int count = matcher_.Match(a.All(), b.All(), options_.max_ratio, matches_);
    if (count >= options_.min_matches)
      pair->matches.assign(matches_.begin(), matches_.begin() + count);
  }

 private:
  const DescriptorWindow& window_;
  const MatchStoreOptions& options_;
  DescriptorMatcher matcher_;
  std::vector<DescriptorMatch> matches_;
};

std::vector<int> ImagesOf(const std::vector<ImagePair>& pairs) {
  std::vector<int> images;
  for (const ImagePair& pair : pairs) {
    images.push_back(pair.a);
    images.push_back(pair.b);
  }
  std::sort(images.begin(), images.end());
  images.erase(std::unique(images.begin(), images.end()), images.end());
  return images;
}

}  // namespace

IoExpected<MatchSummary> MatchImages(const Extraction& extraction,
                                     const std::vector<ImagePair>& pairs, const fs::path& work,
                                     const MatchStoreOptions& options,
                                     const std::function<void(std::vector<PutativePair>)>& sink) {
  const auto start = std::chrono::steady_clock::now();
  int max_features = 1;
  for (const ExtractedImage& image : extraction.images)
    max_features = std::max(max_features, image.num_features);
  DescriptorWindow window(extraction, work, options.preview_features);
  MatchSummary summary;
  for (const std::vector<ImagePair>& group : Blocks(pairs, options)) {
    const fs::path path = BlockPath(work, BlockKey(extraction, group, options));
    auto block = Load(path, extraction, group);
    if (block) {
      summary.num_cached += static_cast<int>(group.size());
      summary.interrupted =
          options.progress && !options.progress(summary.num_pairs, static_cast<int>(pairs.size()));
    } else {
      if (!window.Hold(ImagesOf(group))) {
        return Fail({Errc::kNotFound, (work / "features").string(), "",
                     "features written by this run are gone or damaged", "run it again"});
      }
      block.emplace(group.size());
      for (std::size_t i = 0; i < group.size(); ++i) (*block)[i].images = group[i];
      const auto progress = [&](int done, int) {
        return !options.progress ||
               options.progress(summary.num_pairs + done, static_cast<int>(pairs.size()));
      };
      summary.interrupted =
          !ForEachInParallel(static_cast<int>(group.size()), options.num_threads, progress, [&] {
            return [&, matcher = std::make_shared<BlockMatcher>(window, options, max_features)](
                       int i) { matcher->Match(&(*block)[i]); };
          });
      if (!summary.interrupted) {
        if (const IoStatus status = WriteFileAtomically(path, Format(*block)); !status)
          return Fail(status.error());
      }
    }
    if (summary.interrupted) break;
    summary.num_pairs += static_cast<int>(group.size());
    std::erase_if(*block, [](const PutativePair& pair) { return pair.matches.empty(); });
    summary.num_matched += static_cast<int>(block->size());
    for (const PutativePair& pair : *block)
      summary.num_matches += static_cast<std::int64_t>(pair.matches.size());
    sink(std::move(*block));
  }
  summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return summary;
}

}  // namespace rsfm
