#include "rsfm/mapping/patch_tracker.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/video/tracking.hpp>
#include <vector>

#include "tests/mapping/blob_image.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

constexpr int kTop = 4;

ImagePyramid PyramidOf(BlobImage& image, const PatchTracker& tracker) {
  ImagePyramid pyramid(BlobImage::kWidth, BlobImage::kHeight, kTop + 1, tracker.border_px());
  pyramid.Build(image.bytes().data(), BlobImage::kWidth);
  return pyramid;
}

// Places whose patch is in both images.
std::vector<PatchPlace> Grid(const Vec2& shift, int step_px = 23) {
  std::vector<PatchPlace> places;
  for (int y = 14; y < BlobImage::kHeight - 14; y += step_px) {
    for (int x = 14; x < BlobImage::kWidth - 14; x += step_px) {
      const Vec2 to = Vec2(x, y) + shift;
      if (to.x() > 14.0 && to.y() > 14.0 && to.x() < BlobImage::kWidth - 14.0 &&
          to.y() < BlobImage::kHeight - 14.0)
        places.push_back({static_cast<float>(x), static_cast<float>(y)});
    }
  }
  return places;
}

struct Outcome {
  int found = 0, right = 0;  // right: within half a pixel
  double rms_px = 0.0;       // of those
};

Outcome Judge(const std::vector<PatchPlace>& from, const std::vector<PatchPlace>& to,
              const std::vector<bool>& found, const Vec2& shift) {
  Outcome outcome;
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (!found[i]) continue;
    ++outcome.found;
    const double error = (Vec2(to[i].x, to[i].y) - Vec2(from[i].x, from[i].y) - shift).norm();
    if (error > 0.5) continue;
    ++outcome.right;
    outcome.rms_px += error * error;
  }
  outcome.rms_px = std::sqrt(outcome.rms_px / std::max(outcome.right, 1));
  return outcome;
}

Outcome Ours(BlobImage& first, BlobImage& second, const Vec2& shift, const Vec2& guess) {
  PatchTracker tracker({});
  const ImagePyramid from = PyramidOf(first, tracker), to = PyramidOf(second, tracker);
  const std::vector<PatchPlace> places = Grid(shift);
  std::vector<PatchPlace> ends = places;
  std::vector<bool> found;
  for (std::size_t i = 0; i < places.size(); ++i) {
    ends[i].x += static_cast<float>(guess.x());
    ends[i].y += static_cast<float>(guess.y());
    found.push_back(tracker.Track(from, to, places[i], kTop, &ends[i]));
  }
  return Judge(places, ends, found, shift);
}

Outcome OpenCvs(BlobImage& first, BlobImage& second, const Vec2& shift) {
  const cv::Mat from(BlobImage::kHeight, BlobImage::kWidth, CV_8UC1, first.bytes().data());
  const cv::Mat to(BlobImage::kHeight, BlobImage::kWidth, CV_8UC1, second.bytes().data());
  const std::vector<PatchPlace> places = Grid(shift);
  std::vector<cv::Point2f> starts, ends;
  for (const PatchPlace& place : places) starts.emplace_back(place.x, place.y);
  std::vector<std::uint8_t> status;
  std::vector<float> errors;
  cv::calcOpticalFlowPyrLK(from, to, starts, ends, status, errors, cv::Size(21, 21), kTop,
                           cv::TermCriteria(3, 20, 0.01));
  std::vector<PatchPlace> found_at;
  for (const cv::Point2f& end : ends) found_at.push_back({end.x, end.y});
  return Judge(places, found_at, {status.begin(), status.end()}, shift);
}

TEST(PatchTracker, FindsAKnownShiftToAFewHundredthsOfAPixel) {
  BlobImage first = BlobImage::Texture(Vec2::Zero());
  for (const Vec2& shift : {Vec2(0.5, -0.25), Vec2(1.3, 2.6), Vec2(-7.4, 3.35), Vec2(25.3, 14.2)}) {
    BlobImage second = BlobImage::Texture(shift);
    const Outcome ours = Ours(first, second, shift, Vec2::Zero());
    const auto all = static_cast<int>(Grid(shift).size());
    EXPECT_GE(ours.right, all * 97 / 100) << shift.transpose();
    EXPECT_LE(ours.found - ours.right, all / 100) << shift.transpose();
    EXPECT_LT(ours.rms_px, 0.03) << shift.transpose();
    // The oracle: what it finds we find, nearly as exactly, though light is projected out.
    const Outcome theirs = OpenCvs(first, second, shift);
    EXPECT_GE(ours.right, theirs.right - all / 50) << shift.transpose();
    EXPECT_LT(ours.rms_px, 1.5 * theirs.rms_px) << shift.transpose();
  }
}

TEST(PatchTracker, LargeMotionNeedsAnExpectation) {
  BlobImage first = BlobImage::Texture(Vec2::Zero());
  const Vec2 shift(140.3, -60.7);
  BlobImage second = BlobImage::Texture(shift);
  const auto all = static_cast<int>(Grid(shift).size());
  EXPECT_GE(Ours(first, second, shift, shift + Vec2(9.0, -7.0)).right, all * 95 / 100);
  EXPECT_LE(OpenCvs(first, second, shift).right, all / 2);
  EXPECT_LE(Ours(first, second, shift, Vec2::Zero()).found, all * 6 / 10);  // and says so
}

// Another light: brighter, and of another contrast.
TEST(PatchTracker, LightThatChangesDoesNotMatter) {
  BlobImage first = BlobImage::Texture(Vec2::Zero());
  const Vec2 shift(3.4, -2.2);
  const double still = [&] {
    BlobImage second = BlobImage::Texture(shift);
    return Ours(first, second, shift, Vec2::Zero()).rms_px;
  }();
  for (const auto& [gain, offset] :
       {std::pair{1.0, 35.0}, {0.7, 0.0}, {0.5, 60.0}, {1.25, -20.0}}) {
    BlobImage second = BlobImage::Texture(shift);
    for (std::uint8_t& value : second.bytes())
      value = static_cast<std::uint8_t>(std::clamp(gain * value + offset + 0.5, 0.0, 255.0));
    const Outcome ours = Ours(first, second, shift, Vec2::Zero());
    const auto all = static_cast<int>(Grid(shift).size());
    EXPECT_GE(ours.right, all * 95 / 100) << gain << " " << offset;
    EXPECT_LT(ours.rms_px, 2.0 * still + 0.01) << gain << " " << offset;
  }
}

TEST(PatchTracker, RefusesWhereThereIsNothingToFind) {
  PatchTracker tracker({});
  BlobImage image = BlobImage::Texture(Vec2::Zero()), other = BlobImage::Texture(Vec2(2.0, 1.0));
  std::vector<std::uint8_t>& flat = other.bytes();
  const ImagePyramid textured = PyramidOf(image, tracker);
  const auto refuses = [&](PatchPlace start, PatchPlace guess, const ImagePyramid& from,
                           const ImagePyramid& to) {
    PatchPlace found = guess;
    const bool is_found = tracker.Track(from, to, start, kTop, &found);
    const bool is_same = std::memcmp(&found, &guess, sizeof(found)) == 0;
    return !is_found && is_same;
  };
  const float nan = std::nanf("");
  EXPECT_TRUE(refuses({-3.0f, 50.0f}, {50.0f, 50.0f}, textured, textured));
  EXPECT_TRUE(refuses({50.0f, 50.0f}, {50.0f, 1000.0f}, textured, textured));
  EXPECT_TRUE(refuses({nan, 50.0f}, {50.0f, 50.0f}, textured, textured));
  EXPECT_TRUE(refuses({50.0f, 50.0f}, {50.0f, nan}, textured, textured));
  std::fill(flat.begin(), flat.end(), std::uint8_t{90});
  const ImagePyramid nothing = PyramidOf(other, tracker);
  EXPECT_TRUE(refuses({50.0f, 50.0f}, {50.0f, 50.0f}, nothing, textured));
  EXPECT_TRUE(refuses({50.0f, 50.0f}, {50.0f, 50.0f}, textured, nothing));
  // An edge slides along itself.
  for (std::size_t i = 0; i < flat.size(); ++i) flat[i] = i % BlobImage::kWidth < 200 ? 60 : 190;
  const ImagePyramid edge = PyramidOf(other, tracker);
  EXPECT_TRUE(refuses({200.0f, 160.0f}, {200.0f, 160.0f}, edge, edge));
  // The inverse image: as much texture, and where the patch lies nothing of it is the same. What is
  // alike somewhere else may be found.
  other = BlobImage::Texture(Vec2(2.0, 1.0));
  for (std::uint8_t& value : other.bytes()) value = static_cast<std::uint8_t>(255 - value);
  const ImagePyramid inverse = PyramidOf(other, tracker);
  int tried = 0, num_found = 0;
  for (float x = 60.0f; x < 420.0f; x += 30.0f) {
    for (float y = 50.0f; y < 270.0f; y += 30.0f, ++tried) {
      PatchPlace found{x + 2.0f, y + 1.0f};
      if (!tracker.Track(textured, inverse, {x, y}, kTop, &found)) continue;
      ++num_found;
      EXPECT_GT(std::hypot(found.x - x - 2.0f, found.y - y - 1.0f), 2.0f) << x << " " << y;
    }
  }
  EXPECT_LT(num_found, tried / 2) << "of " << tried;
}

TEST(PatchTracker, EveryWindowWorksAtTheImagesEdge) {
  BlobImage first = BlobImage::Texture(Vec2::Zero()), second = BlobImage::Texture(Vec2(0.5, 0.5));
  for (const int window_px : {5, 7, 9, 15, 25, 31, 101}) {
    PatchTrackerOptions options;
    options.window_px = window_px;
    PatchTracker tracker(options);
    const ImagePyramid from = PyramidOf(first, tracker), to = PyramidOf(second, tracker);
    for (const PatchPlace& start : {PatchPlace{0.0f, 0.0f},
                                    {479.0f, 0.0f},
                                    {0.0f, 319.0f},
                                    {479.4f, 319.4f},
                                    {240.0f, 160.0f}}) {
      PatchPlace found = start;
      const bool is_found = tracker.Track(from, to, start, kTop, &found);
      if (is_found) {
        EXPECT_LT(std::hypot(found.x - start.x, found.y - start.y), 3.0) << window_px;
      }
      EXPECT_TRUE(is_found || start.x != 240.0f) << window_px;
    }
  }
}

TEST(PatchTracker, TakesNoMemory) {
  PatchTracker tracker({});
  BlobImage first = BlobImage::Texture(Vec2::Zero()), second = BlobImage::Texture(Vec2(2.0, 1.0));
  const ImagePyramid from = PyramidOf(first, tracker);
  ImagePyramid to = PyramidOf(second, tracker);
  PatchPlace found{100.0f, 100.0f};
  const MallocTrap trap;
  to.Build(second.bytes().data(), BlobImage::kWidth);
  EXPECT_TRUE(tracker.Track(from, to, {100.0f, 100.0f}, kTop, &found));
  EXPECT_EQ(trap.count(), 0u);
}

// What a plain sum over five by five pixels gives, borders repeated.
TEST(ImagePyramid, HalvesAsThePlainSumDoes) {
  for (const int width : {33, 64, 101}) {
    const int height = 47;
    Rng rng(3);
    std::vector<std::uint8_t> image(static_cast<std::size_t>(width * height));
    for (std::uint8_t& value : image) value = static_cast<std::uint8_t>(rng.Uniform(0.0, 256.0));
    ImagePyramid pyramid(width, height, 3, 8);
    EXPECT_EQ(pyramid.num_levels(), 2);  // the third would be lower than 16 px
    pyramid.Build(image.data(), width);
    const PyramidLevel& half = pyramid.level(1);
    ASSERT_EQ(half.width, (width + 1) / 2);
    ASSERT_EQ(half.height, (height + 1) / 2);
    constexpr int kWeights[] = {1, 4, 6, 4, 1};
    for (int y = 0; y < half.height; ++y) {
      for (int x = 0; x < half.width; ++x) {
        int sum = 128;
        for (int j = 0; j < 5; ++j) {
          for (int i = 0; i < 5; ++i) {
            const int from_y = std::clamp(2 * y + j - 2, 0, height - 1);
            const int from_x = std::clamp(2 * x + i - 2, 0, width - 1);
            sum += kWeights[j] * kWeights[i] *
                   image[static_cast<std::size_t>(from_y * width + from_x)];
          }
        }
        ASSERT_EQ(half.origin[y * half.stride_bytes + x], sum >> 8) << x << " " << y;
      }
    }
    // The border repeats the edge.
    EXPECT_EQ(half.origin[-8 * half.stride_bytes - 8], half.origin[0]);
    EXPECT_EQ(half.origin[half.width + 7], half.origin[half.width - 1]);
  }
}

}  // namespace
}  // namespace rsfm
