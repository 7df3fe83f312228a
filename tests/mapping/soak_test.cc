// 5,000 frames: 50 rounds of 25 m, ten outages; every capacity is full and used again many times.
// The same for longer: soak_bench.
#include <gtest/gtest.h>

#include "tests/mapping/soak_flight.h"

namespace rsfm {
namespace {

TEST(Soak, FiveThousandFramesTakeNoMoreMemory) {
  SoakFlight flight;
  constexpr int kFrames = 5000, kFull = 600;  // by then every pool has been used to its end
  int tracked = 0, reckoned = 0, worlds = 0;
  std::size_t heap_bytes = 0;
  Vec3 offset = Vec3::Zero(), worst = Vec3::Zero();
  for (int frame = 0; frame < kFrames; ++frame) {
    const StepReport report = flight.Fly(frame);
    if (frame == kFull) heap_bytes = HeapBytesNow();
    tracked += report.state == MapperState::kTracking;
    reckoned += report.state == MapperState::kDeadReckoning;
    worlds = report.world;
    if (!report.has_pose) continue;
    const Vec3 at = ToBodyPose(report.camera_from_world, report.covariance, DownwardCamera())
                        .world_from_body.translation;
    const Vec3 error = at - SoakFlight::Body(frame / SoakFlight::kFrameRate).translation;
    if (frame == 1) offset = Vec3(error.x(), error.y(), 0.0);
    worst = worst.cwiseMax((error - offset).cwiseAbs());
    ASSERT_TRUE(at.allFinite()) << frame;
  }
  const IncrementalMapper& mapper = flight.mapper();
  std::printf("%d tracked, %d reckoned, %d loops, worst %.3f %.3f %.3f m\n", tracked, reckoned,
              mapper.loops().num_closed(), worst.x(), worst.y(), worst.z());
  EXPECT_EQ(flight.heap_calls(), 0u);
  EXPECT_EQ(worlds, 0);
  EXPECT_GT(tracked, kFrames - 150);
  EXPECT_EQ(tracked + reckoned, kFrames - 1);  // the first image has no second
  EXPECT_GT(mapper.loops().num_closed(), 1000);
  EXPECT_LE(mapper.loops().graph().size(), SoakFlight::Options().max_way_nodes);
  EXPECT_LE(mapper.loops().num_places(), SoakFlight::Options().max_places);
  EXPECT_LT(worst.maxCoeff(), 0.5);  // 1.25 km
  EXPECT_LE(HeapBytesNow(), heap_bytes + heap_bytes / 1000);
}

}  // namespace
}  // namespace rsfm
