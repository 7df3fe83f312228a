#include "rsfm/mapping/descriptor_matcher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "rsfm/base/rng.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

struct Set {
  std::vector<std::uint8_t> bytes;
  DescriptorType type;
  DescriptorView View() const {
    return {bytes.data(), static_cast<int>(bytes.size()) / DescriptorStride(type), type};
  }
};

Set RandomSet(DescriptorType type, int count, Rng* rng) {
  Set set{{}, type};
  for (int i = 0; i < count * DescriptorStride(type); ++i)
    set.bytes.push_back(static_cast<std::uint8_t>(rng->Index(
        type == DescriptorType::kSift ? 92 : 256)));  // SIFT rows of about length 512 / 2
  return set;
}

// The same rows in another order, each with a little noise; row i of the result is from[i] of
// `set`.
Set Shuffled(const Set& set, const std::vector<int>& from, Rng* rng) {
  Set result{{}, set.type};
  const int stride = DescriptorStride(set.type);
  for (const int row : from) {
    for (int k = 0; k < stride; ++k) {
      int value = set.bytes[static_cast<std::size_t>(row * stride + k)];
      if (set.type == DescriptorType::kSift) {
        value = std::clamp(value + static_cast<int>(std::lround(rng->Gaussian(0, 4))), 0, 255);
      } else if (rng->Uniform() < 0.1) {
        value ^= 1 << rng->Index(8);
      }
      result.bytes.push_back(static_cast<std::uint8_t>(value));
    }
  }
  return result;
}

class DescriptorMatcherTest : public ::testing::TestWithParam<DescriptorType> {};

TEST_P(DescriptorMatcherTest, FindsThePermutation) {
  Rng rng(7);
  const Set train = RandomSet(GetParam(), 500, &rng);
  std::vector<int> from(400);
  for (int i = 0; i < 400; ++i) from[i] = (i * 37 + 11) % 500;
  const Set query = Shuffled(train, from, &rng);
  DescriptorMatcher matcher(500);
  std::vector<DescriptorMatch> matches(500);
  MallocTrap trap;
  const int count = matcher.Match(query.View(), train.View(), 0.8, matches);
  EXPECT_EQ(trap.count(), 0u);
  ASSERT_EQ(count, 400);
  for (int k = 0; k < count; ++k) {
    EXPECT_EQ(matches[k].query, k);
    EXPECT_EQ(matches[k].train, from[k]);
  }
}

// Against the definition, written the plain way.
TEST_P(DescriptorMatcherTest, IsMutualNearestWithRatio) {
  Rng rng(9);
  const Set base = RandomSet(GetParam(), 60, &rng);
  std::vector<int> from(150), from2(130);
  for (int& i : from) i = static_cast<int>(rng.Index(60));  // repeats: ambiguous rows
  for (int& i : from2) i = static_cast<int>(rng.Index(60));
  const Set query = Shuffled(base, from, &rng), train = Shuffled(base, from2, &rng);
  const auto distance = [&](int i, int j) {
    double sum = 0.0;
    for (int k = 0; k < DescriptorStride(GetParam()); ++k) {
      const int a = query.View().Row(i)[k], b = train.View().Row(j)[k];
      sum += GetParam() == DescriptorType::kSift ? (a - b) * (a - b)
                                                 : __builtin_popcount(static_cast<unsigned>(a ^ b));
    }
    return sum;
  };
  DescriptorMatcher matcher(200);
  std::vector<DescriptorMatch> matches(200);
  const int count = matcher.Match(query.View(), train.View(), 0.9, matches);
  int expected = 0;
  for (int i = 0; i < 150; ++i) {
    std::vector<std::pair<double, int>> row;
    for (int j = 0; j < 130; ++j) row.push_back({distance(i, j), j});
    std::sort(row.begin(), row.end());
    int nearest_query = 0;
    for (int q = 1; q < 150; ++q) {
      if (distance(q, row[0].second) < distance(nearest_query, row[0].second)) nearest_query = q;
    }
    const double ratio = GetParam() == DescriptorType::kSift ? 0.9 * 0.9 : 0.9;
    if (nearest_query != i || !(row[0].first < ratio * row[1].first)) continue;
    if (row[0].first > MaxDescriptorDistance(GetParam())) continue;
    ASSERT_LT(expected, count);
    EXPECT_EQ(matches[expected].query, i);
    EXPECT_EQ(matches[expected].train, row[0].second);
    EXPECT_EQ(matches[expected].distance, row[0].first);
    ++expected;
  }
  EXPECT_EQ(count, expected);
}

TEST_P(DescriptorMatcherTest, EmptyAndFullSets) {
  Rng rng(1);
  const Set set = RandomSet(GetParam(), 10, &rng);
  DescriptorMatcher matcher(10);
  std::vector<DescriptorMatch> matches(10);
  EXPECT_EQ(matcher.Match({nullptr, 0, GetParam()}, set.View(), 0.8, matches), 0);
  EXPECT_EQ(matcher.Match(set.View(), {nullptr, 0, GetParam()}, 0.8, matches), 0);
  EXPECT_EQ(matcher.Match(set.View(), set.View(), 0.8, matches), 10);
  const Set larger = RandomSet(GetParam(), 11, &rng);
  EXPECT_EQ(matcher.Match(larger.View(), set.View(), 0.8, matches), 0);  // beyond the capacity
  EXPECT_EQ(matcher.Match(set.View(), set.View(), 0.8, std::span(matches).first(4)), 4);
}

// Every kernel that this machine has, on full and partial blocks and groups, against the
// definition.
TEST(SiftBlockTest, AllKernelsMeasureTheSame) {
  Rng rng(5);
  std::vector<std::uint8_t> rows(SiftBlock::kRows * SiftBlock::kBytes),
      queries(SiftBlock::kQueries * SiftBlock::kBytes);
  for (std::uint8_t& byte : rows) byte = static_cast<std::uint8_t>(rng.Index(256));
  for (std::uint8_t& byte : queries) byte = static_cast<std::uint8_t>(rng.Index(256));
  std::fill_n(rows.begin(), SiftBlock::kBytes, std::uint8_t{255});  // the extremes
  std::fill_n(queries.begin(), SiftBlock::kBytes, std::uint8_t{0});
  for (const SiftKernel kernel :
       {SiftKernel::kPortable, SiftKernel::kAvx2, SiftKernel::kAvx512Vnni}) {
    if (!IsSupported(kernel)) continue;
    SiftBlock block(kernel);
    for (const int count : {SiftBlock::kRows, 37, 1}) {
      block.Load(rows.data(), count);
      for (int num_queries = 1; num_queries <= SiftBlock::kQueries; ++num_queries) {
        SiftBlock::Distances distances;
        std::int32_t constants[SiftBlock::kQueries];
        for (int q = 0; q < num_queries; ++q)
          constants[q] = block.Constant(&queries[q * SiftBlock::kBytes]);
        block.Measure(queries.data(), constants, num_queries, distances);
        for (int q = 0; q < num_queries; ++q)
          for (int j = 0; j < count; ++j)
            ASSERT_EQ(distances[q][j],
                      DescriptorDistance(DescriptorType::kSift, &queries[q * SiftBlock::kBytes],
                                         &rows[j * SiftBlock::kBytes]))
                << "kernel " << static_cast<int>(kernel) << ", row " << j << ", query " << q;
      }
    }
  }
  EXPECT_TRUE(IsSupported(BestSiftKernel()));
}

INSTANTIATE_TEST_SUITE_P(Types, DescriptorMatcherTest,
                         ::testing::Values(DescriptorType::kOrb, DescriptorType::kSift,
                                           DescriptorType::kAkaze),
                         [](const auto& type) { return std::string(ToString(type.param)); });

}  // namespace
}  // namespace rsfm
