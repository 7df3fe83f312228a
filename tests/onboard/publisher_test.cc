// The mapper's messages in the vision thread: after the start nothing allocates, and what is
// encoded is what the map holds.
#include <gtest/gtest.h>

#include "tests/mapping/feature_world.h"
#include "tests/support/malloc_trap.h"
#include "tools/feed/mission_publisher.h"

namespace rsfm {
namespace {

class CountingSink final : public MessageSink {
 public:
  IoStatus Take(Audience, const std::string& channel, Utime,
                std::span<const std::uint8_t> data) override {
    bytes += data.size();
    ++messages;
    keyframes += channel == "RSFM_KEYFRAME" ? 1 : 0;
    return {};
  }
  std::size_t bytes = 0;
  int messages = 0, keyframes = 0;
};

TEST(MissionPublisherTest, DoesNotAllocateOnceItIsMade) {
  Rig rig;
  rig.mapper.max_features = 600;
  rig.mapper.max_keyframes = 8;
  rig.mapper.max_landmarks = 3000;
  rig.body_from_camera = DownwardCamera();
  FeatureWorldOptions options;
  options.num_points = 16 * 600;
  options.max_features = 600;
  const AnyCamera camera = TestCamera(TestPort::kFlat);
  rig.camera = camera.config();
  const FeatureWorld world(options);
  auto mapper = IncrementalMapper::Create(rig.mapper, camera, rig.body_from_camera);
  ASSERT_TRUE(mapper);
  CountingSink sink;
  MissionPublisher publisher(rig, &sink, {.publish_status = false});
  const FeedCounters counters;
  status_t status{};
  std::size_t allocations = 0, described = 0;
  const std::string name = "0000/000000.jpg";
  int placed = 0;
  for (int i = 0; i < 14; ++i) {  // beyond max_keyframes: slots are used again
    const FeatureFrame frame = world.See(camera, (SurveyBody(i) * DownwardCamera()).Inverse(), i);
    const auto report = (*mapper)->Step(frame.View(1'000'000 * (i + 1)));
    ASSERT_TRUE(report);
    described += 128u * static_cast<std::size_t>(frame.View(1).descriptors.count);
    placed += report->state == MapperState::kTracking ? 1 : 0;
    MallocTrap trap;
    ASSERT_TRUE(publisher.PublishStep(name, 1'000'000 * (i + 1), *report, counters, mapper->get()));
    publisher.FillStatus(1'000'000 * (i + 1), *report, counters, **mapper, &status);
    allocations += trap.count();
  }
  EXPECT_EQ(allocations, 0u);
  EXPECT_GT(placed, 8);
  EXPECT_GE(sink.keyframes, 14);
  EXPECT_GT(described, 14u * 100 * 128);
  EXPECT_GT(sink.bytes, described);
  EXPECT_EQ(status.keyframe_capacity, 8);
}

}  // namespace
}  // namespace rsfm
