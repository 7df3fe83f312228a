// What a bus may throw at us on every channel that is listened to: nothing of it stops the good.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>

#include "rsfm/base/resident_memory.h"
#include "rsfm/base/rng.h"
#include "rsfm_drivers/lcm/bus.h"

namespace rsfm {
namespace {

class BusAbuseTest : public ::testing::Test {
 protected:
  BusAbuseTest() {
    rig_.bus.inputs.push_back({"POSE", InputType::kBotCorePose, Convention::kLibbot});
    rig_.bus.inputs.push_back({"ACFR_NAV", InputType::kAcfrNav, Convention::kAcfr});
    LcmBusOptions options;
    options.url = "memq://";
    options.queue_capacity = 64;
    bus_ = std::move(*LcmBus::Create(options));
    receiver_ = std::make_unique<NavReceiver>(bus_.get(), rig_, [this](const NavMessage& message) {
      if (message.sample != nullptr) samples_.push_back(*message.sample);
    });
    EXPECT_TRUE(receiver_->Subscribe());
  }
  // All that is on its way.
  void Drain() {
    while (bus_->Handle(0).value_or(0) > 0) {
    }
  }
  static std::vector<std::uint8_t> GoodDepth(Utime utime) {
    depth_t message = {};
    message.utime = utime;
    message.valid = 1;
    message.depth_m = 10.0 + 1e-6 * static_cast<double>(utime);
    std::vector<std::uint8_t> bytes;
    EXPECT_TRUE(Encode(message, &bytes));
    return bytes;
  }
  template <class Message>
  static std::vector<std::uint8_t> Bytes(const Message& message) {
    std::vector<std::uint8_t> bytes;
    EXPECT_TRUE(Encode(message, &bytes));
    return bytes;
  }
  static std::vector<std::vector<std::uint8_t>> OneOfEach() {
    dvl_t dvl = {};
    dvl.num_beams = 2;
    dvl.beam_range_m = dvl.beam_velocity_mps = {1.0, 2.0};
    dvl.beam_valid = {1, 1};
    dvl.valid = 0x7fffffff;
    nav_t nav = {};
    nav.valid = 0x7fffffff;
    nav.ned_from_body_q[0] = 1.0;
    ahrs_t ahrs = {};
    ahrs.valid = 0x7fffffff;
    ahrs.ned_from_body_q[0] = 1.0;
    depth_t depth = {};
    depth.valid = 1;
    ctd_t ctd = {};
    ctd.valid = 0x7fffffff;
    ctd.temperature_c = 8.0;
    ctd.salinity_psu = 35.0;
    fix_t fix = {};
    fix.valid = 0x7fffffff;
    bot_core::pose_t pose = {};
    pose.orientation[0] = 1.0;
    return {Bytes(nav), Bytes(dvl), Bytes(ahrs), Bytes(depth),    Bytes(acfrlcm::auv_acfr_nav_t{}),
            Bytes(ctd), Bytes(fix), Bytes(pose), Bytes(water_t{})};
  }

  Rig rig_;
  std::unique_ptr<LcmBus> bus_;
  std::unique_ptr<NavReceiver> receiver_;
  std::vector<NavSample> samples_;
};

TEST_F(BusAbuseTest, EveryTypeOnEveryChannelCutAndWhole) {
  std::int64_t sent = 0;
  for (const BusInput& input : rig_.bus.inputs) {
    for (const auto& whole : OneOfEach()) {
      for (std::size_t size = 0; size < whole.size(); size += 5, ++sent)
        ASSERT_TRUE(bus_->PublishRaw(input.channel, std::span(whole.data(), size)));
      Drain();
    }
  }
  EXPECT_EQ(bus_->counters().received, sent);
  EXPECT_EQ(bus_->counters().malformed, sent);  // each was cut
  EXPECT_TRUE(samples_.empty());
}

// The place in OneOfEach() of what an input listens for.
std::size_t TypeOf(const BusInput& input) {
  switch (input.type) {
    case InputType::kNav:
      return 0;
    case InputType::kDvl:
      return 1;
    case InputType::kAhrs:
      return 2;
    case InputType::kDepth:
      return 3;
    case InputType::kAcfrNav:
      return 4;
    case InputType::kCtd:
      return 5;
    case InputType::kFix:
      return 6;
    case InputType::kBotCorePose:
      return 7;
  }
  return 0;
}

// A whole message of another type has the wrong fingerprint, nothing else is wrong with it.
TEST_F(BusAbuseTest, EveryOtherTypeOnEveryChannelIsMalformed) {
  const auto messages = OneOfEach();
  for (const BusInput& input : rig_.bus.inputs) {
    const auto before = bus_->counters();
    for (const auto& message : messages) ASSERT_TRUE(bus_->PublishRaw(input.channel, message));
    Drain();
    const auto after = bus_->counters();
    EXPECT_EQ(after.received - before.received, static_cast<std::int64_t>(messages.size()));
    EXPECT_EQ(after.malformed - before.malformed, static_cast<std::int64_t>(messages.size()) - 1)
        << input.channel;
  }
}

void ExpectFinite(const NavSample& s, const std::string& channel) {
  EXPECT_TRUE(!s.Has(NavField::kPosition) || s.position_ned_m.allFinite()) << channel;
  EXPECT_TRUE(!s.Has(NavField::kVelocity) || s.velocity_body_mps.allFinite()) << channel;
  EXPECT_TRUE(!s.Has(NavField::kAttitude) || std::abs(s.ned_from_body.norm() - 1.0) < 1e-9)
      << channel;
  EXPECT_TRUE(!s.Has(NavField::kDepth) || std::isfinite(s.depth_m)) << channel;
  EXPECT_TRUE(!s.Has(NavField::kAltitude) || std::isfinite(s.altitude_m)) << channel;
  EXPECT_TRUE(!s.Has(NavField::kWater) || std::isfinite(s.temperature_c + s.salinity_psu))
      << channel;
}

// Each type on its channel, right but for one to four bytes behind the fingerprint.
TEST_F(BusAbuseTest, BytesTurnedAroundNeverBecomeNumbersThatAreNone) {
  Rng rng(9);
  const auto messages = OneOfEach();
  std::size_t num_samples = 0;
  for (const BusInput& input : rig_.bus.inputs) {
    const auto& good = messages[TypeOf(input)];
    for (int i = 0; i < 4000; ++i) {
      auto bytes = good;
      for (int k = 0; k < 1 + i % 4; ++k) {
        bytes[static_cast<std::size_t>(
            rng.Uniform(8.0, static_cast<double>(bytes.size()) - 0.01))] =
            static_cast<std::uint8_t>(rng.Uniform(0.0, 255.99));
      }
      ASSERT_TRUE(bus_->PublishRaw(input.channel, bytes));
      if (i % 32 == 31) Drain();
    }
    Drain();
    for (const NavSample& s : samples_) ExpectFinite(s, input.channel);
    num_samples += samples_.size();
    samples_.clear();
  }
  EXPECT_GT(num_samples, 8000u);
}

// A second of 10 kHz on each channel, by turns of rubbish, cut messages, and whole ones of another
// type, between good messages: each good one is there, and right; and nothing grows.
TEST_F(BusAbuseTest, AFloodBetweenGoodMessages) {
  Rng rng(4);
  std::vector<std::uint8_t> rubbish(300);
  for (auto& byte : rubbish) byte = static_cast<std::uint8_t>(rng.Uniform(0.0, 255.99));
  const auto messages = OneOfEach();
  constexpr int kGood = 100, kFlood = 10'000;
  std::int64_t num_rubbish = 0;
  [[maybe_unused]] std::int64_t bytes_early = 0;
  for (int i = 0; i < kGood; ++i) {
    ASSERT_TRUE(bus_->PublishRaw("RSFM_DEPTH", GoodDepth(1000 * i)));
    for (const BusInput& input : rig_.bus.inputs) {
      const auto& whole = messages[TypeOf(input)];
      const auto& other = messages[(TypeOf(input) + 1) % messages.size()];
      const std::span<const std::uint8_t> kinds[] = {rubbish, other,
                                                     std::span(whole).first(whole.size() - 1)};
      for (int k = 0; k < kFlood / kGood; ++k, ++num_rubbish)
        ASSERT_TRUE(bus_->PublishRaw(input.channel, kinds[k % 3]));
    }
    Drain();
    if (i == kGood / 4) bytes_early = ResidentBytes();
  }
#ifndef RSFM_SANITIZED
  EXPECT_LT(ResidentBytes() - bytes_early, 512 * ::sysconf(_SC_PAGESIZE));
#endif
  EXPECT_EQ(bus_->counters().malformed, num_rubbish);
  ASSERT_EQ(samples_.size(), static_cast<std::size_t>(kGood));
  for (int i = 0; i < kGood; ++i) {
    EXPECT_EQ(samples_[static_cast<std::size_t>(i)].utime, 1000 * i);
    EXPECT_EQ(samples_[static_cast<std::size_t>(i)].depth_m, 10.0 + 1e-3 * i);
  }
}

TEST_F(BusAbuseTest, AFullQueueIsCounted) {
  for (int i = 0; i < 63; ++i) ASSERT_TRUE(bus_->PublishRaw("RSFM_DEPTH", GoodDepth(i)));
  Drain();
  EXPECT_EQ(bus_->counters().overruns, 0);
  for (int i = 0; i < 200; ++i) ASSERT_TRUE(bus_->PublishRaw("RSFM_DEPTH", GoodDepth(i)));
  Drain();
  EXPECT_GT(bus_->counters().overruns, 0);
}

TEST(BusFileTest, AFileIsWrittenAsALogOfEvents) {
  const std::string path = ::testing::TempDir() + "rsfm_bus_test.lcm";
  LcmBusOptions options;
  options.url = "file://" + path + "?mode=w";
  {
    auto bus = LcmBus::Create(options);
    ASSERT_TRUE(bus) << ToString(bus.error());
    depth_t message = {};
    message.utime = 5;
    EXPECT_TRUE((*bus)->Publish("RSFM_DEPTH", message));
  }
  options.url = "file://" + path + "?speed=0";
  auto bus = LcmBus::Create(options);
  ASSERT_TRUE(bus) << ToString(bus.error());
  int count = 0;
  ASSERT_TRUE((*bus)->Subscribe<depth_t>("RSFM_DEPTH", [&](Utime, const depth_t& m) {
    ++count;
    EXPECT_EQ(m.utime, 5);
  }));
  while ((*bus)->Handle(1000).value_or(0) > 0 && count == 0) {
  }
  EXPECT_EQ(count, 1);
}

}  // namespace
}  // namespace rsfm
