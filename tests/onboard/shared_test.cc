// Who is alive: what the service manager's watchdog hears of.
#include "tools/onboard/shared.h"

#include <gtest/gtest.h>

namespace rsfm {
namespace {

constexpr std::int64_t kLimitUs = 10'000'000;

class SharedTest : public ::testing::Test {
 protected:
  SharedTest() {
    rig_.camera.width = rig_.camera.height = 8;
    shared_ = std::make_unique<Shared>(rig_);
  }
  void BeatAll() {
    for (int i = 0; i < kNumWorkers; ++i) shared_->Beat(static_cast<Worker>(i));
  }

  Rig rig_;
  std::unique_ptr<Shared> shared_;
};

TEST_F(SharedTest, ThreadsThatHaveNotBegunOrHaveEndedAreNotMissed) {
  const std::int64_t far_us = MonotonicUs() + 1000 * kLimitUs;
  EXPECT_TRUE(shared_->IsAlive(far_us, kLimitUs));
  EXPECT_EQ(shared_->DiskSilenceUs(far_us), 0);
  BeatAll();
  EXPECT_FALSE(shared_->IsAlive(far_us, kLimitUs));
  for (int i = 0; i < kNumWorkers; ++i) shared_->Rest(static_cast<Worker>(i));
  EXPECT_TRUE(shared_->IsAlive(far_us, kLimitUs));
}

TEST_F(SharedTest, EachThreadThatPosesDependOnIsMissed) {
  for (const Worker silent : {Worker::kCapture, Worker::kMapper, Worker::kBus, Worker::kReceive}) {
    BeatAll();
    const std::int64_t now_us = MonotonicUs();
    EXPECT_TRUE(shared_->IsAlive(now_us + kLimitUs / 2, kLimitUs));
    for (int i = 0; i < kNumWorkers; ++i)
      if (static_cast<Worker>(i) != silent) shared_->Allow(static_cast<Worker>(i), 2 * kLimitUs);
    EXPECT_FALSE(shared_->IsAlive(now_us + 2 * kLimitUs, kLimitUs));
  }
}

// A disk that hangs does not have the vehicle's poses restarted; it is said.
TEST_F(SharedTest, ADiskThatHangsIsNotDeath) {
  BeatAll();
  const std::int64_t now_us = MonotonicUs();
  for (const Worker worker : {Worker::kCapture, Worker::kMapper, Worker::kBus, Worker::kReceive})
    shared_->Allow(worker, 10 * kLimitUs);
  EXPECT_TRUE(shared_->IsAlive(now_us + 5 * kLimitUs, kLimitUs));
  EXPECT_GT(shared_->DiskSilenceUs(now_us + 5 * kLimitUs), 4 * kLimitUs);
}

// The bus may try itself for ten seconds and more without being taken for dead.
TEST_F(SharedTest, WhoWasAllowedToWaitIsNotMissed) {
  BeatAll();
  const std::int64_t now_us = MonotonicUs();
  for (int i = 0; i < kNumWorkers; ++i) shared_->Allow(static_cast<Worker>(i), kLimitUs);
  EXPECT_TRUE(shared_->IsAlive(now_us + 2 * kLimitUs, kLimitUs));
  EXPECT_FALSE(shared_->IsAlive(now_us + 3 * kLimitUs, kLimitUs));
}

}  // namespace
}  // namespace rsfm
