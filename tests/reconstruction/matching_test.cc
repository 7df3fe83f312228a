// Features on disk, which pairs are tried, and matches that outlive a run.
#include <gtest/gtest.h>

#include <fstream>

#include "rsfm/base/rng.h"
#include "tests/support/temporary_folder.h"
#include "tools/reconstruction/match_store.h"
#include "tools/reconstruction/pair_selection.h"

namespace rsfm {
namespace {

ImageFeatures RandomFeatures(int count, std::uint64_t seed) {
  Rng rng(seed);
  ImageFeatures features;
  features.type = DescriptorType::kSift;
  for (int i = 0; i < count; ++i) {
    features.pixels.emplace_back(static_cast<float>(rng.Uniform(0.0, 640.0)),
                                 static_cast<float>(rng.Uniform(0.0, 480.0)));
    features.sizes_px.push_back(static_cast<float>(rng.Uniform(2.0, 20.0)));
    features.colours.push_back({1, 2, static_cast<std::uint8_t>(i)});
    for (int k = 0; k < 128; ++k)
      features.descriptors.push_back(static_cast<std::uint8_t>(rng.Index(90)));
  }
  return features;
}

// Images of a long strip: image i sees points 40 i ... 40 i + 119, so 2/3 of the next.
class StripTest : public ::testing::Test {
 protected:
  void MakeImages(int count) {
    const ImageFeatures strip = RandomFeatures(40 * count + 80, 5);
    for (int i = 0; i < count; ++i) {
      ImageFeatures features;
      features.type = strip.type;
      for (int p = 40 * i; p < 40 * i + 120; ++p) {
        features.pixels.push_back(strip.pixels[p]);
        features.sizes_px.push_back(strip.sizes_px[p]);
        features.colours.push_back(strip.colours[p]);
        features.descriptors.insert(features.descriptors.end(), strip.descriptors.begin() + 128 * p,
                                    strip.descriptors.begin() + 128 * (p + 1));
      }
      ExtractedImage image;
      image.name = "image" + std::to_string(i) + ".png";
      image.key = static_cast<std::uint64_t>(i) + 1;
      image.num_features = features.Size();
      ASSERT_TRUE(WriteFeatures(FeaturesPath(folder_.path(), image.name), image.key, features));
      extraction_.images.push_back(image);
    }
  }

  TemporaryFolder folder_;
  Extraction extraction_;
};

TEST(FeaturesFileTest, ComesBackAsItWas) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "a.bin";
  const ImageFeatures features = RandomFeatures(50, 1);
  ASSERT_TRUE(WriteFeatures(path, 77, features));
  const auto read = ReadFeatures(path, 77);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->pixels, features.pixels);
  EXPECT_EQ(read->sizes_px, features.sizes_px);
  EXPECT_EQ(read->colours, features.colours);
  EXPECT_EQ(read->descriptors, features.descriptors);
}

TEST(FeaturesFileTest, AnotherKeyADamagedByteOrACutIsNoFile) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "a.bin";
  ASSERT_TRUE(WriteFeatures(path, 77, RandomFeatures(50, 1)));
  EXPECT_FALSE(ReadFeatures(path, 78));
  EXPECT_FALSE(ReadFeatures(folder.path() / "absent.bin", 77));
  {
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(500);
    file.put('\x5a');
  }
  EXPECT_FALSE(ReadFeatures(path, 77));
  ASSERT_TRUE(WriteFeatures(path, 77, RandomFeatures(50, 1)));
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 1);
  EXPECT_FALSE(ReadFeatures(path, 77));
}

TEST_F(StripTest, FewImagesAreAllPaired) {
  MakeImages(6);
  const PairSelection selection = SelectImagePairs(extraction_, folder_.path(), {}, {});
  EXPECT_TRUE(selection.exhaustive);
  EXPECT_EQ(selection.pairs.size(), 15u);
}

TEST_F(StripTest, ImagesThatLookAlikeArePairedWhateverTheirOrder) {
  MakeImages(30);
  // An order in which neighbours of the strip lie far apart.
  std::vector<int> place(30);
  Extraction shuffled;
  for (int i = 0; i < 30; ++i) {
    place[i] = (i * 7) % 30;
    shuffled.images.push_back(extraction_.images[place[i]]);
  }
  PairSelectionOptions options;
  options.exhaustive_up_to = 0;
  options.sequence_neighbours = 0;
  options.similar_neighbours = 6;
  options.num_threads = 1;
  const PairSelection selection = SelectImagePairs(shuffled, folder_.path(), {}, options);
  int found = 0;
  for (const ImagePair& pair : selection.pairs)
    found += std::abs(place[pair.a] - place[pair.b]) == 1 ? 1 : 0;
  EXPECT_EQ(found, 29);
  EXPECT_LT(selection.pairs.size(), 181u);
}

TEST_F(StripTest, NavigationPairsWhatIsNear) {
  MakeImages(20);
  std::vector<std::optional<Vec3>> places;
  for (int i = 0; i < 20; ++i) places.emplace_back(Vec3(i % 10, i / 10, 0.0));  // two lines
  PairSelectionOptions options;
  options.exhaustive_up_to = 0;
  options.sequence_neighbours = 0;
  options.spatial_neighbours = 3;
  options.similar_neighbours = 0;
  const PairSelection selection = SelectImagePairs(extraction_, folder_.path(), places, options);
  for (int i = 0; i < 10; ++i)
    EXPECT_TRUE(
        std::binary_search(selection.pairs.begin(), selection.pairs.end(), ImagePair{i, i + 10}))
        << i;
}

TEST_F(StripTest, MatchesAreKeptForTheNextRun) {
  MakeImages(8);
  const auto pairs = SelectImagePairs(extraction_, folder_.path(), {}, {}).pairs;
  MatchStoreOptions options;
  options.block_images = 4;
  options.block_pairs = 5;
  const auto run = [&](int threads, int stop_after, std::vector<PutativePair>* found) {
    options.num_threads = threads;
    options.progress = [stop_after](int done, int) { return done < stop_after; };
    return MatchImages(extraction_, pairs, folder_.path(), options,
                       [found](std::vector<PutativePair> block) {
                         found->insert(found->end(), block.begin(), block.end());
                       });
  };
  std::vector<PutativePair> stopped, first, second;
  const auto interrupted = run(1, 12, &stopped);
  ASSERT_TRUE(interrupted);
  EXPECT_TRUE(interrupted->interrupted);
  const auto continued = run(2, 1000, &first);
  ASSERT_TRUE(continued);
  EXPECT_FALSE(continued->interrupted);
  EXPECT_EQ(continued->num_pairs, static_cast<int>(pairs.size()));
  EXPECT_GE(continued->num_cached, 5);
  EXPECT_LT(continued->num_cached, static_cast<int>(pairs.size()));
  const auto again = run(1, 1000, &second);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->num_cached, static_cast<int>(pairs.size()));
  ASSERT_EQ(first.size(), second.size());
  int neighbours = 0;
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].images, second[i].images);
    ASSERT_EQ(first[i].matches.size(), second[i].matches.size());
    const int apart = first[i].images.b - first[i].images.a;
    neighbours += apart == 1 ? 1 : 0;
    for (std::size_t m = 0; m < first[i].matches.size(); ++m) {
      EXPECT_EQ(first[i].matches[m].query, second[i].matches[m].query);
      EXPECT_EQ(first[i].matches[m].query - first[i].matches[m].train, 40 * apart);
    }
  }
  EXPECT_EQ(neighbours, 7);
}

}  // namespace
}  // namespace rsfm
