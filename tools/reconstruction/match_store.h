// Descriptor matches of many pairs of images, in files of some hundred pairs each: what is done
// stays done when a run is stopped, and only the descriptors of the images in work are in memory.
#pragma once

#include <filesystem>
#include <functional>
#include <vector>

#include "tools/offline/matching.h"
#include "tools/reconstruction/extraction.h"

namespace rsfm {

struct MatchStoreOptions {
  double max_ratio = 0.8;  // best to second-best descriptor distance
  int min_matches = 20;    // fewer are no pair
  // Pairs farther apart in the list than this are first tried with their largest features only.
  // [Wu 2013, 3DV, "Towards Linear-time Incremental Structure from Motion", sec. 3.1]
  int always_neighbours = 3;
  int preview_features = 400;
  int preview_matches = 6;
  int block_images = 64;  // descriptors of twice as many images are in memory at a time
  int block_pairs = 400;  // in one file
  int num_threads = 2;
  std::function<bool(int, int)> progress;  // pairs done, in all; false stops
};

struct PutativePair {
  ImagePair images;
  std::vector<DescriptorMatch> matches;  // query: of a, train: of b
};

struct MatchSummary {
  bool interrupted = false;
  int num_pairs = 0;    // tried
  int num_cached = 0;   // of these, found in the working folder
  int num_matched = 0;  // with enough matches
  std::int64_t num_matches = 0;
  double seconds = 0.0;
};

// Mutual nearest neighbours that pass the ratio test, pair by pair; `sink` gets a block at a time,
// in an order that does not depend on the number of threads or on what was stored before.
IoExpected<MatchSummary> MatchImages(const Extraction& extraction,
                                     const std::vector<ImagePair>& pairs,
                                     const std::filesystem::path& work,
                                     const MatchStoreOptions& options,
                                     const std::function<void(std::vector<PutativePair>)>& sink);

}  // namespace rsfm
