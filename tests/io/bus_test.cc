// The bus on memq: typed messages arrive, malformed ones are counted and dropped.
#include "rsfm_drivers/lcm/bus.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

namespace rsfm {
namespace {

std::unique_ptr<LcmBus> MemoryBus() {
  LcmBusOptions options;
  options.url = "memq://";
  auto bus = LcmBus::Create(options);
  EXPECT_TRUE(bus);
  return std::move(*bus);
}

depth_t Depth(Utime utime, double depth_m) {
  depth_t message = {};
  message.utime = utime;
  message.valid = 1;
  message.depth_m = depth_m;
  return message;
}

TEST(BusTest, TypedMessagesArriveInOrder) {
  const auto bus = MemoryBus();
  std::vector<double> depths;
  ASSERT_TRUE(bus->Subscribe<depth_t>(
      "RSFM_DEPTH", [&](Utime, const depth_t& m) { depths.push_back(m.depth_m); }));
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(bus->Publish("RSFM_DEPTH", Depth(i, 10.0 + i)));
  EXPECT_TRUE(bus->Publish("RSFM_DEPTH_OTHER", Depth(9, 9.0)));
  const auto handled = bus->Handle(1000);
  ASSERT_TRUE(handled);
  EXPECT_EQ(*handled, 3);
  EXPECT_EQ(depths, (std::vector<double>{10.0, 11.0, 12.0}));
  EXPECT_EQ(bus->counters().published, 4);
  EXPECT_EQ(bus->counters().received, 3);
  EXPECT_EQ(bus->counters().malformed, 0);
}

TEST(BusTest, ChannelNamesAreLiteral) {
  const auto bus = MemoryBus();
  int count = 0;
  ASSERT_TRUE(bus->Subscribe<depth_t>("D.*", [&](Utime, const depth_t&) { ++count; }));
  EXPECT_TRUE(bus->Publish("DEPTH", Depth(1, 1.0)));
  EXPECT_TRUE(bus->Publish("D.*", Depth(1, 1.0)));
  ASSERT_TRUE(bus->Handle(1000));
  EXPECT_EQ(count, 1);
}

TEST(BusTest, MalformedMessagesAreCountedAndDropped) {
  const auto bus = MemoryBus();
  int count = 0;
  ASSERT_TRUE(bus->Subscribe<depth_t>("C", [&](Utime, const depth_t&) { ++count; }));
  std::vector<std::uint8_t> bytes;
  ASSERT_TRUE(Encode(Depth(1, 2.0), &bytes));
  EXPECT_TRUE(bus->PublishRaw("C", std::span(bytes.data(), bytes.size() - 1)));
  bytes[0] ^= 0x80;
  EXPECT_TRUE(bus->PublishRaw("C", bytes));
  EXPECT_TRUE(bus->Publish("C", nav_t{}));  // a good message of another type
  ASSERT_TRUE(bus->Handle(1000));
  EXPECT_EQ(count, 0);
  EXPECT_EQ(bus->counters().malformed, 3);
}

TEST(BusTest, WhatCannotBeEncodedIsAPublishError) {
  const auto bus = MemoryBus();
  keyframe_t keyframe = {};
  keyframe.num_features = 5;
  EXPECT_FALSE(bus->Publish("K", keyframe));
  EXPECT_EQ(bus->counters().publish_errors, 1);
}

TEST(BusTest, NavReceiverTurnsInputsIntoSamples) {
  const auto bus = MemoryBus();
  std::vector<NavSample> samples;
  int num_events = 0;
  const Rig rig;
  NavReceiver receiver(bus.get(), rig, [&](const NavMessage& message) {
    ++num_events;
    EXPECT_FALSE(message.data.empty());
    EXPECT_EQ(rig.bus.inputs[message.input].channel, num_events < 3 ? "RSFM_DEPTH" : "RSFM_NAV");
    if (message.sample != nullptr) samples.push_back(*message.sample);
  });
  EXPECT_FALSE(receiver.is_subscribed());
  ASSERT_TRUE(receiver.Subscribe());
  EXPECT_TRUE(receiver.is_subscribed());
  EXPECT_TRUE(bus->Publish("RSFM_DEPTH", Depth(7, 12.5)));
  EXPECT_TRUE(bus->Publish("RSFM_DEPTH", Depth(8, std::nan(""))));
  EXPECT_TRUE(bus->Publish("RSFM_NAV", Depth(9, 1.0)));
  while (num_events < 3) ASSERT_GT(*bus->Handle(1000), 0);
  ASSERT_EQ(samples.size(), 1u);
  EXPECT_EQ(samples[0].utime, 7);
  EXPECT_EQ(samples[0].depth_m, 12.5);
  EXPECT_EQ(receiver.num_rejected(), 1);
  EXPECT_EQ(bus->counters().malformed, 1);
}

// udpm opens its sockets with the first subscription: with no descriptor left it cannot, as it
// cannot where multicast does not come back.
TEST(BusTest, WhoCannotListenSaysSoAndMayTryAgain) {
  LcmBusOptions options;
  options.url = "udpm://239.255.76.67:7693?ttl=0";
  const auto bus = LcmBus::Create(options);
  if (!bus) GTEST_SKIP() << "no multicast here: " << ToString(bus.error());
  const Rig rig;
  int count = 0;
  NavReceiver receiver(bus->get(), rig, [&](const NavMessage&) { ++count; });
  rlimit before = {};
  ASSERT_EQ(::getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit none = {0, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &none), 0);
  const IoStatus refused = receiver.Subscribe();
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &before), 0);
  ASSERT_FALSE(refused);
  EXPECT_EQ(ExitCode(refused.error()), 1);
  EXPECT_NE(ToString(refused.error()).find(rig.bus.inputs.front().channel), std::string::npos);
  EXPECT_FALSE(receiver.is_subscribed());
  if (!receiver.Subscribe()) GTEST_SKIP() << "multicast does not come back here";
  EXPECT_TRUE((*bus)->Publish("RSFM_DEPTH", Depth(7, 12.5)));
  while (count == 0) ASSERT_TRUE((*bus)->Handle(1000));
  EXPECT_EQ(receiver.num_samples(), 1);
}

TEST(BusTest, AnImpossibleUrlIsTheRequestsFault) {
  LcmBusOptions options;
  options.url = "nothing://";
  const auto bus = LcmBus::Create(options);
  ASSERT_FALSE(bus);
  EXPECT_EQ(ExitCode(bus.error()), 2);
  EXPECT_NE(bus.error().field.find("nothing://"), std::string::npos);
}

}  // namespace
}  // namespace rsfm
