// Messages that came from the bus, with nobody who takes them.
#include "tools/onboard/inbox.h"

#include <gtest/gtest.h>

namespace rsfm {
namespace {

class InboxTest : public ::testing::Test {
 protected:
  InboxTest() {
    rig_.camera.width = rig_.camera.height = 8;
    shared_ = std::make_unique<Shared>(rig_);
    shared_->has_log = true;
    inbox_ = std::make_unique<Inbox>(rig_.bus.inputs, shared_.get());
  }
  void Take(std::size_t input, Utime utime, bool is_usable = true) {
    NavSample sample;
    sample.utime = utime;
    const std::vector<std::uint8_t> data(33, static_cast<std::uint8_t>(input));
    inbox_->Take({input, utime, data, is_usable ? &sample : nullptr});
  }
  std::vector<std::pair<std::size_t, Utime>> Waiting() {
    std::vector<std::pair<std::size_t, Utime>> waiting;
    for (NavArrival arrival; shared_->nav.Pop(0, &arrival);)
      waiting.emplace_back(arrival.input, arrival.sample.utime);
    return waiting;
  }

  Rig rig_;
  std::unique_ptr<Shared> shared_;
  std::unique_ptr<Inbox> inbox_;
};

// A second of 10 kHz on one channel while the mapper is busy: the other sensors' samples are there.
TEST_F(InboxTest, AFloodCostsItsOwnChannelOnly) {
  ASSERT_GE(rig_.bus.inputs.size(), 2u);
  constexpr int kFlood = 10'000, kGood = 10;
  for (int i = 0; i < kFlood; ++i) {
    Take(0, i);
    if (i % (kFlood / kGood) == 0) Take(1, 1'000'000 + i);
  }
  EXPECT_EQ(shared_->nav_overruns, kFlood - shared_->nav_share);
  int num_flood = 0, num_good = 0;
  for (const auto& [input, utime] : Waiting()) {
    num_flood += input == 0;
    num_good += input == 1;
  }
  EXPECT_EQ(num_good, kGood);
  EXPECT_EQ(num_flood, shared_->nav_share);
}

// All channels at once do not push each other out either.
TEST_F(InboxTest, TheSharesFitTheQueue) {
  for (int i = 0; i < 5000; ++i)
    for (std::size_t input = 0; input < rig_.bus.inputs.size(); ++input) Take(input, i);
  const auto waiting = Waiting();
  EXPECT_EQ(waiting.size(), rig_.bus.inputs.size() * static_cast<std::size_t>(shared_->nav_share));
  for (std::size_t i = 0; i < waiting.size(); ++i)
    EXPECT_EQ(waiting[i].second, static_cast<Utime>(i / rig_.bus.inputs.size()));
}

// Rubbish does not reach the mapper's queue, and the log has a few of it.
TEST_F(InboxTest, RubbishFillsNeitherQueueNorLog) {
  for (int i = 0; i < 10'000; ++i) Take(0, i, false);
  Take(0, 7);
  EXPECT_EQ(Waiting().size(), 1u);
  EXPECT_EQ(shared_->nav_overruns, 0);
  int num_logged = 0;
  for (QueuedMessage message; shared_->log.Pop(0, &message); shared_->log.Release()) ++num_logged;
  EXPECT_GE(num_logged, 20);
  EXPECT_LE(num_logged, 10'000 / 20);  // of one second, or of the few that this may take
}

}  // namespace
}  // namespace rsfm
