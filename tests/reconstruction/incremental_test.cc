#include "tools/reconstruction/incremental.h"

#include <gtest/gtest.h>

#include "tests/offline/alignment.h"
#include "tests/offline/made_scene.h"
#include "tests/support/rigs.h"
#include "tools/reconstruction/next_image.h"

namespace rsfm {
namespace {

// Two lines of five images, as nothing but features and verified pairs.
class IncrementalTest : public ::testing::Test {
 protected:
  IncrementalTest() {
    SurveyOptions survey;
    survey.num_points = 1500;
    survey.noise_px = 0.4;
    survey_ = MakeSurvey(*AnyCamera::Create(FlatRig()), survey);
    MadeSceneOptions made;
    made.placed = false;
    scene_ = MakeScene(FlatRig(), survey_, made);
    MatchOptions match;
    match.num_threads = 1;
    match.all_unplaced_up_to = 100;
    pairs_ = MatchPairs(scene_, SelectPairs(scene_, match), match);
    options_.bundle.num_threads = 1;
    options_.start.range_m = 3.0;
  }

  Alignment Align(const MapSnapshot& map) const {
    std::vector<Vec3> found, places;
    for (const auto& [image, pose] : map.poses) {
      found.push_back(pose.OriginOfTarget());
      places.push_back(survey_.camera_from_world[image].OriginOfTarget());
    }
    return AlignPlaces(found, places);
  }

  Survey survey_;
  Scene scene_;
  std::vector<VerifiedPair> pairs_;
  IncrementalOptions options_;
};

TEST_F(IncrementalTest, PlacesAllImagesOfASurvey) {
  const auto result = ReconstructIncrementally(options_, pairs_, "", &scene_);
  ASSERT_TRUE(result) << result.error().where;
  ASSERT_EQ(result->models.size(), 1u);
  const IncrementalModel& model = result->models[0];
  EXPECT_EQ(model.map.poses.size(), scene_.images.size());
  EXPECT_LT(Align(model.map).rms_m, 0.02);
  EXPECT_LT(model.report.errors.rms_px, 0.8);
  EXPECT_GT(model.report.num_points, 500);
  EXPECT_FALSE(model.report.scale_held) << "a calibrated port is asked for the scale";
}

TEST_F(IncrementalTest, AKnownBaselineGivesTheScale) {
  options_.start.baseline = [this](int a, int b) {
    const double length = (survey_.camera_from_world[a].OriginOfTarget() -
                           survey_.camera_from_world[b].OriginOfTarget())
                              .norm();
    return std::optional(KnownBaseline{length, 1e-3 * length});
  };
  options_.bundle.port.distance = true;  // whose refinement leaves the scale to the baseline
  const auto result = ReconstructIncrementally(options_, pairs_, "", &scene_);
  ASSERT_TRUE(result);
  const IncrementalModel& model = result->models[0];
  EXPECT_TRUE(model.report.start.baseline_from_navigation);
  EXPECT_TRUE(model.report.scale_held);
  EXPECT_NEAR(Align(model.map).scale, 1.0, 0.02);
}

TEST_F(IncrementalTest, ImagesThatDoNotConnectBecomeTwoModels) {
  std::erase_if(
      pairs_, [](const VerifiedPair& pair) { return (pair.images.a < 5) != (pair.images.b < 5); });
  const auto result = ReconstructIncrementally(options_, pairs_, "", &scene_);
  ASSERT_TRUE(result);
  ASSERT_EQ(result->models.size(), 2u);
  std::vector<int> seen(scene_.images.size(), 0);
  for (const IncrementalModel& model : result->models) {
    const bool first_half = model.map.poses[0].first < 5;
    for (const auto& [image, pose] : model.map.poses) {
      EXPECT_EQ(image < 5, first_half);
      ++seen[image];
    }
    EXPECT_LT(Align(model.map).rms_m, 0.02);
  }
  for (const int count : seen) EXPECT_EQ(count, 1);
}

TEST_F(IncrementalTest, WithoutPairsThereIsNothingToBeginWith) {
  const auto result = ReconstructIncrementally(options_, {}, "", &scene_);
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, Errc::kDegenerate);
}

TEST_F(IncrementalTest, StoppedRunsContinueToTheSameResult) {
  std::vector<std::string> checkpoints;
  options_.checkpoint = [&](const std::string& bytes) {
    checkpoints.push_back(bytes);
    return true;
  };
  Scene whole = scene_;
  const auto expected = ReconstructIncrementally(options_, pairs_, "", &whole);
  ASSERT_TRUE(expected);
  ASSERT_GE(checkpoints.size(), 2u);
  const std::string middle = checkpoints[checkpoints.size() / 2];
  const auto continued = ReconstructIncrementally(options_, pairs_, middle, &scene_);
  ASSERT_TRUE(continued);
  EXPECT_TRUE(continued->resumed);
  std::string a, b;
  AppendSnapshot(expected->models[0].map, &a);
  AppendSnapshot(continued->models[0].map, &b);
  EXPECT_EQ(a, b);
}

TEST_F(IncrementalTest, ADamagedCheckpointIsNoCheckpoint) {
  std::string checkpoint;
  options_.checkpoint = [&](const std::string& bytes) {
    checkpoint = bytes;
    return true;
  };
  Scene whole = scene_;
  ASSERT_TRUE(ReconstructIncrementally(options_, pairs_, "", &whole));
  checkpoint.resize(checkpoint.size() / 2);
  const auto result = ReconstructIncrementally(options_, pairs_, checkpoint, &scene_);
  ASSERT_TRUE(result);
  EXPECT_FALSE(result->resumed);
  EXPECT_EQ(result->models[0].map.poses.size(), scene_.images.size());
}

TEST_F(IncrementalTest, ProgressStopsTheRun) {
  int calls = 0;
  options_.progress = [&](const std::string&, double) { return ++calls < 8; };
  const auto result = ReconstructIncrementally(options_, pairs_, "", &scene_);
  ASSERT_TRUE(result);
  EXPECT_TRUE(result->interrupted);
  EXPECT_TRUE(result->models.empty());
}

TEST_F(IncrementalTest, AWrongNormalIsFound) {
  scene_.camera.port.normal = Vec3(0.0, 0.0, 1.0);
  options_.bundle.port.normal = true;
  const auto result = ReconstructIncrementally(options_, pairs_, "", &scene_);
  ASSERT_TRUE(result);
  const MapSnapshot& map = result->models[0].map;
  EXPECT_EQ(map.poses.size(), scene_.images.size());
  EXPECT_LT((map.camera.port.normal - FlatRig().port.normal).norm(), 0.01);
}

// What the search along the curves finds once all is placed ends in the tracks.
TEST_F(IncrementalTest, MatchesFoundAgainJoinTheModel) {
  const std::vector<VerifiedPair> all = pairs_;
  for (VerifiedPair& pair : pairs_) {
    std::vector<std::pair<std::int32_t, std::int32_t>> half;
    for (std::size_t i = 0; i < pair.matches.size(); i += 2) half.push_back(pair.matches[i]);
    pair.matches = half;
  }
  Scene without = scene_;
  const auto before = ReconstructIncrementally(options_, pairs_, "", &without);
  ASSERT_TRUE(before);
  int calls = 0;
  options_.match_again = [&](const Scene& scene, std::vector<VerifiedPair>* pairs) {
    ++calls;
    EXPECT_EQ(scene.NumPlaced(), static_cast<int>(scene.images.size()));
    EXPECT_EQ(pairs->size(), all.size());
    *pairs = all;
  };
  const auto after = ReconstructIncrementally(options_, pairs_, "", &scene_);
  ASSERT_TRUE(after);
  EXPECT_EQ(calls, 1);
  EXPECT_GT(after->models[0].report.num_observations,
            1.1 * before->models[0].report.num_observations);
  EXPECT_LT(Align(after->models[0].map).rms_m, 0.02);
}

// Noise of 0.4 px where one is first believed: the last adjustment has it as it is.
TEST_F(IncrementalTest, TheNoiseIsFoundToo) {
  const auto result = ReconstructIncrementally(options_, pairs_, "", &scene_);
  ASSERT_TRUE(result);
  EXPECT_NEAR(result->models[0].report.sigma_px, 0.35, 0.1);
  EXPECT_NEAR(result->models[0].report.loss_scale, 1.1774, 1e-6);
}

TEST_F(IncrementalTest, TheStrongestNeighbourGoesFirst) {
  scene_.images[0].placed = true;
  const int point = scene_.AddPoint(Vec3::Zero());
  for (int f = 0; f < static_cast<int>(scene_.images[0].features.size()); ++f)
    scene_.Observe(point, {0, f});
  const CorrespondenceGraph graph(scene_, pairs_);
  NextImage next(scene_, pairs_);
  const std::vector<std::uint8_t> open(scene_.images.size(), 0);
  const int chosen = next.Choose(graph, 20, open, scene_);
  ASSERT_GT(chosen, 0);
  std::size_t strongest = 0, of_chosen = 0;
  for (const VerifiedPair& pair : pairs_) {
    if (pair.images.a != 0) continue;
    strongest = std::max(strongest, pair.matches.size());
    if (pair.images.b == chosen) of_chosen = pair.matches.size();
  }
  EXPECT_GE(of_chosen, 0.7 * static_cast<double>(strongest));
  const std::vector<std::uint8_t> closed(scene_.images.size(), 1);
  EXPECT_EQ(next.Choose(graph, 20, closed, scene_), -1);
}

}  // namespace
}  // namespace rsfm
