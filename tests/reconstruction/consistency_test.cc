// Images that a repeated pattern has put in a wrong place are found by their stronger pairs.
#include "tools/reconstruction/consistency.h"

#include <gtest/gtest.h>

namespace rsfm {
namespace {

constexpr int kImages = 6, kMatches = 100, kFalseMatches = 40;

VerifiedPair MakePair(int a, int b, int first, int count) {
  VerifiedPair pair;
  pair.images = {a, b};
  for (int f = first; f < first + count; ++f) pair.matches.emplace_back(f, f);
  return pair;
}

// Neighbours share the features below kMatches; the last image falsely shares those above with the
// first.
class ConsistencyTest : public ::testing::Test {
 protected:
  ConsistencyTest() {
    scene_.images.resize(kImages);
    for (int i = 0; i < kImages; ++i) {
      SceneImage& image = scene_.images[i];
      image.placed = true;
      image.points.assign(kMatches + kFalseMatches, -1);
      for (int f = 0; f < kMatches; ++f) image.points[f] = f;
      if (i > 0) pairs_.push_back(MakePair(i - 1, i, 0, kMatches));
    }
  }
  // The first image stands by its false pair: points of its own, and those of the last one.
  void PutFirstToLast() {
    for (int f = 0; f < kMatches; ++f) scene_.images.front().points[f] = 1000 + f;
    for (int f = kMatches; f < kMatches + kFalseMatches; ++f) {
      scene_.images.front().points[f] = 2000 + f;
      scene_.images.back().points[f] = 2000 + f;
    }
    pairs_.push_back(MakePair(0, kImages - 1, kMatches, kFalseMatches));
  }

  Scene scene_;
  std::vector<VerifiedPair> pairs_;
};

TEST_F(ConsistencyTest, NeighboursThatAgreeAreNoContradiction) {
  EXPECT_TRUE(ContradictedImages(pairs_, scene_).empty());
}

TEST_F(ConsistencyTest, AnImageBesideItsLookAlikeIsNamed) {
  PutFirstToLast();
  EXPECT_EQ(ContradictedImages(pairs_, scene_), std::vector<int>{0});
}

TEST_F(ConsistencyTest, TwoImagesThatHoldEachOtherThereAreNamedTogether) {
  PutFirstToLast();
  // The second one too, by the first: their own pair agrees as before.
  for (int f = 0; f < kMatches; ++f) scene_.images[1].points[f] = 1000 + f;
  EXPECT_EQ(ContradictedImages(pairs_, scene_), (std::vector<int>{0, 1}));
}

TEST_F(ConsistencyTest, TheStrongerPairIsBelieved) {
  PutFirstToLast();
  pairs_.front().matches.resize(kFalseMatches - 5);
  EXPECT_TRUE(ContradictedImages(pairs_, scene_).empty());
}

TEST_F(ConsistencyTest, MatchesWithoutPointsAndUnplacedImagesSayNothing) {
  PutFirstToLast();
  Scene without = scene_;
  for (int f = 0; f < kMatches; ++f) without.images.front().points[f] = -1;
  EXPECT_TRUE(ContradictedImages(pairs_, without).empty());
  scene_.images.front().placed = false;
  EXPECT_TRUE(ContradictedImages(pairs_, scene_).empty());
}

}  // namespace
}  // namespace rsfm
