#include "tools/reconstruction/image_signature.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <unordered_map>

#include "rsfm/base/rng.h"

namespace rsfm {
namespace {

// The rows of the image's largest features.
std::vector<int> LargestRows(const ImageFeatures& features, int count) {
  std::vector<int> rows(static_cast<std::size_t>(features.Size()));
  std::iota(rows.begin(), rows.end(), 0);
  std::stable_sort(rows.begin(), rows.end(), [&features](int a, int b) {
    return features.sizes_px[a] > features.sizes_px[b];
  });
  rows.resize(std::min(rows.size(), static_cast<std::size_t>(count)));
  return rows;
}

// One bit: which of two bytes of SIFT is the larger, sums of four at random places on each side;
// of a binary descriptor, one of its bits. Differences of sums are free of a common offset.
struct BitTest {
  int plus[4], minus[4];
};

std::vector<BitTest> MakeTests(const SignatureOptions& options, int bytes) {
  Rng rng(options.seed);
  std::vector<BitTest> tests(static_cast<std::size_t>(options.tables * options.bits));
  for (BitTest& test : tests) {
    for (int& i : test.plus) i = static_cast<int>(rng.Index(static_cast<std::uint32_t>(bytes)));
    for (int& i : test.minus) i = static_cast<int>(rng.Index(static_cast<std::uint32_t>(bytes)));
  }
  return tests;
}

bool Passes(const BitTest& test, DescriptorType type, const std::uint8_t* row) {
  if (type != DescriptorType::kSift) return ((row[test.plus[0]] >> (test.minus[0] % 8)) & 1) != 0;
  int sum = 0;
  for (const int i : test.plus) sum += row[i];
  for (const int i : test.minus) sum -= row[i];
  return sum > 0;
}

struct Entry {
  int image = 0;
  float weight = 0.0f;
};

}  // namespace

ImageSignature ComputeSignature(const ImageFeatures& features, const SignatureOptions& options) {
  ImageSignature signature;
  const int bytes = DescriptorBytes(features.type);
  if (bytes == 0) return signature;
  const std::vector<BitTest> tests = MakeTests(options, bytes);
  const DescriptorView descriptors = features.Descriptors();
  for (const int row : LargestRows(features, options.max_features)) {
    for (int t = 0; t < options.tables; ++t) {
      std::uint32_t cell = 0;
      for (int b = 0; b < options.bits; ++b)
        cell = cell << 1 |
               (Passes(tests[t * options.bits + b], features.type, descriptors.Row(row)) ? 1u : 0u);
      signature.push_back((static_cast<std::uint32_t>(t) << options.bits) + cell);
    }
  }
  std::sort(signature.begin(), signature.end());
  return signature;
}

std::vector<std::vector<int>> MostSimilar(std::span<const ImageSignature> signatures, int count) {
  const int num_images = static_cast<int>(signatures.size());
  std::unordered_map<std::uint32_t, std::vector<Entry>> cells;
  for (int i = 0; i < num_images; ++i) {
    const ImageSignature& signature = signatures[i];
    for (std::size_t k = 0; k < signature.size();) {
      std::size_t end = k;
      while (end < signature.size() && signature[end] == signature[k]) ++end;
      // Square roots keep one repeated pattern from outvoting the rest.
      cells[signature[k]].push_back({i, std::sqrt(static_cast<float>(end - k))});
      k = end;
    }
  }
  std::vector<double> norms(signatures.size(), 0.0);
  for (auto& [cell, entries] : cells) {
    const float weight =
        std::log(static_cast<float>(num_images + 1) / static_cast<float>(entries.size()));
    for (Entry& entry : entries) {
      entry.weight *= weight;
      norms[entry.image] += static_cast<double>(entry.weight) * entry.weight;
    }
  }
  std::vector<std::vector<int>> similar(signatures.size());
  std::vector<double> scores(signatures.size());
  for (int i = 0; i < num_images; ++i) {
    std::fill(scores.begin(), scores.end(), 0.0);
    const ImageSignature& signature = signatures[i];
    for (std::size_t k = 0; k < signature.size(); ++k) {
      if (k > 0 && signature[k] == signature[k - 1]) continue;
      const std::vector<Entry>& entries = cells[signature[k]];
      const auto own = std::lower_bound(entries.begin(), entries.end(), i,
                                        [](const Entry& e, int image) { return e.image < image; });
      for (const Entry& e : entries) scores[e.image] += static_cast<double>(own->weight) * e.weight;
    }
    std::vector<std::pair<double, int>> order;
    for (int j = 0; j < num_images; ++j)
      if (j != i && scores[j] > 0.0) order.emplace_back(-scores[j] / std::sqrt(norms[j]), j);
    const auto kept = std::min(order.size(), static_cast<std::size_t>(count));
    std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(kept),
                      order.end());
    for (std::size_t k = 0; k < kept; ++k) similar[i].push_back(order[k].second);
  }
  return similar;
}

}  // namespace rsfm
