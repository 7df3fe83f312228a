// What `rsfm_tool check` says the mapper and the daemon take is what they take.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "rsfm/base/resident_memory.h"
#include "rsfm/io/messages.h"
#include "tests/mapping/blob_image.h"
#include "tests/support/malloc_trap.h"
#include "tools/feed/mapper_feed.h"
#include "tools/onboard/shared.h"

namespace rsfm {
namespace {

constexpr double kMebi = 1024.0 * 1024.0;

Rig DefaultRig(Rhythm rhythm) {
  Rig rig;
  rig.camera.lens = LensModel::kPinhole;
  rig.camera.width = BlobImage::kWidth;
  rig.camera.height = BlobImage::kHeight;
  rig.camera.lens_params = {400.0, 400.0, 240.0, 160.0};
  rig.mapper.rhythm = rhythm;
  return rig;
}

std::size_t PlannedBytes(const Rig& rig, const MapperFeed& feed) {
  const DaemonMemory daemon = PlanDaemon(rig);
  return feed.memory_plan().total() + daemon.frame_bytes + daemon.queue_bytes;
}

// All that the daemon makes at its start but the threads, the bus and the files.
TEST(Memory, ThePlanIsWhatIsAllocated) {
  if (!MallocTrap::IsActive()) GTEST_SKIP() << "sanitizer build";
  for (const Rhythm rhythm : {Rhythm::kVideo, Rhythm::kStills}) {
    for (const int keyframes : {10, 64}) {
      Rig rig = DefaultRig(rhythm);
      rig.mapper.max_keyframes = keyframes;
      MallocTrap trap;
      const auto feed = MapperFeed::Create(rig, "rig");
      const auto shared = std::make_unique<Shared>(rig);
      const auto allocated = static_cast<double>(trap.bytes());
      ASSERT_TRUE(feed);
      const auto planned = static_cast<double>(PlannedBytes(rig, *feed));
      EXPECT_NEAR(planned / allocated, 1.0, 0.1) << keyframes << " keyframes";
    }
  }
}

// In a process of its own that has mapped a while, with the default capacities: resident memory is
// within the plan and what is stated for programs and libraries. 0, 1: it is, it is not.
[[noreturn]] void MapAndMeasure(Rhythm rhythm) {
  const Rig rig = DefaultRig(rhythm);
  auto feed = MapperFeed::Create(rig, "rig");
  const auto shared = std::make_unique<Shared>(rig);
  constexpr Utime kStart = 1'700'000'000'000'000;
  for (int i = 0; i < 12; ++i) {
    BlobImage image = BlobImage::Texture(i * Vec2(9.0, -4.0));
    const ImageView view{image.bytes().data(), BlobImage::kWidth, BlobImage::kHeight,
                         BlobImage::kWidth, 1};
    if (!feed->Process(view, kStart + i * 200'000)) ::_exit(3);
    feed->AddKeyframe();
  }
  const auto resident = static_cast<double>(ResidentBytes()) / kMebi;
  const auto planned = static_cast<double>(PlannedBytes(rig, *feed)) / kMebi;
  std::fprintf(stderr, "resident %.1f MiB, plan %.1f MiB + %d\n", resident, planned, kLibrariesMiB);
  ::_exit(resident > 10.0 && resident <= planned + kLibrariesMiB ? 0 : 1);
}

TEST(Memory, ResidentMemoryStaysInThePlan) {
  if (!MallocTrap::IsActive()) GTEST_SKIP() << "sanitizer build";
#ifdef RSFM_EMULATED
  GTEST_SKIP() << "an emulator's memory is not the program's";
#endif
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(MapAndMeasure(Rhythm::kVideo), ::testing::ExitedWithCode(0), "resident");
  EXPECT_EXIT(MapAndMeasure(Rhythm::kStills), ::testing::ExitedWithCode(0), "resident");
}

}  // namespace
}  // namespace rsfm
