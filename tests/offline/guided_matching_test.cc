#include "tools/offline/guided_matching.h"

#include <gtest/gtest.h>

#include "tests/offline/made_scene.h"
#include "tests/support/rigs.h"

namespace rsfm {
namespace {

// Every descriptor occurs at six places, as on tiles: compared over whole images all are ambiguous.
Scene Tiles() {
  SurveyOptions options;
  options.lines = 1;
  options.images_per_line = 4;
  options.num_points = 600;
  options.noise_px = 0.4;
  MadeSceneOptions made;
  made.look_alikes = 6;
  const CameraConfig camera = FlatRig(0.05);
  return MakeScene(camera, MakeSurvey(*AnyCamera::Create(camera), options), made);
}

struct Count {
  int right = 0, wrong = 0;
};
Count Judge(const Scene& scene, const std::vector<VerifiedPair>& pairs) {
  Count count;
  for (const VerifiedPair& pair : pairs) {
    for (const auto& [a, b] : pair.matches) {
      const std::int32_t p = scene.images[pair.images.a].points[a];
      ++(p != kNoPoint && p == scene.images[pair.images.b].points[b] ? count.right : count.wrong);
    }
  }
  return count;
}

int InCommon(const Scene& scene, int a, int b) {
  int count = 0;
  for (const ScenePoint& point : scene.points) {
    int seen = 0;
    for (const TrackElement& e : point.track) seen += e.image == a || e.image == b ? 1 : 0;
    count += seen == 2 ? 1 : 0;
  }
  return count;
}

MatchOptions OneThread() {
  MatchOptions options;
  options.num_threads = 1;
  return options;
}

TEST(GuidedMatchingTest, FindsWhatLooksAlikeElsewhereToo) {
  const Scene scene = Tiles();
  const std::vector<ImagePair> candidates = SelectPairs(scene, OneThread());
  std::vector<VerifiedPair> pairs = MatchPairs(scene, candidates, OneThread());
  const Count before = Judge(scene, pairs);
  const int added = AddGuidedMatches(scene, candidates, OneThread(), GuidedMatchOptions(), &pairs);
  const Count after = Judge(scene, pairs);
  EXPECT_EQ(after.right + after.wrong, before.right + before.wrong + added);
  int possible = 0;
  for (const VerifiedPair& pair : pairs) possible += InCommon(scene, pair.images.a, pair.images.b);
  EXPECT_GT(possible, 500);
  EXPECT_LT(before.right, possible / 4);
  EXPECT_GT(after.right, possible * 3 / 4);
  EXPECT_LT(after.wrong, after.right / 25);
}

TEST(GuidedMatchingTest, KeepsWhatWasMatchedAndMatchesNothingTwice) {
  const Scene scene = Tiles();
  const std::vector<ImagePair> candidates = {{0, 1}};
  std::vector<VerifiedPair> pairs;
  ASSERT_GT(AddGuidedMatches(scene, candidates, OneThread(), GuidedMatchOptions(), &pairs), 30);
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_NEAR(pairs[0].b_from_a.translation.norm(), 1.0, 1e-12);
  const auto all = pairs[0].matches;
  pairs[0].matches.resize(20);
  AddGuidedMatches(scene, candidates, OneThread(), GuidedMatchOptions(), &pairs);
  for (std::size_t i = 0; i < 20; ++i) EXPECT_EQ(pairs[0].matches[i], all[i]);
  std::vector<int> uses_a(scene.images[0].features.size()), uses_b(scene.images[1].features.size());
  for (const auto& [a, b] : pairs[0].matches) {
    EXPECT_EQ(++uses_a[a], 1);
    EXPECT_EQ(++uses_b[b], 1);
  }
}

TEST(GuidedMatchingTest, ThreadsDoNotMatter) {
  const Scene scene = Tiles();
  const std::vector<ImagePair> candidates = SelectPairs(scene, OneThread());
  std::vector<VerifiedPair> one, three;
  MatchOptions threads;
  threads.num_threads = 3;
  AddGuidedMatches(scene, candidates, OneThread(), GuidedMatchOptions(), &one);
  AddGuidedMatches(scene, candidates, threads, GuidedMatchOptions(), &three);
  ASSERT_EQ(one.size(), three.size());
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].images, three[i].images);
    EXPECT_EQ(one[i].matches, three[i].matches);
  }
}

// Where the poses are wrong by more than the band nothing is made up to fit them.
TEST(GuidedMatchingTest, WrongPosesFindFew) {
  Scene scene = Tiles();
  scene.images[1].camera_from_world.translation.y() += 0.5;
  std::vector<VerifiedPair> pairs;
  AddGuidedMatches(scene, {{0, 1}}, OneThread(), GuidedMatchOptions(), &pairs);
  EXPECT_LT(Judge(scene, pairs).wrong, 20);
}

TEST(GuidedMatchingTest, ImagesWithoutPoseAreLeftAlone) {
  Scene scene = Tiles();
  scene.Unplace(1);
  std::vector<VerifiedPair> pairs;
  EXPECT_EQ(AddGuidedMatches(scene, {{0, 1}, {1, 2}}, OneThread(), GuidedMatchOptions(), &pairs),
            0);
  EXPECT_TRUE(pairs.empty());
}

}  // namespace
}  // namespace rsfm
