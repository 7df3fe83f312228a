// Which images look alike, without a vocabulary that must be learnt: each descriptor falls into the
// cells of a few random partitions of descriptor space, and images that fill the same rare cells
// are alike.   [Datar, Immorlica, Indyk & Mirrokni 2004, SCG, sign projections; Sivic & Zisserman
// 2003, ICCV, the weighting]
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "tools/reconstruction/image_features.h"

namespace rsfm {

struct SignatureOptions {
  int max_features = 600;  // the largest of an image
  int tables = 4;
  int bits = 12;  // cells of each table: 2 ^ bits
  std::uint64_t seed = 1;
};

// The cells that an image's descriptors fall into, sorted: table * 2^bits + cell.
using ImageSignature = std::vector<std::uint32_t>;
ImageSignature ComputeSignature(const ImageFeatures& features, const SignatureOptions& options);

// For each image the `count` most similar others, most similar first: the cosine of the vectors of
// cell counts, each weighted by how few images have the cell. Images that share no cell are left
// out.
std::vector<std::vector<int>> MostSimilar(std::span<const ImageSignature> signatures, int count);

}  // namespace rsfm
