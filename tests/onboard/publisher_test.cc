// The mapper's messages in the vision thread: after the start nothing allocates, and what is
// encoded is what the map holds.
#include <gtest/gtest.h>

#include "tests/mapping/simulated_flight.h"
#include "tests/support/temporary_folder.h"
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
  rig.mapper.max_keyframes = 10;
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
  EXPECT_EQ(status.keyframe_capacity, 10);
}

// How far the way back is off, mean, as seen from the keyframes that it passes.
double ErrorOfPasses(const Model& model, const SimulatedMission& mission) {
  const auto off = [&](const ModelImage& image) -> Vec3 {
    const int frame = static_cast<int>((image.utime - mission.UtimeOf(0) + 1000) / 500'000);
    return image.camera_from_world.OriginOfTarget() - mission.TrueCamera(frame).OriginOfTarget();
  };
  const std::size_t passes = model.images.size() / 2;
  double sum = 0.0;
  for (std::size_t i = 0; i < passes; ++i)
    sum += (off(model.images[i]) - off(model.images[model.images.size() - 1 - i])).norm();
  return sum / static_cast<double>(passes);
}
// The part of the observations that are off by more than 4 px.
double PartOff(const Model& model, const AnyCamera& camera) {
  int off = 0, all = 0;
  for (const ModelImage& image : model.images) {
    for (std::size_t f = 0; f < image.features.size(); ++f) {
      if (image.points[f] == kNoPoint) continue;
      const Vec3& point = model.points[static_cast<std::size_t>(image.points[f])].xyz;
      Vec2 pixel;
      off += camera.Project(image.camera_from_world * point, &pixel) != Projection::kOk ||
             (pixel - image.features[f]).norm() > 4.0;
      ++all;
    }
  }
  EXPECT_GT(all, 5'000);
  return static_cast<double>(off) / all;
}

// Out and back beside its own way with a heading that drifts: the mission has the way as the loops
// have left it, of keyframes that left the map before them, too, and landmarks that fit to it.
// A rig that hears foreign types only, and navigation from a table: what the mission's rig says of
// its log reads it back.
TEST(MissionPublisherTest, NavigationOfATableHasAChannel) {
  Rig rig;
  rig.bus.inputs = {{"RSFM_NAV", InputType::kBotCorePose, Convention::kLibbot}};
  AddNavInput(&rig.bus);
  ASSERT_EQ(rig.bus.inputs.size(), 2u);
  EXPECT_EQ(rig.bus.inputs[1].type, InputType::kNav);
  AddNavInput(&rig.bus);
  EXPECT_EQ(rig.bus.inputs.size(), 2u);

  struct Sink final : MessageSink {
    IoStatus Take(Audience, const std::string& channel, Utime,
                  std::span<const std::uint8_t>) override {
      channels.push_back(channel);
      return {};
    }
    std::vector<std::string> channels;
  } sink;
  MissionPublisher publisher(rig, &sink);
  NavSample sample;
  sample.Set(NavField::kDepth);
  ASSERT_TRUE(publisher.PublishNav(sample));
  EXPECT_EQ(sink.channels, std::vector<std::string>{"RSFM_NAV_"});
}

TEST(MissionPublisherTest, WhatLoopsMoveReachesTheMission) {
  SimulatedMissionOptions options = PassesSideBySide(2);
  options.max_features = 130;
  options.heading_drift_deg = 20.0;
  const SimulatedMission simulated(options);
  Rig rig;
  rig.camera = simulated.camera().config();
  rig.body_from_camera = DownwardCamera();
  rig.mapper = simulated.Mapper();
  rig.mapper.heading_drift_deg = 20.0;
  const auto mapper = MakeMapper(simulated, rig.mapper);
  simulated.FeedNav(&mapper->nav().buffer());
  const TemporaryFolder folder;
  auto writer = MissionWriter::Create(folder.path(), rig);
  ASSERT_TRUE(writer);
  DirectSink sink(nullptr, &*writer);
  MissionPublisher publisher(rig, &sink, {.publish_status = false});
  const FeedCounters counters;
  StepReport last;
  for (int frame = 0; frame < simulated.num_frames(); ++frame) {
    const FeatureFrame seen = simulated.See(frame);
    const auto report = mapper->Step(seen.View(simulated.UtimeOf(frame)));
    ASSERT_TRUE(report);
    last = *report;
    ASSERT_TRUE(publisher.PublishStep("", simulated.UtimeOf(frame), last, counters, mapper.get()));
  }
  ASSERT_TRUE(publisher.PublishEnd(simulated.UtimeOf(simulated.num_frames()), last, counters,
                                   mapper.get()));
  ASSERT_TRUE(writer->Close());
  ASSERT_GT(mapper->loops().num_closed(), 10);
  int num_untold = 0;
  mapper->TellMoved(1, [&](std::int32_t, const Rigid3&) { ++num_untold; });
  EXPECT_EQ(num_untold, 0);

  const auto told = ReadMission(folder.path());
  ASSERT_TRUE(told);
  EXPECT_EQ(told->num_malformed, 0);
  // The same log without what was told of loops.
  rig.bus.keyframe_poses_channel = "NONE";
  ASSERT_TRUE(WriteRig(rig, folder.path() / kRigFile));
  const auto untold = ReadMission(folder.path());
  ASSERT_TRUE(untold);
  const Model with = ModelFromMission(*told), without = ModelFromMission(*untold);
  const double passes_m[] = {ErrorOfPasses(with, simulated), ErrorOfPasses(without, simulated)};
  const double parts[] = {PartOff(with, simulated.camera()), PartOff(without, simulated.camera())};
  std::printf("passes are off by %.3f m, as first told %.3f m\n", passes_m[0], passes_m[1]);
  std::printf("off by more than 4 px: %.3f of the observations, as first told %.3f\n", parts[0],
              parts[1]);
  EXPECT_LT(passes_m[0], 0.06);
  // A turn taken back bends the way a little where it was turned.
  EXPECT_LT(parts[0], 0.5 * parts[1]);
}

}  // namespace
}  // namespace rsfm
