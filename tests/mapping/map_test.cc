#include "rsfm/mapping/map.h"

#include <gtest/gtest.h>

#include <vector>

#include "rsfm/base/rng.h"
#include "tests/support/malloc_trap.h"

namespace rsfm {
namespace {

MapperOptions SmallOptions() {
  MapperOptions options;
  options.max_features = 50;
  options.max_keyframes = 8;
  options.max_landmarks = 200;
  return options;
}

struct Frame {
  std::vector<Feature> features = std::vector<Feature>(50);
  std::vector<std::uint8_t> descriptors = std::vector<std::uint8_t>(50 * 128, 7);
  FrameObservations View() const {
    return {1, features, {descriptors.data(), 50, DescriptorType::kSift}};
  }
};

// Every link is there in both directions, and the counts agree.
void ExpectConsistent(const Map& map) {
  std::size_t links = 0, observations = 0;
  for (const SlotId keyframe : map.keyframes()) {
    int linked = 0;
    const auto landmarks = map.landmarks_of(keyframe);
    for (std::size_t i = 0; i < landmarks.size(); ++i) {
      const Landmark* landmark = map.landmarks().Find(landmarks[i]);
      if (landmark == nullptr) continue;
      ++linked;
      int found = 0;
      for (const Observation& o : landmark->observations)
        found += o.keyframe == keyframe && o.feature == static_cast<std::int32_t>(i);
      EXPECT_EQ(found, 1);
    }
    EXPECT_EQ(map.keyframe(keyframe).num_landmarks, linked);
    links += static_cast<std::size_t>(linked);
  }
  map.landmarks().ForEach([&](SlotId, const Landmark& landmark) {
    for (const Observation& o : landmark.observations) EXPECT_TRUE(map.Contains(o.keyframe));
    observations += landmark.observations.size();
  });
  EXPECT_EQ(links, observations);
}

TEST(Map, StaysConsistentUnderAnything) {
  Map map(SmallOptions());
  const Frame frame;
  Rng rng(21);
  std::vector<SlotId> landmarks(300);
  for (int step = 0; step < 4000; ++step) {
    MallocTrap trap;
    const auto keyframes = map.keyframes();
    const SlotId keyframe =
        keyframes.empty() ? SlotId{}
                          : keyframes[rng.Index(static_cast<std::uint32_t>(keyframes.size()))];
    SlotId& a = landmarks[rng.Index(300)];
    const SlotId b = landmarks[rng.Index(300)];
    switch (rng.Index(20)) {
      case 0:
        map.AddKeyframe(frame.View(), {});
        break;
      case 1:
        if (keyframes.size() > 4) map.EraseKeyframe(keyframe);
        break;
      case 2:
        map.EraseLandmark(a);
        break;
      case 3:
        map.Merge(a, b);
        break;
      case 4:
        if (keyframe.valid()) map.Unobserve(a, keyframe);
        break;
      case 5:
      case 6:
      case 7:
        if (!map.landmarks().Contains(a)) a = map.AddLandmark(Vec3::Zero(), Feature{});
        break;
      default:
        if (keyframe.valid()) map.Observe(a, keyframe, static_cast<int>(rng.Index(50)));
    }
    EXPECT_EQ(trap.count(), 0u);
    if (step % 50 == 0) ExpectConsistent(map);
  }
  EXPECT_GT(map.landmarks().size(), 20u);
}

TEST(Map, RefusesBeyondItsCapacities) {
  Map map(SmallOptions());
  const Frame frame;
  for (int i = 0; i < 8; ++i) EXPECT_TRUE(map.AddKeyframe(frame.View(), {}).has_value());
  EXPECT_FALSE(map.AddKeyframe(frame.View(), {}).has_value());
  for (int i = 0; i < 200; ++i) EXPECT_TRUE(map.AddLandmark(Vec3::Zero(), Feature{}).valid());
  EXPECT_FALSE(map.AddLandmark(Vec3::Zero(), Feature{}).valid());
  map.Clear();
  EXPECT_TRUE(map.keyframes().empty());
  EXPECT_TRUE(map.AddLandmark(Vec3::Zero(), Feature{}).valid());
}

TEST(Map, ALandmarkForgetsItsOldestObservation) {
  MapperOptions options = SmallOptions();
  options.max_keyframes = kMaxObservations + 4;
  Map map(options);
  const Frame frame;
  std::vector<SlotId> keyframes;
  const SlotId landmark = map.AddLandmark(Vec3::Zero(), Feature{});
  for (int i = 0; i < kMaxObservations + 4; ++i) {
    keyframes.push_back(*map.AddKeyframe(frame.View(), {}));
    EXPECT_TRUE(map.Observe(landmark, keyframes.back(), 3));
  }
  EXPECT_EQ(map.landmarks().Find(landmark)->observations.size(),
            static_cast<std::size_t>(kMaxObservations));
  EXPECT_EQ(map.landmarks().Find(landmark)->observations[0].keyframe, keyframes[4]);
  EXPECT_FALSE(map.landmarks().Contains(map.landmarks_of(keyframes[0])[3]));
  ExpectConsistent(map);
}

TEST(Map, AnErasedKeyframeTakesTheLandmarksThatOnlyItSaw) {
  Map map(SmallOptions());
  const Frame frame;
  const SlotId a = *map.AddKeyframe(frame.View(), {}), b = *map.AddKeyframe(frame.View(), {});
  const SlotId only_a = map.AddLandmark(Vec3::Zero(), Feature{});
  const SlotId both = map.AddLandmark(Vec3::Zero(), Feature{});
  map.Observe(only_a, a, 1);
  map.Observe(both, a, 2);
  map.Observe(both, b, 2);
  map.EraseKeyframe(a);
  EXPECT_FALSE(map.landmarks().Contains(only_a));
  ASSERT_TRUE(map.landmarks().Contains(both));
  EXPECT_EQ(map.landmarks().Find(both)->observations.size(), 1u);
  ExpectConsistent(map);
}

}  // namespace
}  // namespace rsfm
