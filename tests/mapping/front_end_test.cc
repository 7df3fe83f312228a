#include "rsfm/mapping/front_end.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <vector>

#include "rsfm/mapping/descriptor_matcher.h"
#include "tests/mapping/blob_image.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr FrameHints kDescribed{.want_descriptors = true};

std::unique_ptr<FrontEnd> Make(const MapperOptions& options) {
  return std::move(*FrontEnd::Create(options, BlobImage::kWidth, BlobImage::kHeight));
}

struct Bias {
  Vec2 mean = Vec2::Zero();
  int count = 0;
};

// Of the features within two sigma of a blob, from its centre.
Bias BiasOf(std::span<const Feature> features, const BlobImage& image) {
  Bias bias;
  for (const Feature& feature : features) {
    for (const Blob& blob : image.blobs()) {
      const Vec2 error = feature.pixel() - blob.pixel;
      if (error.norm() > 2.0 * blob.sigma_px) continue;
      bias.mean += error;
      ++bias.count;
    }
  }
  bias.mean /= std::max(bias.count, 1);
  return bias;
}

// The convention of pixels: half a pixel of error would be three times the tolerance.
TEST(FrontEnd, FindsBlobsWhereTheyAre) {
  const BlobImage image;
  struct Case {
    DescriptorType type;
    int first_octave;
    double tolerance_px;
  };
  for (const auto& [type, first_octave, tolerance_px] :
       {Case{DescriptorType::kSift, -1, 0.06}, Case{DescriptorType::kSift, 0, 0.06},
        Case{DescriptorType::kAkaze, -1, 0.15}}) {
    MapperOptions options;
    options.descriptor = type;
    options.sift_first_octave = first_octave;
    options.max_features = 60;  // so many there are as it is
    const auto front_end = Make(options);
    const auto frame = front_end->Process(image.View(), 1, {});
    ASSERT_TRUE(frame.has_value());
    const Bias bias = BiasOf(frame->features, image);
    EXPECT_GE(bias.count, 50) << ToString(type);
    EXPECT_LT(bias.mean.norm(), tolerance_px) << ToString(type) << " " << bias.mean.transpose();
  }
}

// Where the image as it is shows too little, the result is the doubled one's.
TEST(FrontEnd, APoorImageIsDoubled) {
  const BlobImage image;
  const auto features_of = [&](int first_octave, int max_features) {
    MapperOptions options;
    options.sift_first_octave = first_octave;
    options.max_features = max_features;
    const auto front_end = Make(options);
    const auto frame = front_end->Process(image.View(), 1, {});
    EXPECT_TRUE(frame.has_value());
    std::vector<Vec2> pixels;
    if (frame)
      for (const Feature& feature : frame->features) pixels.push_back(feature.pixel());
    return pixels;
  };
  EXPECT_EQ(features_of(0, 2000), features_of(-1, 2000));
  EXPECT_NE(features_of(0, 60), features_of(-1, 60));
}

// ORB finds corners: around a blob they lie evenly, on every level of its pyramid.
TEST(FrontEnd, OrbIsNotShiftedOnCoarseLevels) {
  const BlobImage image(Vec2::Zero(), 4.0, 6.0);
  MapperOptions options;
  options.descriptor = DescriptorType::kOrb;
  const auto front_end = Make(options);
  const auto frame = front_end->Process(image.View(), 1, {});
  ASSERT_TRUE(frame.has_value());
  const Bias bias = BiasOf(frame->features, image);
  EXPECT_GE(bias.count, 50);
  EXPECT_LT(bias.mean.norm(), 0.25) << bias.mean.transpose();
}

TEST(FrontEnd, DescriptorsMatchAcrossAShift) {
  for (const DescriptorType type :
       {DescriptorType::kSift, DescriptorType::kOrb, DescriptorType::kAkaze}) {
    MapperOptions options;
    options.descriptor = type;
    const Vec2 shift(3.3, -2.6);
    const BlobImage first = BlobImage::Texture(Vec2::Zero()), second = BlobImage::Texture(shift);
    const auto front_end_a = Make(options), front_end_b = Make(options);
    const auto a = front_end_a->Process(first.View(), 1, {});
    const auto b = front_end_b->Process(second.View(), 2, {});
    ASSERT_TRUE(a.has_value() && b.has_value());
    DescriptorMatcher matcher(options.max_features);
    std::vector<DescriptorMatch> matches(static_cast<std::size_t>(options.max_features));
    const int count = matcher.Match(a->descriptors, b->descriptors, 0.9, matches);
    int right = 0;
    for (int k = 0; k < count; ++k) {
      const Vec2 motion = b->features[static_cast<std::size_t>(matches[k].train)].pixel() -
                          a->features[static_cast<std::size_t>(matches[k].query)].pixel();
      right += (motion - shift).norm() < 2.5;
    }
    EXPECT_GE(right, 50) << ToString(type);
    EXPECT_GE(right, count * 9 / 10) << ToString(type);
  }
}

TEST(FrontEnd, MaskKeepsFeaturesOut) {
  for (const Rhythm rhythm : {Rhythm::kStills, Rhythm::kVideo}) {
    MapperOptions options;
    options.rhythm = rhythm;
    options.mask.TryPushBack({-50, -50, 240, 160});  // reaches beyond the image
    const auto front_end = Make(options);
    const auto frame = front_end->Process(BlobImage().View(), 1, kDescribed);
    ASSERT_TRUE(frame.has_value());
    EXPECT_GE(frame->features.size(), 30u);
    for (const Feature& feature : frame->features)
      EXPECT_FALSE(feature.x_px < 239.0f && feature.y_px < 159.0f) << feature.pixel().transpose();
  }
}

TEST(FrontEnd, VideoTracksToATenthOfAPixel) {
  MapperOptions options;
  options.rhythm = Rhythm::kVideo;
  options.max_features = 300;
  const auto front_end = Make(options);
  const Vec2 step(1.7, 0.9);
  std::map<std::uint32_t, Vec2> start;
  for (int i = 0; i < 6; ++i) {
    const BlobImage image(i * step);
    const auto frame = front_end->Process(image.View(), i, {});
    ASSERT_TRUE(frame.has_value());
    if (i == 0) {
      EXPECT_EQ(frame->descriptors.count, static_cast<int>(frame->features.size()));
      for (const Feature& f : frame->features) start[f.track] = f.pixel();
      EXPECT_GE(start.size(), 60u);
      continue;
    }
    EXPECT_EQ(frame->descriptors.count, 0);  // between keyframes
    double sum = 0.0;
    std::uint32_t last_track = 0;
    for (const Feature& f : frame->features) {
      ASSERT_TRUE(start.contains(f.track));
      EXPECT_GE(f.track, last_track);  // ascending
      last_track = f.track;
      sum += (f.pixel() - start[f.track] - i * step).norm();
    }
    EXPECT_GE(frame->features.size(), start.size() * 8 / 10);
    EXPECT_LT(sum / static_cast<double>(frame->features.size()), 0.1);
  }
}

TEST(FrontEnd, VideoMakesAKeyframeWhenMuchHasMovedOrWhenAsked) {
  MapperOptions options;
  options.rhythm = Rhythm::kVideo;
  options.keyframe_motion = 0.02;  // 9.6 px
  const auto front_end = Make(options);
  std::vector<int> keyframes;
  for (int i = 0; i < 8; ++i) {
    const auto frame =
        front_end->Process(BlobImage(i * Vec2(2.5, 0.0)).View(), i, {.want_descriptors = i == 6});
    ASSERT_TRUE(frame.has_value());
    if (frame->descriptors.count > 0) keyframes.push_back(i);
  }
  EXPECT_EQ(keyframes, (std::vector<int>{0, 4, 6}));
}

// What is described later is what would have been described at once, after the same tracks; once.
TEST(FrontEnd, VideoDescribesLater) {
  MapperOptions options;
  options.rhythm = Rhythm::kVideo;
  options.keyframe_motion = 0.02;
  const auto at_once = Make(options), later = Make(options);
  int num_later = 0;
  for (int i = 0; i < 8; ++i) {
    const BlobImage image = BlobImage::Texture(i * Vec2(2.5, 0.0));
    const auto expected = at_once->Process(image.View(), i, {.want_descriptors = i == 6});
    const auto tracked =
        later->Process(image.View(), i, {.want_descriptors = i == 6, .may_describe_later = true});
    ASSERT_TRUE(expected.has_value() && tracked.has_value());
    const std::vector<Feature> tracks(tracked->features.begin(), tracked->features.end());
    const bool is_described = tracked->descriptors.count > 0;
    EXPECT_EQ(is_described, i == 0 || i == 6);
    const auto described = later->Describe();
    ASSERT_TRUE(described.has_value());
    EXPECT_EQ(described->has_value(), !is_described && expected->descriptors.count > 0) << i;
    if (*described) {
      ++num_later;
      const FrameObservations& frame = **described;
      ASSERT_EQ(frame.features.size(), expected->features.size());
      ASSERT_EQ(frame.descriptors.count, expected->descriptors.count);
      EXPECT_EQ(frame.utime, i);
      EXPECT_EQ(std::memcmp(frame.features.data(), expected->features.data(),
                            frame.features.size() * sizeof(Feature)),
                0);
      EXPECT_EQ(std::memcmp(frame.descriptors.data, expected->descriptors.data,
                            static_cast<std::size_t>(frame.descriptors.count) * 128),
                0);
      ASSERT_LE(tracks.size(), frame.features.size());
      EXPECT_EQ(std::memcmp(tracks.data(), frame.features.data(), tracks.size() * sizeof(Feature)),
                0);
    }
    EXPECT_FALSE(later->Describe()->has_value());
  }
  EXPECT_GE(num_later, 1);
}

// Dirt on the port: what is drawn there stays where it is while the scene goes by.
void DrawDirt(BlobImage* image) {
  const auto spot = [image](int x, int y, int radius, int light) {
    for (int dy = -radius; dy <= radius; ++dy) {
      for (int dx = -radius; dx <= radius; ++dx) {
        if (dx * dx + dy * dy > radius * radius) continue;
        image->bytes()[static_cast<std::size_t>((y + dy) * BlobImage::kWidth + x + dx)] =
            static_cast<std::uint8_t>(light);
      }
    }
  };
  for (int i = 0; i < 8; ++i) spot(60 + 50 * i, i % 2 == 0 ? 70 : 250, 15, 235);  // 30 px wide
  for (int i = 0; i < 16; ++i)
    spot(240 + 8 * (i % 4), 150 + 8 * (i / 4), 2, 20);  // a field so wide
}

bool IsAtDirt(const Feature& f) {
  for (int i = 0; i < 8; ++i) {
    if ((f.pixel() - Vec2(60.5 + 50 * i, i % 2 == 0 ? 70.5 : 250.5)).norm() < 18.0) return true;
  }
  return f.x_px > 232.0f && f.x_px < 273.0f && f.y_px > 142.0f && f.y_px < 183.0f;
}

TEST(FrontEnd, VideoLeavesWhatIsFixedToTheCamera) {
  MapperOptions options;
  options.rhythm = Rhythm::kVideo;
  options.grid_cell_px = 32;
  const auto front_end = Make(options);
  std::size_t first_at_dirt = 0, last_at_dirt = 0, last = 0;
  for (int i = 0; i < 24; ++i) {
    BlobImage image = BlobImage::Texture(i * Vec2(3.1, -1.2));
    DrawDirt(&image);
    const auto frame = front_end->Process(image.View(), i, {});
    ASSERT_TRUE(frame.has_value());
    last = frame->features.size();
    last_at_dirt = static_cast<std::size_t>(
        std::count_if(frame->features.begin(), frame->features.end(), IsAtDirt));
    if (i == 0) first_at_dirt = last_at_dirt;
  }
  EXPECT_GE(first_at_dirt, 20u);
  EXPECT_LE(last_at_dirt, first_at_dirt / 5);
  EXPECT_GE(last, 80u);
  EXPECT_GE(front_end->counters().stationary, 15);
}

TEST(FrontEnd, VideoTakesNoMemory) {
  MapperOptions options;
  options.rhythm = Rhythm::kVideo;
  options.contrast_limit = 3.0;
  const auto front_end = Make(options);
  std::vector<BlobImage> images;
  for (int i = 0; i < 8; ++i) images.push_back(BlobImage::Texture(i * Vec2(3.1, -1.2)));
  const MallocTrap trap;
  int keyframes = 0;
  for (int i = 0; i < 8; ++i) {
    const auto frame = front_end->Process(images[static_cast<std::size_t>(i)].View(), i,
                                          {.want_descriptors = i % 3 == 0});
    keyframes += frame.has_value() && frame->descriptors.count > 0;
  }
  EXPECT_EQ(trap.count(), 0u);
  EXPECT_EQ(keyframes, 3);
}

// Where points are expected they are found, however far that is.
TEST(FrontEnd, VideoLooksWherePointsAreExpected) {
  for (const bool is_expected : {true, false}) {
    MapperOptions options;
    options.rhythm = Rhythm::kVideo;
    const auto front_end = Make(options);
    const BlobImage first = BlobImage::Texture(Vec2::Zero());
    const Vec2 motion(140.0, -60.0);
    const BlobImage second = BlobImage::Texture(motion);
    const auto before = front_end->Process(first.View(), 1, {});
    ASSERT_TRUE(before.has_value());
    std::map<std::uint32_t, Vec2> places;
    std::vector<Vec2> expected;
    std::size_t stay = 0;
    for (const Feature& f : before->features) {
      places[f.track] = f.pixel();
      expected.push_back(f.pixel() + motion + Vec2(4.0, -5.0));
      if (expected.size() % 7 == 0) expected.back().setConstant(std::nan(""));
      const Vec2 end = f.pixel() + motion;
      stay += end.x() < BlobImage::kWidth - 12.0 && end.y() > 12.0 && expected.back().allFinite();
    }
    if (!is_expected) expected.clear();
    const auto after = front_end->Process(second.View(), 2, {.expected_px = expected});
    ASSERT_TRUE(after.has_value());
    std::size_t right = 0;
    for (const Feature& f : after->features) {
      const auto place = places.find(f.track);
      right += place != places.end() && (f.pixel() - place->second - motion).norm() < 0.3;
    }
    EXPECT_EQ(right >= stay * 9 / 10, is_expected) << right << " of " << stay;
  }
}

TEST(FrontEnd, SameImageSameBytes) {
  for (const Rhythm rhythm : {Rhythm::kStills, Rhythm::kVideo}) {
    MapperOptions options;
    options.rhythm = rhythm;
    std::vector<std::uint8_t> first;
    for (int run = 0; run < 2; ++run) {
      const auto front_end = Make(options);
      const auto frame = front_end->Process(BlobImage().View(), 1, kDescribed);
      ASSERT_TRUE(frame.has_value());
      std::vector<std::uint8_t> bytes(
          frame->descriptors.data,
          frame->descriptors.data +
              frame->descriptors.count * DescriptorStride(options.descriptor));
      for (const Feature& f : frame->features) {
        const auto* raw = reinterpret_cast<const std::uint8_t*>(&f.x_px);
        bytes.insert(bytes.end(), raw, raw + 2 * sizeof(float));
      }
      if (run == 0) first = bytes;
      EXPECT_TRUE(bytes == first);
    }
  }
}

TEST(FrontEnd, RefusesWhatIsNoImageOfItsSize) {
  for (const Rhythm rhythm : {Rhythm::kStills, Rhythm::kVideo}) {
    MapperOptions options;
    options.rhythm = rhythm;
    const auto front_end = Make(options);
    BlobImage image;
    ImageView view = image.View();
    view.height -= 1;
    EXPECT_STREQ(front_end->Process(view, 1, {}).error().where, "size");
    view = image.View();
    view.channels = 4;
    EXPECT_STREQ(front_end->Process(view, 1, {}).error().where, "image");
    view = image.View();
    view.data = nullptr;
    EXPECT_STREQ(front_end->Process(view, 1, {}).error().where, "image");
    EXPECT_TRUE(front_end->Process(image.View(), 1, {}).has_value());
    // All black: an image, with nothing in it.
    std::fill(image.bytes().begin(), image.bytes().end(), std::uint8_t{0});
    const auto black = front_end->Process(image.View(), 2, kDescribed);
    ASSERT_TRUE(black.has_value());
    EXPECT_LT(black->features.size(), 5u);
  }
  EXPECT_STREQ(FrontEnd::Create(MapperOptions{}, 20, 300).error().where, "size");
  MapperOptions bad;
  bad.max_features = 0;
  EXPECT_STREQ(FrontEnd::Create(bad, 640, 480).error().where, "max_features");
}

}  // namespace
}  // namespace rsfm
