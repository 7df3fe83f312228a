// Which pairs of images are worth matching.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "rsfm/base/rigid3.h"
#include "tools/offline/matching.h"
#include "tools/reconstruction/extraction.h"
#include "tools/reconstruction/image_signature.h"

namespace rsfm {

struct PairSelectionOptions {
  int exhaustive_up_to = 150;    // images: with no more, every pair
  int sequence_neighbours = 10;  // images after each in the order of time or names
  int spatial_neighbours = 40;   // nearest by navigation
  int similar_neighbours = 30;   // by appearance; where navigation knows places, half as many
  SignatureOptions signature;
  int num_threads = 2;
  std::function<bool(int, int)> progress;  // images looked at, in all; false stops
};

struct PairSelection {
  bool interrupted = false;
  bool exhaustive = false;
  int num_from_sequence = 0, num_from_places = 0, num_from_similarity = 0;  // each may be shared
  std::vector<ImagePair> pairs;  // sorted, without repetition
};

// `places`: per image where navigation has it, as far as it does; empty: no navigation.
PairSelection SelectImagePairs(const Extraction& extraction, const std::filesystem::path& work,
                               const std::vector<std::optional<Vec3>>& places,
                               const PairSelectionOptions& options);

}  // namespace rsfm
