#include "rsfm/mapping/descriptor_matcher.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstring>
#include <limits>

#include "rsfm/base/vector_clones.h"
#include "rsfm/mapping/sift_distances.h"

namespace rsfm {
namespace {

constexpr std::int32_t kFar = std::numeric_limits<std::int32_t>::max();
constexpr int kSiftBytes = SiftBlock::kBytes;

inline std::int32_t SquaredDistance(const std::uint8_t* a, const std::uint8_t* b) {
  std::int32_t sum = 0;
  for (int k = 0; k < kSiftBytes; ++k) {
    const std::int32_t difference = a[k] - b[k];
    sum += difference * difference;
  }
  return sum;
}

inline std::int32_t HammingDistance(const std::uint8_t* a, const std::uint8_t* b, int bytes) {
  std::int32_t sum = 0;
  for (int k = 0; k < bytes; k += 8) {
    std::uint64_t x, y;
    std::memcpy(&x, a + k, 8);
    std::memcpy(&y, b + k, 8);
    sum += std::popcount(x ^ y);
  }
  return sum;
}

constexpr int kBlock = SiftBlock::kRows;
constexpr int kGroup = SiftBlock::kQueries;
using Distances = SiftBlock::Distances;

RSFM_VECTOR_CLONES
void BinaryRow(const std::uint8_t* query, const std::uint8_t* train, int count, int bytes,
               std::int32_t* distances) {
  for (int j = 0; j < count; ++j) distances[j] = HammingDistance(query, train + j * bytes, bytes);
}

RSFM_VECTOR_CLONES
std::int32_t Least(const std::int32_t* values, int count) {
  std::int32_t least = kFar;
  for (int j = 0; j < count; ++j) least = std::min(least, values[j]);
  return least;
}

// Each row of train that `query` is nearer to than any before it.
RSFM_VECTOR_CLONES
void OfferToTrain(std::int32_t query, const std::int32_t* distances, int count, std::int32_t* best,
                  std::int32_t* best_query) {
  for (int j = 0; j < count; ++j) {
    const bool nearer = distances[j] < best[j];
    best[j] = nearer ? distances[j] : best[j];
    best_query[j] = nearer ? query : best_query[j];
  }
}

}  // namespace

std::int32_t DescriptorDistance(DescriptorType type, const std::uint8_t* a,
                                const std::uint8_t* b) noexcept {
  return type == DescriptorType::kSift ? SquaredDistance(a, b)
                                       : HammingDistance(a, b, DescriptorStride(type));
}

bool PassesRatio(DescriptorType type, std::int32_t best, std::int32_t second,
                 double max_ratio) noexcept {
  const double limit = type == DescriptorType::kSift ? max_ratio * max_ratio : max_ratio;
  return static_cast<double>(best) < limit * static_cast<double>(second);
}

std::int32_t MaxDescriptorDistance(DescriptorType type) noexcept {
  switch (type) {
    case DescriptorType::kSift:
      return 350 * 350;  // of vectors of length 512: an angle of 40 degrees
    case DescriptorType::kOrb:
      return 80;
    case DescriptorType::kAkaze:
      return 150;
    case DescriptorType::kNone:
      break;
  }
  return 0;
}

DescriptorMatcher::DescriptorMatcher(int max_rows)
    : DescriptorMatcher(static_cast<std::size_t>(std::max(max_rows, 0)), Capacity{}) {}

DescriptorMatcher::DescriptorMatcher(std::size_t rows, Capacity)
    : sift_kernel_(BestSiftKernel()),
      best_of_query_(rows),
      second_of_query_(rows),
      train_of_query_(rows),
      query_constants_(rows),
      best_of_train_(rows),
      query_of_train_(rows) {}

std::size_t DescriptorMatcher::bytes() const {
  return best_of_query_.bytes() + second_of_query_.bytes() + train_of_query_.bytes() +
         query_constants_.bytes() + best_of_train_.bytes() + query_of_train_.bytes();
}

// The distances of one query row to the rows of train from `start` on.
void DescriptorMatcher::Offer(int query, int start,
                              std::span<const std::int32_t> distances) noexcept {
  const int count = static_cast<int>(distances.size());
  OfferToTrain(query, distances.data(), count, &best_of_train_[start], &query_of_train_[start]);
  if (Least(distances.data(), count) >= second_of_query_[query]) return;
  std::int32_t best = best_of_query_[query], second = second_of_query_[query];
  std::int32_t best_train = train_of_query_[query];
  for (int j = 0; j < count; ++j) {
    const std::int32_t distance = distances[j];
    if (distance >= second) continue;
    if (distance < best) {
      second = best;
      best = distance;
      best_train = start + j;
    } else {
      second = distance;
    }
  }
  best_of_query_[query] = best;
  second_of_query_[query] = second;
  train_of_query_[query] = best_train;
}

int DescriptorMatcher::Match(const DescriptorView& query, const DescriptorView& train,
                             double max_ratio, std::span<DescriptorMatch> matches) noexcept {
  assert(query.type == train.type || query.count == 0 || train.count == 0);
  const auto num_train = static_cast<std::size_t>(train.count);
  const auto num_query = static_cast<std::size_t>(query.count);
  if (!best_of_train_.TryResize(num_train) || !best_of_query_.TryResize(num_query)) return 0;
  if (num_train == 0) return 0;
  second_of_query_.TryResize(num_query);
  train_of_query_.TryResize(num_query);
  query_constants_.TryResize(num_query);
  query_of_train_.TryResize(num_train);
  std::fill(best_of_train_.begin(), best_of_train_.end(), kFar);

  std::fill(best_of_query_.begin(), best_of_query_.end(), kFar);
  std::fill(second_of_query_.begin(), second_of_query_.end(), kFar);
  std::fill(train_of_query_.begin(), train_of_query_.end(), -1);
  SiftBlock block(sift_kernel_);
  const bool is_sift = train.type == DescriptorType::kSift;
  const int stride = DescriptorStride(train.type);
  for (int i = 0; is_sift && i < query.count; ++i)
    query_constants_[i] = block.Constant(query.Row(i));
  for (int start = 0; start < train.count; start += kBlock) {
    const int count = std::min(kBlock, train.count - start);
    if (is_sift) block.Load(train.Row(start), count);
    for (int first = 0; first < query.count; first += kGroup) {
      const int num_queries = std::min(kGroup, query.count - first);
      Distances distances;
      if (is_sift)
        block.Measure(query.Row(first), &query_constants_[first], num_queries, distances);
      for (int q = 0; q < num_queries; ++q) {
        if (!is_sift)
          BinaryRow(query.Row(first + q), train.Row(start), count, stride, distances[q]);
        Offer(first + q, start, {distances[q], static_cast<std::size_t>(count)});
      }
    }
  }

  const std::int32_t max_distance = MaxDescriptorDistance(query.type);
  std::size_t found = 0;
  for (int i = 0; i < query.count && found < matches.size(); ++i) {
    const std::int32_t j = train_of_query_[i];
    if (j < 0 || query_of_train_[j] != i || best_of_query_[i] > max_distance) continue;
    if (!PassesRatio(query.type, best_of_query_[i], second_of_query_[i], max_ratio)) continue;
    matches[found++] = {i, j, best_of_query_[i]};
  }
  return static_cast<int>(found);
}

}  // namespace rsfm
