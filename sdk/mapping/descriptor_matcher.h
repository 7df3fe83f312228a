// Matching of descriptors by brute force, in fixed memory, written for vector units.
//
// Distances: the squared Euclidean one of SIFT's bytes, the Hamming one of binary descriptors. The
// ratio test [Lowe 2004, IJCV, sec. 7.1] compares Euclidean lengths and Hamming counts.
#pragma once

#include <cstdint>
#include <span>

#include "rsfm/base/fixed_vector.h"
#include "rsfm/mapping/feature.h"
#include "rsfm/mapping/sift_distances.h"

namespace rsfm {

struct DescriptorMatch {
  std::int32_t query = -1;
  std::int32_t train = -1;
  std::int32_t distance = 0;
};

std::int32_t DescriptorDistance(DescriptorType type, const std::uint8_t* a,
                                const std::uint8_t* b) noexcept;
// Whether `best` is clearly nearer than `second`.
bool PassesRatio(DescriptorType type, std::int32_t best, std::int32_t second,
                 double max_ratio) noexcept;
// Beyond this even an only candidate is no match.
std::int32_t MaxDescriptorDistance(DescriptorType type) noexcept;

class DescriptorMatcher {
 public:
  // The only place that allocates: for descriptor sets of at most this many rows.
  explicit DescriptorMatcher(int max_rows);

  // Pairs that are each other's nearest, pass the ratio test from the query's side and are not
  // farther apart than MaxDescriptorDistance, in the order of the query's rows. Writes at most
  // matches.size(), returns how many. Precondition: one type; at most max_rows each.
  int Match(const DescriptorView& query, const DescriptorView& train, double max_ratio,
            std::span<DescriptorMatch> matches) noexcept;

  std::size_t bytes() const;

 private:
  struct Capacity {};
  DescriptorMatcher(std::size_t rows, Capacity);
  void Offer(int query, int start, std::span<const std::int32_t> distances) noexcept;

  SiftKernel sift_kernel_;
  FixedVector<std::int32_t> best_of_query_, second_of_query_, train_of_query_, query_constants_;
  FixedVector<std::int32_t> best_of_train_, query_of_train_;
};

}  // namespace rsfm
