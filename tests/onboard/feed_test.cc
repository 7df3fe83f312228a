// Images that are none, between those that are: counted by reason, and nothing else changes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <thread>
#include <vector>

#include "tests/mapping/blob_image.h"
#include "tools/feed/mapper_feed.h"
#include "tools/feed/mission_publisher.h"

namespace rsfm {
namespace {

constexpr int kWidth = BlobImage::kWidth, kHeight = BlobImage::kHeight;
constexpr Utime kPeriod = 100'000, kStart = 1'700'000'000'000'000;

Rig VideoRig() {
  Rig rig;
  rig.camera.lens = LensModel::kPinhole;
  rig.camera.width = kWidth;
  rig.camera.height = kHeight;
  rig.camera.lens_params = {400.0, 400.0, 240.0, 160.0};
  rig.mapper.rhythm = Rhythm::kVideo;
  rig.mapper.max_features = 300;
  rig.mapper.max_keyframes = 10;
  rig.mapper.max_landmarks = 1000;
  return rig;
}

std::vector<std::uint8_t> Shot(int index) {
  BlobImage image = BlobImage::Texture(index * Vec2(2.6, -1.1));
  return image.bytes();
}
ImageView View(const std::vector<std::uint8_t>& bytes) {
  return {bytes.data(), kWidth, kHeight, kWidth, 1};
}

using Disturbance = std::function<void(MapperFeed* feed, int index)>;

// What the mapper has after ten images, with something before each.
std::vector<float> MapTen(const Disturbance& disturb, FeedCounters* counters) {
  auto feed = std::move(*MapperFeed::Create(VideoRig(), "rig"));
  std::vector<float> seen;
  for (int i = 0; i < 10; ++i) {
    disturb(&feed, i);
    const auto report = feed.Process(View(Shot(i)), kStart + i * kPeriod);
    EXPECT_TRUE(report.has_value());
    feed.AddKeyframe();
    EXPECT_FALSE(feed.AddKeyframe().has_value());  // is one, or none is due
    const Map& map = feed.mapper().map();
    seen.push_back(static_cast<float>(map.keyframes().size()));
    seen.push_back(static_cast<float>(map.landmarks().size()));
    for (const SlotId keyframe : map.keyframes()) {
      for (const Feature& f : map.features(keyframe)) seen.insert(seen.end(), {f.x_px, f.y_px});
    }
  }
  *counters = feed.counters();
  return seen;
}

TEST(MapperFeed, AThreadOfItsOwnThatAdjustsChangesNothing) {
  FeedCounters counters;
  std::thread::id adjusts;
  const std::vector<float> alone = MapTen([](MapperFeed*, int) {}, &counters);
  const std::vector<float> with_thread = MapTen(
      [&](MapperFeed* feed, int i) {
        if (i == 0) feed->AdjustOnThread([&] { adjusts = std::this_thread::get_id(); });
      },
      &counters);
  EXPECT_NE(adjusts, std::thread::id());
  EXPECT_NE(adjusts, std::this_thread::get_id());
  EXPECT_TRUE(alone == with_thread);
}

TEST(MapperFeed, ImagesOfAnotherTimeOrSizeChangeNothing) {
  FeedCounters counters;
  const std::vector<float> alone = MapTen([](MapperFeed*, int) {}, &counters);
  EXPECT_EQ(counters.frames_dropped, 0);
  EXPECT_GT(alone.size(), 500u);
  const std::vector<float> disturbed = MapTen(
      [](MapperFeed* feed, int i) {
        const std::vector<std::uint8_t> other = Shot(50 + i);
        const Utime now = kStart + i * kPeriod;
        ImageView cut = View(other);
        cut.height -= 1;
        EXPECT_FALSE(feed->Process(cut, now - 1).has_value());
        if (i == 0) return;
        EXPECT_FALSE(feed->Process(View(other), now - kPeriod).has_value());        // repeated
        EXPECT_FALSE(feed->Process(View(other), now - kPeriod - 1).has_value());    // older
        EXPECT_FALSE(feed->Process(View(other), now + 3'600'000'000).has_value());  // in an hour
      },
      &counters);
  EXPECT_TRUE(alone == disturbed);
  EXPECT_EQ(counters.frames_dropped, 10 + 3 * 9);
  EXPECT_EQ(counters.frames_received, 10 + 10 + 3 * 9);
}

// A black image, a white one, a grey one, a torn one, one that comes twice: the tracks go on.
TEST(MapperFeed, TracksOutliveImagesThatShowNothing) {
  auto feed = std::move(*MapperFeed::Create(VideoRig(), "rig"));
  Utime now = kStart;
  const auto process = [&](const std::vector<std::uint8_t>& bytes) {
    return feed.Process(View(bytes), now += kPeriod);
  };
  ASSERT_TRUE(process(Shot(0)).has_value());
  ASSERT_TRUE(process(Shot(1)).has_value());
  const auto newest_tracks = [&] {
    std::vector<std::uint32_t> tracks;
    for (const Feature& f : feed.mapper().map().features(feed.mapper().map().keyframes().back()))
      tracks.push_back(f.track);
    return tracks;
  };
  const std::vector<std::uint32_t> before = newest_tracks();
  ASSERT_GE(before.size(), 100u);
  for (const int grey : {0, 255, 120}) {
    const auto report =
        process(std::vector<std::uint8_t>(kWidth * kHeight, static_cast<std::uint8_t>(grey)));
    ASSERT_TRUE(report.has_value());
    EXPECT_NE(report->state, MapperState::kTracking);
  }
  std::vector<std::uint8_t> torn = Shot(2);
  std::fill(torn.begin() + kWidth * kHeight / 2, torn.end(), std::uint8_t{0});
  ASSERT_TRUE(process(torn).has_value());
  EXPECT_FALSE(process(Shot(1)).has_value());  // once more
  EXPECT_EQ(feed.counters().frames_unusable, 4);
  EXPECT_EQ(feed.counters().frames_dropped, 1);
  EXPECT_EQ(DescribeLeftOut(feed.gate()), "1 black, 1 white, 1 flat, 1 torn, 1 duplicate");
  ASSERT_TRUE(process(Shot(3)).has_value());
  const std::vector<std::uint32_t> after = newest_tracks();
  std::vector<std::uint32_t> both;
  std::set_intersection(before.begin(), before.end(), after.begin(), after.end(),
                        std::back_inserter(both));
  EXPECT_GE(both.size(), before.size() * 8 / 10);
}

// The first image has a stamp of in an hour: those that follow are older, for five seconds refused.
TEST(MapperFeed, AWrongFirstTimeIsOvercome) {
  auto feed = std::move(*MapperFeed::Create(VideoRig(), "rig"));
  EXPECT_TRUE(feed.Process(View(Shot(0)), kStart + 3'600'000'000).has_value());
  int num_refused = 0;
  for (int i = 1; i <= 60; ++i)
    num_refused += !feed.Process(View(Shot(i)), kStart + i * kPeriod).has_value();
  EXPECT_EQ(num_refused, 50);
  EXPECT_EQ(feed.counters().count(FrameVerdict::kOutOfOrder), 50);
  EXPECT_EQ(feed.last().reset_counter, 1);
  for (const SlotId id : feed.mapper().map().keyframes())
    EXPECT_LT(feed.mapper().map().keyframe(id).utime, kStart + 61 * kPeriod);
}

class NoSink final : public MessageSink {
 public:
  IoStatus Take(Audience, const std::string&, Utime, std::span<const std::uint8_t>) override {
    return {};
  }
};

// Whatever is refused is in the status, by its reason, and the mapper is as it was.
TEST(MapperFeed, TheStatusSaysWhatWasRefusedAndWhy) {
  auto feed = std::move(*MapperFeed::Create(VideoRig(), "rig"));
  NoSink sink;
  const MissionPublisher publisher(VideoRig(), &sink);
  const auto status = [&] {
    status_t filled{};
    publisher.FillStatus(kStart, feed.last(), feed.counters(), feed.mapper(), &filled);
    return filled;
  };
  const auto grey = [](int value) {
    return std::vector<std::uint8_t>(kWidth * kHeight, static_cast<std::uint8_t>(value));
  };
  ASSERT_TRUE(feed.Process(View(Shot(0)), kStart).has_value());
  struct Case {
    std::vector<std::uint8_t> bytes;
    Utime after;
    std::int64_t status_t::*counter;
    bool is_late;
  };
  std::vector<std::uint8_t> torn = Shot(1);
  std::fill(torn.begin() + kWidth * kHeight / 2, torn.end(), std::uint8_t{0});
  const std::vector<Case> cases = {
      {Shot(1), 0, &status_t::frames_repeated_time, true},
      {Shot(1), -kPeriod, &status_t::frames_out_of_order, true},
      {Shot(1), 3'600'000'000, &status_t::frames_from_the_future, true},
      {Shot(0), kPeriod, &status_t::frames_duplicate, true},
      {grey(0), 2 * kPeriod, &status_t::frames_black, false},
      {grey(255), 3 * kPeriod, &status_t::frames_white, false},
      {grey(90), 4 * kPeriod, &status_t::frames_flat, false},
      {torn, 5 * kPeriod, &status_t::frames_torn, false}};
  const std::size_t keyframes = feed.mapper().map().keyframes().size();
  std::int64_t late = 0, damaged = 0;
  for (const Case& c : cases) {
    static_cast<void>(feed.Process(View(c.bytes), kStart + c.after));
    late += c.is_late;
    damaged += !c.is_late;
    EXPECT_EQ(status().*c.counter, 1);
    EXPECT_EQ(status().frames_late, late);
    EXPECT_EQ(status().frames_damaged, damaged);
  }
  ImageView cut = View(torn);
  cut.width -= 1;
  EXPECT_FALSE(feed.Process(cut, kStart + 6 * kPeriod).has_value());
  EXPECT_EQ(status().frames_wrong_form, 1);
  EXPECT_EQ(feed.mapper().map().keyframes().size(), keyframes);

  NavSample nav;
  nav.Set(NavField::kVelocity);
  nav.Set(NavField::kAltitude);
  const auto add = [&](Utime after, const Vec3& velocity, double altitude_m) {
    nav.utime = kStart + after;
    nav.velocity_body_mps = velocity;
    nav.altitude_m = altitude_m;
    feed.AddNav(nav);
  };
  add(0, Vec3(1, 0, 0), 3.0);
  EXPECT_EQ(status().nav_rejected, 0);
  add(0, Vec3(1, 0, 0), 3.0);
  EXPECT_EQ(status().nav_repeated, 2);
  add(1000, Vec3(std::nan(""), 0, 0), std::nan(""));
  EXPECT_EQ(status().nav_not_finite, 2);
  add(2000, Vec3(-32.768, -32.768, -32.768), 0.0);
  EXPECT_EQ(status().nav_sentinel, 2);
  add(3000, Vec3(0, 700, 0), 20000.0);
  EXPECT_EQ(status().nav_out_of_range, 2);
  add(-10'000'000, Vec3(1, 0, 0), 3.0);
  EXPECT_EQ(status().nav_runs_backwards, 2);
  nav.sigma_velocity_mps = Vec3(-1, -1, -1);
  nav.sigma_altitude_m = -1.0;
  add(4000, Vec3(1, 0, 0), 3.0);
  EXPECT_EQ(status().nav_sentinel, 4);
  feed.mapper().nav().buffer().SetHorizon(kStart - 1000);
  nav.sigma_velocity_mps.setZero();
  nav.sigma_altitude_m = 0.0;
  add(-2000, Vec3(1, 0, 0), 3.0);
  EXPECT_EQ(status().nav_too_late, 2);
  EXPECT_EQ(status().nav_rejected, 2 + 2 + 4 + 2 + 2 + 2);
  EXPECT_EQ(feed.mapper().nav().buffer().accepted(), 2u);
}

}  // namespace
}  // namespace rsfm
