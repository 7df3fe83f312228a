#include "tools/offline/refine_scene.h"

#include <gtest/gtest.h>

#include <limits>

#include "rsfm/estimation/reprojection_residual.h"
#include "tests/offline/alignment.h"
#include "tests/offline/made_scene.h"
#include "tests/support/rigs.h"

namespace rsfm {
namespace {

SurveyOptions Lines() {
  SurveyOptions options;
  options.lines = 2;
  options.images_per_line = 6;
  options.num_points = 900;
  options.noise_px = 0.4;
  return options;
}

RefineSceneOptions OneThread() {
  RefineSceneOptions options;
  options.match.num_threads = options.bundle.num_threads = 1;
  return options;
}

Alignment Align(const Scene& scene, const Survey& truth) {
  std::vector<Vec3> found, places;
  for (std::size_t k = 0; k < scene.images.size(); ++k) {
    if (!scene.images[k].placed) continue;
    found.push_back(scene.images[k].camera_from_world.OriginOfTarget());
    places.push_back(truth.camera_from_world[k].OriginOfTarget());
  }
  return AlignPlaces(found, places);
}

// Every index agrees with the one that points back.
void ExpectConsistent(const Scene& scene) {
  for (std::size_t p = 0; p < scene.points.size(); ++p) {
    EXPECT_NE(scene.points[p].track.size(), 1u);
    for (const TrackElement& e : scene.points[p].track) {
      EXPECT_TRUE(scene.images[e.image].placed);
      EXPECT_EQ(scene.images[e.image].points[e.feature], static_cast<std::int32_t>(p));
    }
  }
  for (const SceneImage& image : scene.images) {
    for (const std::int32_t p : image.points) {
      if (p == kNoPoint) continue;
      EXPECT_FALSE(scene.points[p].track.empty());
    }
  }
}

TEST(RefineSceneTest, FromNothingButFeatures) {
  const CameraConfig config = FlatRig();
  const Survey truth = MakeSurvey(*AnyCamera::Create(config), Lines());
  Scene scene = MakeScene(config, truth, {.placed = false});
  const auto report = RefineScene(OneThread(), &scene);
  ASSERT_TRUE(report) << report.error().where;
  EXPECT_TRUE(report->from_scratch);
  EXPECT_EQ(scene.NumPlaced(), 12);
  ExpectConsistent(scene);
  EXPECT_LT(report->errors.mean_px, 0.52);  // 0.4 px in two dimensions: 0.50 px
  EXPECT_LT(Align(scene, truth).rms_m, 0.005);
  EXPECT_TRUE(report->rounds.back().bundle.gauge.scale);
}

TEST(RefineSceneTest, DriftedMapWithWrongTracks) {
  const CameraConfig config = FlatRig();
  const Survey truth = MakeSurvey(*AnyCamera::Create(config), Lines());
  Survey drifted = truth;
  Disturb(&drifted, 1, 0.004, 0.02, 0.05, 6);
  Scene scene = MakeScene(config, drifted, {.wrong_tracks = 0.05});
  const auto report = RefineScene(OneThread(), &scene);
  ASSERT_TRUE(report) << report.error().where;
  EXPECT_FALSE(report->from_scratch);
  EXPECT_EQ(scene.NumPlaced(), 12);
  EXPECT_GT(report->mean_error_before_px, 10.0);
  EXPECT_LT(report->errors.mean_px, 0.52);
  ExpectConsistent(scene);
  EXPECT_LT(Align(scene, truth).rms_m, 0.005);
}

TEST(RefineSceneTest, PlacesWhatTheMapperCouldNot) {
  const CameraConfig config = FlatRig();
  const Survey truth = MakeSurvey(*AnyCamera::Create(config), Lines());
  Scene scene = MakeScene(config, truth);
  for (const int lost : {3, 4, 11}) scene.Unplace(lost);
  ExpectConsistent(scene);
  const auto report = RefineScene(OneThread(), &scene);
  ASSERT_TRUE(report) << report.error().where;
  EXPECT_EQ(report->placed_before, 9);
  EXPECT_EQ(report->newly_placed.size(), 3u);
  EXPECT_EQ(scene.NumPlaced(), 12);
  EXPECT_LT(Align(scene, truth).rms_m, 0.005);
  EXPECT_NEAR(Align(scene, truth).scale, 1.0, 0.005);
}

// An image of another place is left out, and does no harm.
TEST(RefineSceneTest, ForeignImageIsLeftOut) {
  const CameraConfig config = FlatRig();
  const Survey truth = MakeSurvey(*AnyCamera::Create(config), Lines());
  Scene scene = MakeScene(config, truth, {.placed = false});
  SceneImage& foreign = scene.images[5];
  Rng rng(3);
  for (std::uint8_t& value : foreign.descriptors) value = static_cast<std::uint8_t>(rng.Index(90));
  const auto report = RefineScene(OneThread(), &scene);
  ASSERT_TRUE(report);
  EXPECT_FALSE(scene.images[5].placed);
  EXPECT_EQ(scene.NumPlaced(), 11);
}

// Few points in common with the map, many matches with one neighbour: the relative pose places it.
TEST(RefineSceneTest, PlacesByTheRelativePoseOfAPair) {
  const CameraConfig config = FlatRig();
  const Survey truth = MakeSurvey(*AnyCamera::Create(config), Lines());
  Scene scene = MakeScene(config, truth);
  constexpr int kLost = 11;
  scene.Unplace(kLost);
  // Of the points that its neighbour sees, the map keeps ten that both see.
  const int neighbour = 10;
  const Scene matched = MakeScene(config, truth);
  VerifiedPair pair;
  pair.images = {neighbour, kLost};
  pair.b_from_a = truth.camera_from_world[kLost] * truth.camera_from_world[neighbour].Inverse();
  pair.b_from_a.translation.normalize();
  for (std::size_t f = 0; f < matched.images[neighbour].points.size(); ++f) {
    const int point = matched.images[neighbour].points[f];
    if (point == kNoPoint) continue;
    for (const TrackElement& e : matched.points[point].track)
      if (e.image == kLost) pair.matches.emplace_back(static_cast<std::int32_t>(f), e.feature);
  }
  ASSERT_GT(pair.matches.size(), 60u);
  for (std::size_t i = 10; i < pair.matches.size(); ++i) {
    const int point = scene.images[neighbour].points[pair.matches[i].first];
    if (point != kNoPoint) scene.RemovePoint(point);
  }
  const std::vector<VerifiedPair> pairs = {pair};
  const CorrespondenceGraph graph(scene, pairs);
  PlacingOptions options;
  EXPECT_EQ(NextToPlace(graph, options, std::vector<std::uint8_t>(12, 0), scene), -1);
  std::vector<std::uint8_t> tried;
  int placed = -1;
  ASSERT_TRUE(PlaceByPair(pairs, graph, options, &tried, &scene, &placed));
  EXPECT_EQ(placed, kLost);
  const Vec3 off = scene.images[kLost].camera_from_world.OriginOfTarget() -
                   truth.camera_from_world[kLost].OriginOfTarget();
  EXPECT_LT(off.norm(), 0.02);
  ExpectConsistent(scene);
}

TEST(RefineSceneTest, InterruptionStops) {
  const CameraConfig config = FlatRig();
  Scene scene = MakeScene(config, MakeSurvey(*AnyCamera::Create(config), Lines()));
  RefineSceneOptions options = OneThread();
  int calls = 0;
  options.progress = [&calls](const std::string&, double part) {
    EXPECT_GE(part, 0.0);
    EXPECT_LE(part, 1.0);
    return ++calls < 5;
  };
  const auto report = RefineScene(options, &scene);
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->interrupted);
  EXPECT_LE(calls, 8);
}

TEST(RefineSceneTest, RefusesWithReasons) {
  const CameraConfig config = FlatRig();
  const Survey survey = MakeSurvey(*AnyCamera::Create(config), Lines());
  Scene one;
  one.camera = config;
  one.images.resize(1);
  EXPECT_EQ(RefineScene(OneThread(), &one).error().code, Errc::kNotEnoughData);
  Scene impossible = MakeScene(config, survey);
  impossible.camera.port.thickness_m = -1.0;
  EXPECT_EQ(RefineScene(OneThread(), &impossible).error().code, Errc::kInvalidArgument);
  // Features without descriptors and no map: nothing to begin with.
  Scene blind = MakeScene(config, survey, {.placed = false});
  for (SceneImage& image : blind.images) image.descriptor_type = DescriptorType::kNone;
  EXPECT_EQ(RefineScene(OneThread(), &blind).error().code, Errc::kDegenerate);
}

TEST(MatchPairsTest, DoesNotDependOnThreads) {
  const CameraConfig config = FlatRig();
  const Scene scene =
      MakeScene(config, MakeSurvey(*AnyCamera::Create(config), Lines()), {.placed = false});
  MatchOptions options;
  options.num_threads = 1;
  const std::vector<ImagePair> pairs = SelectPairs(scene, options);
  EXPECT_EQ(pairs.size(), 66u);
  const std::vector<VerifiedPair> first = MatchPairs(scene, pairs, options);
  options.num_threads = 3;
  const std::vector<VerifiedPair> second = MatchPairs(scene, pairs, options);
  ASSERT_EQ(first.size(), second.size());
  ASSERT_GT(first.size(), 10u);
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].images, second[i].images);
    EXPECT_EQ(first[i].matches, second[i].matches);
  }
}

TEST(FilterSceneTest, RemovesWhatIsWrong) {
  const CameraConfig config = FlatRig();
  const Survey survey = MakeSurvey(*AnyCamera::Create(config), Lines());
  Scene scene = MakeScene(config, survey);
  const int before = scene.NumObservations();
  scene.images[2].features[0] += Vec2(30.0, 0.0);  // one observation
  const int moved = scene.images[4].points[0];
  const int its_track = static_cast<int>(scene.points[moved].track.size());
  scene.points[moved].xyz.z() += 2.0;
  const FilterReport report = FilterScene({}, &scene);
  EXPECT_GE(report.observations, its_track);
  EXPECT_LT(report.observations, its_track + 30);
  EXPECT_EQ(report.images, 0);
  EXPECT_EQ(scene.NumObservations(), before - report.observations);
  EXPECT_EQ(scene.images[2].points[0], kNoPoint);
  ExpectConsistent(scene);
}

}  // namespace
}  // namespace rsfm
