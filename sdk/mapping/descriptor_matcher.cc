#include "rsfm/mapping/descriptor_matcher.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstring>
#include <limits>

#include "rsfm/mapping/vector_clones.h"

namespace rsfm {
namespace {

constexpr std::int32_t kFar = std::numeric_limits<std::int32_t>::max();
constexpr int kSiftBytes = 128;

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

constexpr int kBlock = 64;  // rows of train at a time: widened, they stay in the nearest cache
constexpr int kGroup = 4;   // rows of query at a time: each load of a train row serves them all

// A block of train's rows, in the form in which distances are fastest.
struct TrainBlock {
  const std::uint8_t* rows = nullptr;
  int count = 0;
  alignas(32) std::int16_t wide[kBlock * kSiftBytes];  // SIFT only
  std::int32_t squared_norms[kBlock];
};
using Distances = std::int32_t[kGroup][kBlock];

RSFM_VECTOR_CLONES
void Widen(const std::uint8_t* rows, int count, std::int16_t* wide, std::int32_t* squared_norms) {
  for (int i = 0; i < count; ++i) {
    std::int32_t sum = 0;
    for (int k = 0; k < kSiftBytes; ++k) {
      const std::int16_t value = rows[i * kSiftBytes + k];
      wide[i * kSiftBytes + k] = value;
      sum += static_cast<std::int32_t>(value) * value;
    }
    squared_norms[i] = sum;
  }
}

// |a - b|^2 = |a|^2 + |b|^2 - 2 a.b, which is exact in integers.
RSFM_VECTOR_CLONES
void SiftDistances(const std::int16_t* queries, const std::int32_t* query_norms,
                   const TrainBlock& block, Distances& distances) {
  for (int j = 0; j < block.count; ++j) {
    const std::int16_t* b = block.wide + j * kSiftBytes;
    std::int32_t dot0 = 0, dot1 = 0, dot2 = 0, dot3 = 0;
    for (int k = 0; k < kSiftBytes; ++k) {
      const std::int32_t value = b[k];
      dot0 += queries[k] * value;
      dot1 += queries[k + kSiftBytes] * value;
      dot2 += queries[k + 2 * kSiftBytes] * value;
      dot3 += queries[k + 3 * kSiftBytes] * value;
    }
    distances[0][j] = query_norms[0] + block.squared_norms[j] - 2 * dot0;
    distances[1][j] = query_norms[1] + block.squared_norms[j] - 2 * dot1;
    distances[2][j] = query_norms[2] + block.squared_norms[j] - 2 * dot2;
    distances[3][j] = query_norms[3] + block.squared_norms[j] - 2 * dot3;
  }
}

RSFM_VECTOR_CLONES
void BinaryRow(const std::uint8_t* query, const std::uint8_t* train, int count, int bytes,
               std::int32_t* distances) {
  for (int j = 0; j < count; ++j) distances[j] = HammingDistance(query, train + j * bytes, bytes);
}

// Distances of `num_queries` rows, at most kGroup, to those of the block.
void GroupDistances(DescriptorType type, const std::uint8_t* queries, int num_queries,
                    const TrainBlock& block, Distances& distances) {
  if (type == DescriptorType::kSift) {
    alignas(32) std::int16_t wide[kGroup * kSiftBytes] = {};
    std::int32_t norms[kGroup] = {};
    Widen(queries, num_queries, wide, norms);
    SiftDistances(wide, norms, block, distances);
    return;
  }
  const int stride = DescriptorStride(type);
  for (int q = 0; q < num_queries; ++q)
    BinaryRow(queries + q * stride, block.rows, block.count, stride, distances[q]);
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
    : best_of_query_(rows),
      second_of_query_(rows),
      train_of_query_(rows),
      best_of_train_(rows),
      query_of_train_(rows) {}

std::size_t DescriptorMatcher::bytes() const {
  return best_of_query_.bytes() + second_of_query_.bytes() + train_of_query_.bytes() +
         best_of_train_.bytes() + query_of_train_.bytes();
}

// The distances of one query row to the rows of train from `start` on.
void DescriptorMatcher::Offer(int query, int start,
                              std::span<const std::int32_t> distances) noexcept {
  std::int32_t best = best_of_query_[query], second = second_of_query_[query];
  std::int32_t best_train = train_of_query_[query];
  for (int j = 0; j < static_cast<int>(distances.size()); ++j) {
    const std::int32_t distance = distances[j];
    if (distance < second) {
      if (distance < best) {
        second = best;
        best = distance;
        best_train = start + j;
      } else {
        second = distance;
      }
    }
    if (distance < best_of_train_[start + j]) {
      best_of_train_[start + j] = distance;
      query_of_train_[start + j] = query;
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
  query_of_train_.TryResize(num_train);
  std::fill(best_of_train_.begin(), best_of_train_.end(), kFar);

  std::fill(best_of_query_.begin(), best_of_query_.end(), kFar);
  std::fill(second_of_query_.begin(), second_of_query_.end(), kFar);
  std::fill(train_of_query_.begin(), train_of_query_.end(), -1);
  TrainBlock block;
  for (int start = 0; start < train.count; start += kBlock) {
    block.rows = train.Row(start);
    block.count = std::min(kBlock, train.count - start);
    if (train.type == DescriptorType::kSift)
      Widen(block.rows, block.count, block.wide, block.squared_norms);
    for (int first = 0; first < query.count; first += kGroup) {
      const int num_queries = std::min(kGroup, query.count - first);
      Distances distances;
      GroupDistances(query.type, query.Row(first), num_queries, block, distances);
      for (int q = 0; q < num_queries; ++q)
        Offer(first + q, start, {distances[q], static_cast<std::size_t>(block.count)});
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
