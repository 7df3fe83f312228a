#include "tools/offline/chance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "rsfm/base/rng.h"

namespace rsfm {
namespace {

constexpr int kWidth = 640, kHeight = 480;

std::vector<MatchedPixels> RandomMatches(int count, Rng* rng) {
  std::vector<MatchedPixels> matches;
  for (int i = 0; i < count; ++i)
    matches.push_back({{rng->Uniform(0, kWidth), rng->Uniform(0, kHeight)},
                       {rng->Uniform(0, kWidth), rng->Uniform(0, kHeight)}});
  return matches;
}

TEST(ChanceTest, AFewOfManyAreChanceMostAreNot) {
  Rng rng(1);
  const auto matches = RandomMatches(100, &rng);
  const auto with = [&](int inliers) {
    std::vector<char> is_inlier(matches.size(), 0);
    std::fill_n(is_inlier.begin(), inliers, 1);
    return LogFalseAlarms(matches, is_inlier, 3.0, kWidth, kHeight);
  };
  EXPECT_GT(with(0), 0.0);
  EXPECT_GT(with(5), 0.0);
  EXPECT_GT(with(9), 0.0);
  EXPECT_LT(with(40), -10.0);
  for (int k = 20; k < 90; k += 10) EXPECT_LT(with(k + 10), with(k));
}

// The best of many lines through five of them, among matches of which none is right.
TEST(ChanceTest, HoldsForTheBestOfRandomBands) {
  Rng rng(2);
  int alarms = 0;
  constexpr int kExperiments = 50;
  for (int experiment = 0; experiment < kExperiments; ++experiment) {
    const auto matches = RandomMatches(60, &rng);
    std::vector<char> best(matches.size(), 0);
    int most = 0;
    for (int trial = 0; trial < 400; ++trial) {  // a band of its own for each match
      std::vector<char> inlier(matches.size(), 0);
      for (int k = 0; k < 5; ++k) inlier[rng.Index(60)] = 1;
      for (std::size_t i = 0; i < matches.size(); ++i) {
        const double angle = rng.Uniform(0.0, 3.14159);
        const Vec2 normal(std::cos(angle), std::sin(angle));
        const Vec2 through(rng.Uniform(0, kWidth), rng.Uniform(0, kHeight));
        if (std::abs(normal.dot(matches[i].b - through)) < 3.0) inlier[i] = 1;
      }
      int count = 0;
      for (const char is : inlier) count += is;
      if (count <= most) continue;
      most = count;
      best = inlier;
    }
    alarms += LogFalseAlarms(matches, best, 3.0, kWidth, kHeight) < 0.0 ? 1 : 0;
  }
  EXPECT_EQ(alarms, 0);
}

// Sixty matches on three moving things are three coincidences.
TEST(ChanceTest, MatchesSideBySideCountOnce) {
  Rng rng(3);
  std::vector<MatchedPixels> matches;
  for (int thing = 0; thing < 30; ++thing) {
    const Vec2 a(80.0 * rng.Index(8) + 30.0, 80.0 * rng.Index(6) + 30.0);
    const Vec2 b(80.0 * rng.Index(8) + 30.0, 80.0 * rng.Index(6) + 30.0);
    for (int i = 0; i < 20; ++i)
      matches.push_back({a + Vec2(rng.Uniform(0, 20), rng.Uniform(0, 20)),
                         b + Vec2(rng.Uniform(0, 20), rng.Uniform(0, 20))});
  }
  std::vector<char> is_inlier(matches.size(), 0);
  std::fill_n(is_inlier.begin(), 8 * 20, 1);
  EXPECT_GT(LogFalseAlarms(matches, is_inlier, 3.0, kWidth, kHeight), 0.0);
  std::fill_n(is_inlier.begin(), 20 * 20, 1);
  EXPECT_LT(LogFalseAlarms(matches, is_inlier, 3.0, kWidth, kHeight), 0.0);
}

}  // namespace
}  // namespace rsfm
