#include "rsfm/mapping/descriptor_matcher.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstring>
#include <limits>

// One clone of the inner loops per vector width, chosen when the program is loaded: the distances
// are integers, so all give the same result. Not under a sanitizer, whose runtime is not up by
// then.
#if defined(__x86_64__) && defined(__gnu_linux__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define RSFM_VECTOR_CLONES __attribute__((target_clones("avx2", "popcnt", "default")))
#else
#define RSFM_VECTOR_CLONES
#endif

namespace rsfm {
namespace {

constexpr std::int32_t kFar = std::numeric_limits<std::int32_t>::max();
constexpr int kSiftBytes = 128;

// The query widened once, so that the loop is one subtraction and one multiply-add per element.
inline std::int32_t SquaredDistance(const std::int16_t* a, const std::uint8_t* b) {
  std::int32_t sum = 0;
  for (int k = 0; k < kSiftBytes; ++k) {
    const auto difference = static_cast<std::int16_t>(a[k] - b[k]);
    sum += static_cast<std::int32_t>(difference) * difference;
  }
  return sum;
}

inline void Widen(const std::uint8_t* row, std::int16_t* wide) {
  for (int k = 0; k < kSiftBytes; ++k) wide[k] = row[k];
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

// Distances of one query row to rows [0, count) of train.
RSFM_VECTOR_CLONES
void SiftRow(const std::uint8_t* query, const std::uint8_t* train, int count,
             std::int32_t* distances) {
  alignas(32) std::int16_t wide[kSiftBytes];
  Widen(query, wide);
  for (int j = 0; j < count; ++j) distances[j] = SquaredDistance(wide, train + j * kSiftBytes);
}

RSFM_VECTOR_CLONES
void BinaryRow(const std::uint8_t* query, const std::uint8_t* train, int count, int bytes,
               std::int32_t* distances) {
  for (int j = 0; j < count; ++j) distances[j] = HammingDistance(query, train + j * bytes, bytes);
}

void DistanceRow(DescriptorType type, const std::uint8_t* query, const std::uint8_t* train,
                 int count, std::int32_t* distances) {
  if (type == DescriptorType::kSift) {
    SiftRow(query, train, count, distances);
  } else {
    BinaryRow(query, train, count, DescriptorStride(type), distances);
  }
}

}  // namespace

std::int32_t DescriptorDistance(DescriptorType type, const std::uint8_t* a,
                                const std::uint8_t* b) noexcept {
  std::int32_t distance = 0;
  DistanceRow(type, a, b, 1, &distance);
  return distance;
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

  constexpr int kBlock = 64;  // distances at a time: they stay in the nearest cache
  std::int32_t distances[kBlock];
  for (int i = 0; i < query.count; ++i) {
    std::int32_t best = kFar, second = kFar, best_train = -1;
    for (int start = 0; start < train.count; start += kBlock) {
      const int count = std::min(kBlock, train.count - start);
      DistanceRow(query.type, query.Row(i), train.Row(start), count, distances);
      for (int j = 0; j < count; ++j) {
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
          query_of_train_[start + j] = i;
        }
      }
    }
    best_of_query_[i] = best;
    second_of_query_[i] = second;
    train_of_query_[i] = best_train;
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
